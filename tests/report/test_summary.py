"""What a person sees of a run: lines and tables in the terminal, the sentence at its end, the plan
in Jupyter.
"""

import io
import json
import re
import threading
import xml.etree.ElementTree as Xml

import msgspec
import pytest
from local_runs import local_at
from patience import PATIENCE
from rich.console import Console
from run_endings import harvested

from orchard.report.plan import PIXELS
from orchard.report.progress import Progress, robots
from orchard.report.summary import (
    Headline,
    clock,
    headline_of,
    limit_sentence,
    sentence,
    six_figures,
)

# The figures of a run on its way. 525 m of 1,400 m are picked, 7.5 rows of 20.
FIGURES = {
    "sim_seconds": 61.5,
    "times_real_time": 30.0,
    "rows_picked": 2,
    "rows": 20,
    "bins": 20,
    "row_length": 70.0,
    "metres_picked": 525.0,
    "bins_delivered": 1,
    "schedule_sim_seconds": 1411.5,
    "carrier_utilisation": 0.5,
    "broken_agents": [],
    "state_seconds": {
        "picker": {"picking": 100.0, "waiting": 12.0, "calling": 3.5},
        "carrier": {"waiting": 9.0},
    },
}


def fleet(pickers: int, carriers: int) -> dict[str, str]:
    """Return what each robot of a fleet does."""
    return {
        **{f"picker_{i + 1:02d}": f"picking row {i + 1}" for i in range(pickers)},
        **{f"carrier_{i + 1:02d}": "waiting in the queue" for i in range(carriers)},
        **{f"bin_{i + 1:02d}": "empty, on its robot" for i in range(pickers + carriers)},
        "tractor_01": "driving east",
        "worker_01": "walking",
    }


def printed(doing, waits, width, height) -> list[str]:
    """Return the lines of the table of robots in a terminal of this size."""
    shown = io.StringIO()
    console = Console(file=shown, width=width, height=height, force_terminal=False)
    console.print(robots(doing, waits, width, height))
    return shown.getvalue().rstrip().splitlines()


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


@pytest.mark.parametrize(("width", "height", "shown"), [(24, 24, 20), (48, 24, 40), (20, 5, 3)])
def test_a_small_console_says_how_many_robots_it_leaves_out(width, height, shown):
    """Of 20 pickers, 39 carriers and a tractor. Three lines are left for the headline."""
    *lines, last = printed(fleet(20, 39), {}, width, height)
    assert sum(line.count("picking") + line.count("waiting") for line in lines) == shown
    assert last.strip() == f"and {20 + 39 + 1 - shown} more"
    assert len(lines) + 1 <= max(4, height - 3)


def test_the_table_tells_for_what_a_robot_waits():
    (line,) = printed({"picker_01": "waiting for an empty bin"}, {"picker_01": "bin_01"}, 80, 24)
    assert line.strip() == "P01 waiting for an empty bin (bin_01)"


def test_a_robot_that_is_stopped_or_lost_its_agent_stands_out():
    output = io.StringIO()
    console = Console(
        file=output,
        width=80,
        height=24,
        force_terminal=True,
        color_system="standard",
        legacy_windows=False,
    )
    with Progress(console) as progress:
        progress.show(FIGURES, {"picker_01": "picking row 1", "picker_02": "picking row 2"}, {})
        progress.show(FIGURES, {"picker_02": "stopped"}, {})
    shown = output.getvalue()
    assert "P01 \x1b[0m\x1b[31mno agent" in shown
    assert "P02 \x1b[0m\x1b[31mstopped" in shown


def test_the_headline_tells_share_and_time_in_eighty_columns():
    assert (
        headline_of(FIGURES).line()
        == "   61.5 s    30.0 x real time   37 % picked  1/20 bins  0:45 min left"
    )
    assert (
        len(
            headline_of(
                {**FIGURES, "sim_seconds": 9999.9, "times_real_time": 0.01, "metres_picked": 1400.0}
            ).line()
        )
        <= 80
    )


def test_the_headline_names_broken_agents():
    broken = [f"picker_0{i}, since tick {i}" for i in range(1, 6)]
    assert (
        headline_of(FIGURES | {"broken_agents": broken[:2]})
        .line()
        .endswith("  0:45 min left  broken: picker_01, picker_02")
    )
    assert (
        headline_of(FIGURES | {"broken_agents": broken})
        .line()
        .endswith("  broken: picker_01, picker_02, picker_03 and 2 more")
    )


# Figures that are changed, the --duration of the run, s, and the wall time that is left, s, at 30
# times real time.
TIMES_LEFT = [
    # The schedule takes 1,411.5 s, so 1,350 s are left.
    ({}, None, 45.0),
    # The --duration is over in 300 s.
    ({}, 361.5, 10.0),
    # The run is behind its schedule: the share that is not done of rows and bins counts, 7.5 rows
    # and one bin of 20 each.
    ({"sim_seconds": 1300.0}, None, pytest.approx(1411.5 * (1 - (525 / 70 + 1) / 40) / 30)),
    ({"sim_seconds": 2000.0, "metres_picked": 1400.0, "bins_delivered": 20}, None, 0.0),
]


@pytest.mark.parametrize(("changes", "until", "left"), TIMES_LEFT)
def test_the_time_left_is_that_of_the_schedule_or_the_rest(changes, until, left):
    assert headline_of(FIGURES | changes).seconds_left(until) == left


def test_a_run_that_gets_ready_shows_that_it_goes_on(monkeypatch):
    monkeypatch.setattr("orchard.report.progress.STILL_SECONDS", 0.001)
    lines = io.StringIO()
    is_told = threading.Event()

    def say(words: str) -> None:
        lines.write(words + "\n")
        if "so far" in words:
            is_told.set()

    with Progress(Console(file=lines)) as progress:
        monkeypatch.setattr(progress, "say", say)
        progress.get_ready("compiling")
        assert is_told.wait(PATIENCE)
        progress.show(FIGURES, {}, {})
        progress.preparing.join(PATIENCE)
    assert lines.getvalue().startswith("compiling\ngetting ready: 0:00 min so far\n")
    assert not progress.preparing.is_alive()


def test_output_to_no_terminal_is_plain_lines_now_and_then():
    shown = io.StringIO()
    console = Console(file=shown, width=100, force_terminal=False)
    with Progress(console) as progress:
        for _ in range(20):
            progress.show(FIGURES, fleet(2, 2), {})
    assert shown.getvalue().splitlines() == [headline_of(FIGURES).line()]
    assert "\x1b" not in shown.getvalue()


def test_a_program_reads_progress_as_json():
    out = io.StringIO()
    with Progress(Console(file=out), as_json=True) as progress:
        progress.show(FIGURES, {}, {})
    (line,) = out.getvalue().splitlines()
    # No forecast is made here.
    shown = FIGURES | {"done_seconds": None, "done_within_seconds": 0.0}
    assert json.loads(line) == {
        "progress": {name: shown[name] for name in Headline.__struct_fields__}
    }
    # Pickers wait, or their bins call: 12 s and 3.5 s. Done is the mean of two shares: 4 of 6 rows
    # are picked, and 2 of 6 bins delivered.
    assert headline_of(FIGURES).pickers_waited_seconds == 12.0 + 3.5
    assert (
        headline_of(
            {**FIGURES, "metres_picked": 280.0, "bins_delivered": 2, "rows": 6, "bins": 6}
        ).fraction
        == 0.5
    )


WELL = "5 of 5 rows in 16:10 min, simulated: 18.6 bins an hour"
HALF = {
    "finished": False,
    "sim_seconds": 300.0,
    "rows_picked": 2,
    "metres_picked": 209.9,
    "bins_delivered": 0,
    "bins_per_hour": 0.0,
}
HALVED = (
    "after 5:00 min, simulated, before the harvest was finished: 2 of 5 rows and 59 % of their"
    " metres picked, 0 of 5 bins delivered"
)


# What differs from a harvest that went well, and the sentence.
ENDS = [
    ({}, f"{WELL}."),
    # Ctrl-C came when all was done.
    ({"ended": "stopped"}, f"{WELL}."),
    (
        {"violations": ["a", "b"], "broken_agents": ["cat_01, since tick 9"]},
        f"{WELL}; 2 violations; 1 broken agent.",
    ),
    (HALF | {"ended": "duration"}, f"Ended by --duration {HALVED}."),
    (HALF | {"ended": "stopped"}, f"Stopped {HALVED}."),
    (HALF | {"ended": "jammed"}, f"Jammed {HALVED}."),
    (
        HALF | {"ended": "stopped", "broken_agents": ["carrier_01, since tick 1"]},
        f"Stopped {HALVED}; 1 broken agent.",
    ),
    (HALF | {"ended": "of its router"}, f"Ended (of its router) {HALVED}."),
]


def test_a_rate_of_part_full_bins_says_that_it_counts_full_ones():
    """The limit beside it counts full bins, too. Five full bins in this time are 18.6 an hour."""
    words = sentence(harvested(bins_per_hour=12.4))
    assert words.endswith("simulated: 12.4 full bins an hour.")
    assert sentence(harvested()).endswith("simulated: 18.6 bins an hour.")


@pytest.mark.parametrize(("figures", "words"), ENDS)
def test_the_first_sentence_tells_how_the_run_ended(figures, words):
    assert sentence(harvested(**figures)) == words


def test_a_harvest_with_a_shift_tells_its_day():
    words = sentence(harvested(working_day="day 2 at 09:40"))
    assert ", simulated, done on day 2 at 09:40: 18.6 bins an hour." in words


def test_a_run_stopped_before_its_first_tick_has_a_sentence():
    nothing = harvested(**HALF | {"ended": "stopped", "sim_seconds": 0.0, "metres_picked": 0.0})
    assert sentence(nothing).startswith(
        "Stopped after 0:00 min, simulated, before the harvest was finished: 2 of 5 rows and 0 %"
    )


# The parts of a harvest of 969.8 s: 34.5 % longer than the optimum of 721 s.
LOST = {"optimum": 721.0, "dispatch": 180.8, "traffic": 5.9, "people_and_animals": 14.3}


ABOVE = "its time is 35 % above the proven optimum without traffic"
# What differs from a harvest that went well, what limits it, and what is said of its losses.
LIMITS = [
    ({"bottleneck": "unloading"}, "unloading", ""),
    ({}, "the carriers", ""),
    (
        {"lost_seconds": LOST},
        "the carriers",
        f"; {ABOVE}; 3:01 min were lost to the dispatch policy",
    ),
    (
        {"lost_seconds": {"schedule": 901.8, "traffic": 65.9, "people_and_animals": 14.3}},
        "the carriers",
        "; 1:06 min were lost to traffic",
    ),
    (
        {"lost_seconds": dict.fromkeys(("schedule", "traffic", "people_and_animals"), -1.0)},
        "the carriers",
        "",
    ),
]


@pytest.mark.parametrize(("figures", "limited_by", "lost"), LIMITS)
def test_the_second_sentence_tells_limit_and_main_loss(figures, limited_by, lost):
    """It says what limits the harvest, and to what most time was lost."""
    words = (
        f"What limits it: {limited_by}, to 24.9 bins an hour in a long harvest of these rows"
        f" without traffic{lost}."
    )
    assert limit_sentence(harvested(**figures)) == words


def test_six_figures_are_in_words():
    known = {
        "schedule_sim_seconds": 911.3,
        "picker_waiting_seconds": 155.6,
        "carrier_utilisation": 0.664,
        "collisions": 0,
    }
    shown = six_figures(msgspec.to_builtins(harvested()) | known)
    assert [value for _, value, _ in shown] == ["18.6", "16:10 min", "5 of 5", "156 s", "66 %", "0"]
    assert all(note and "_" not in name + note for name, _, note in shown)


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(0.4, "0:00 min"), (3599.4, "59:59 min"), (3599.6, "1:00:00 h"), (9219.0, "2:33:39 h")],
)
def test_a_time_is_told_in_minutes_or_hours(seconds, words):
    assert clock(seconds) == words


def drawn(svg):
    """Return the rectangle of each title in a drawing."""
    boxes = Xml.fromstring(svg).iter("{http://www.w3.org/2000/svg}rect")
    return {box[0].text: box for box in boxes if len(box)}


def test_the_plan_shows_where_the_bodies_are_and_what_is_picked():
    before = local_at(0)
    run = local_at(400)
    begin = drawn(before._repr_svg_())
    now = drawn(run._repr_svg_())
    pose = run.engine.observe()["picker_01"].pose
    shift = float(now["picker_01"].get("x")) - float(begin["picker_01"].get("x"))
    assert abs(shift / PIXELS - (pose.x - before.engine.observe()["picker_01"].pose.x)) < 0.01
    picked = {
        float(metres) for name in now for metres in re.findall(r"row \d: (\S+) m picked", name)
    }
    assert picked == {round(metres, 1) for metres in run.engine.world.row_picked.tolist()}
    assert max(picked) > 30.0


def test_a_flattened_weed_is_not_drawn():
    run = local_at(0)
    run.engine.world.alive[run.engine.layout.index["weed_01"]] = False
    assert {"weed_01"} == drawn(local_at(0)._repr_svg_()).keys() - drawn(run._repr_svg_()).keys()
