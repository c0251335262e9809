"""What run.py prints for a user: notes on options, the summary, and commands to type."""

import re
import shlex
import sys
from pathlib import Path

import msgspec
import pytest
from run_endings import harvested

from orchard.field.scenario import Scenario
from orchard.launch.hosts import how_to_join
from orchard.launch.options import HarvestOptions
from orchard.launch.request import RunRequest
from orchard.launch.result import report, speed_not_kept
from orchard.launch.run_notes import announced, running_here
from orchard.report.summary import as_table, unusual_figures
from orchard.sim.snapshot import Snapshot

OF_ONE_PROCESS = "ignored: --hosts, --patience; local mode is one process"
LIVE = "live at 4 times real time; --speed X sets another speed, --speed max none"
# The part of a run before it was resumed: 600 s of simulated time, 6,000 ticks, took 600 s.
BEFORE = Snapshot("", {}, {"tick": 6000}, b"", {}, [], {"wall_seconds": 600.0}, [])


# Options, and the notes on them.
NOTES = [
    ({"mode": "local", "hosts": 0, "patience": 20.0}, [OF_ONE_PROCESS]),
    ({"hosts": 4, "patience": 20.0}, []),
    ({"view": True}, [LIVE]),
    ({"web": 9090, "mode": "local", "hosts": 1, "patience": 3.0}, [OF_ONE_PROCESS, LIVE]),
    ({"view": True, "speed": 4.0}, []),
    ({"view": True, "mode": "realtime"}, []),
]


@pytest.mark.parametrize(("options", "words"), NOTES)
def test_what_is_ignored_and_what_is_chosen_is_told(options, words):
    assert HarvestOptions(**options).notes() == words


# The speed that was asked for, the part before, the wall time of the whole run in s, and the note.
# The whole harvest (`harvested` of tests/support/run_endings.py) takes some 970 s simulated: 48.49
# s are 20 times real time. After the part before, 370 s are left, which take 3.7 s or 18.49 s.
SPEEDS = [
    (100.0, None, 48.49, "the speed of 100 times real time was not kept: the machine reached 20.0"),
    (100.0, None, 9.8, ""),
    # As fast as possible.
    (None, None, 500.0, ""),
    # The part before it was resumed was slow.
    (100.0, BEFORE, 603.7, ""),
    (
        100.0,
        BEFORE,
        618.49,
        "the speed of 100 times real time was not kept: the machine reached 20.0",
    ),
]


@pytest.mark.parametrize(("speed", "before", "wall_seconds", "words"), SPEEDS)
def test_a_speed_that_was_not_kept_is_told(speed, before, wall_seconds, words):
    request = RunRequest(HarvestOptions(speed=speed), Scenario(), None, Path(), before)
    assert speed_not_kept(request, harvested(wall_seconds=wall_seconds)) == words


def printed(options: HarvestOptions, capsys, monkeypatch) -> list[str]:
    """Report a harvest that went well. Return the lines that are printed."""
    monkeypatch.setattr("sys.argv", ["run.py"])
    result = msgspec.to_builtins(harvested()) | {"messages_refused": {}, "collisions": 0}
    request = RunRequest(options, Scenario(rows=5), None, Path("none"))
    assert report(request, result, "harvested") == 0
    return capsys.readouterr().out.splitlines()


def test_three_lines_and_the_hash_are_shown_unless_verbose(capsys, monkeypatch):
    """`--verbose` shows all figures."""
    result, limit, try_next, hash_line = printed(
        HarvestOptions(scenario=Path("my.yaml")), capsys, monkeypatch
    )
    assert result.split(":")[0] == "5 of 5 rows in 16"
    assert limit.split(":")[0] == "What limits it"
    assert try_next.endswith(
        "run.py study my.yaml tells how many carriers are worth it; --verbose shows all figures"
    )
    assert hash_line == f"hash {'0' * 64}"
    whole = printed(HarvestOptions(verbose=True, rows=5, carriers=3), capsys, monkeypatch)
    assert whole[2].endswith(
        "run.py study --vary carriers --vary rows=5 tells how many carriers are worth it"
    )
    assert any("collisions" in line for line in whole)
    assert whole[-1] == hash_line


def test_of_the_figures_what_is_unusual_is_shown():
    """Without --verbose only these are shown; collisions are in the sentence about the result."""
    assert unusual_figures(
        {"messages_refused": {}, "stopped_seconds": {"picker_01": 3.0}, "collisions": 2}
    ) == {"stopped_seconds": {"picker_01": 3.0}}
    assert value_of(lost_seconds={}).startswith("known of a complete harvest only")
    gaps = value_of(recording_gaps=[[0.0, 5.1], [7.0, 7.3]])
    assert gaps == "0.0 to 5.1, 7.0 to 7.3 s, which no recording shows"
    assert value_of(carrier_utilisation=0.64) == "64 % of the time, outside the queue"


def value_of(**figure) -> str:
    """Return the value of a figure as the table of the terminal shows it, in its second column."""
    (value,) = as_table(figure).columns[1].cells
    return value


HERE = "tcp/127.0.0.1:7447"


@pytest.fixture(autouse=True)
def program(monkeypatch, tmp_path):
    """Let commands be typed as in a folder with run.py and `.venv`."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [str(tmp_path / "run.py")])
    monkeypatch.setattr(sys, "executable", str(tmp_path / ".venv" / "bin" / "python"))


def lines_for(folder, **options) -> list[str]:
    """Return what a run prints as it begins, and the title of the note that it leaves."""
    lines = []
    request = RunRequest(HarvestOptions(**options), Scenario(), None, folder, notes=folder / "runs")
    with announced(request, "a", HERE, lines.append):
        lines += [
            re.sub(r"\d\d:\d\d:\d\d", "HH:MM:SS", note.title)
            for note in running_here(folder / "runs")
        ]
    return lines


def test_a_run_says_how_to_stop_it_and_leaves_a_note(tmp_path):
    assert lines_for(tmp_path) == [
        "Ctrl-C ends the run; emergency stop of the robots: .venv/bin/python run.py stop",
        "5 rows, 2 pickers, seed 1, since HH:MM:SS",
    ]
    assert lines_for(tmp_path, secure=tmp_path / "my roles")[0].endswith(
        ".venv/bin/python run.py stop --secure 'my roles'"
    )
    assert lines_for(tmp_path, progress="json") == ["5 rows, 2 pickers, seed 1, since HH:MM:SS"], (
        "for programs"
    )


def test_a_run_that_cannot_leave_a_note_says_its_endpoint(tmp_path):
    (tmp_path / "runs").write_text("in its place")
    no_note, stop = lines_for(tmp_path)
    assert no_note.endswith("runs: no note of this run can be written there: File exists")
    assert stop.endswith(f"run.py stop --connect {HERE}")


@pytest.mark.parametrize("endpoint", [HERE, "tcp/0.0.0.0:7447"])
def test_the_command_for_agents_left_to_others_is_whole(endpoint):
    line = how_to_join(HarvestOptions(without=["carrier", "bin_01"]), endpoint)
    # The word after --connect depends on this machine's address.
    words = shlex.split(line.removeprefix("carrier, bin_01: left to other processes: "))
    connect = words.pop(3)
    assert words == [
        ".venv/bin/python",
        "run.py",
        "--connect",
        "--only",
        "carrier",
        "--only",
        "bin_01",
    ]
    assert connect.endswith(":7447")
    assert "0.0.0.0" not in connect


def test_only_a_run_that_others_can_reach_says_where(tmp_path):
    assert how_to_join(HarvestOptions(), HERE) == ""
    assert re.fullmatch(
        r"Other machines reach this run at tcp/(?!0\.0\.0\.0)[^/]+:7447",
        how_to_join(HarvestOptions(), "tcp/0.0.0.0:7447"),
    )
