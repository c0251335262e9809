"""What a person sees in the terminal."""

import io
import json

import pytest
from rich.console import Console

from orchard.report.progress import Headline, Progress, headline_of, robots

FIGURES = {"sim_seconds": 61.5, "times_real_time": 30.2, "rows_picked": 2, "rows": 20, "bins_delivered": 1}


def fleet(pickers: int, carriers: int) -> dict[str, str]:
    return {
        **{f"picker_{i + 1:02d}": f"picking row {i + 1}" for i in range(pickers)},
        **{f"carrier_{i + 1:02d}": "waiting in the queue" for i in range(carriers)},
        **{f"bin_{i + 1:02d}": "empty, on its robot" for i in range(pickers + carriers)},
        "tractor_01": "driving east",
        "worker_01": "walking",
    }


def printed(doing, waits, width, height) -> list[str]:
    console = Console(file=io.StringIO(), width=width, height=height, force_terminal=False)
    console.print(robots(doing, waits, width, height))
    return console.file.getvalue().rstrip().splitlines()


@pytest.mark.parametrize(("pickers", "carriers"), [(2, 2), (5, 4), (20, 39), (20, 40)])
@pytest.mark.parametrize(("width", "height"), [(80, 24), (120, 40), (200, 60)])
def test_every_robot_is_in_the_table_and_the_table_fits(pickers, carriers, width, height):
    lines = printed(fleet(pickers, carriers), {}, width, height)
    assert len(lines) <= height - 3
    assert all(len(line) <= width for line in lines)
    together = "\n".join(lines)
    for i in range(pickers):
        assert f"P{i + 1:02d} picking row {i + 1}" in together
    for i in range(carriers):
        assert f"C{i + 1:02d} waiting in" in together


def test_the_table_tells_for_whom_a_robot_waits():
    (line,) = printed({"picker_01": "waiting for an empty bin"}, {"picker_01": "bin_01"}, 80, 24)
    assert line.strip() == "P01 waiting for an empty bin (bin_01)"


def test_a_robot_that_is_stopped_or_lost_its_agent_stands_out():
    console = Console(file=io.StringIO(), width=80, height=24, force_terminal=True, color_system="standard", legacy_windows=False)
    with Progress(console) as progress:
        progress.show(FIGURES, {"picker_01": "picking row 1", "picker_02": "picking row 2"}, {})
        progress.show(FIGURES, {"picker_02": "stopped"}, {})
    shown = console.file.getvalue()
    assert "P01 \x1b[0m\x1b[31mno agent" in shown
    assert "P02 \x1b[0m\x1b[31mstopped" in shown


def test_the_headline_is_one_line_of_eighty_columns():
    assert len(str(headline_of(FIGURES))) <= 80


def test_where_the_output_is_no_terminal_there_are_plain_lines_now_and_then():
    console = Console(file=io.StringIO(), width=100, force_terminal=False)
    with Progress(console) as progress:
        for _ in range(20):
            progress.show(FIGURES, fleet(2, 2), {})
    lines = console.file.getvalue().splitlines()
    assert lines == [str(headline_of(FIGURES))]
    assert "\x1b" not in console.file.getvalue()


def test_a_program_reads_progress_as_json():
    out = io.StringIO()
    with Progress(Console(file=out), as_json=True) as progress:
        progress.show(FIGURES, {}, {})
    (line,) = out.getvalue().splitlines()
    assert json.loads(line) == {"progress": {name: FIGURES[name] for name in Headline.__struct_fields__}}
    assert headline_of({**FIGURES, "rows_picked": 4, "bins_delivered": 2, "rows": 6}).fraction == 0.5
