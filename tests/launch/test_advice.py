"""What a run says at its start can be typed as it stands: the command of the emergency stop, and the one for another machine."""

import re
import shlex
import sys

import pytest

from orchard.field.scenario import Scenario
from orchard.launch.distributed import how_to_join
from orchard.launch.options import HarvestOptions
from orchard.launch.request import RunRequest
from orchard.launch.run_notes import announced, running_here

HERE = "tcp/127.0.0.1:7447"


@pytest.fixture(autouse=True)
def program(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [str(tmp_path / "run.py")])
    monkeypatch.setattr(sys, "executable", str(tmp_path / ".venv" / "bin" / "python"))


def said(folder, **options) -> list[str]:
    lines = []
    request = RunRequest(HarvestOptions(**options), Scenario(), None, folder, notes=folder / "runs")
    with announced(request, "a", HERE, lines.append):
        lines += [re.sub(r"\d\d:\d\d:\d\d", "HH:MM:SS", note.title) for note in running_here(folder / "runs")]
    return lines


def test_a_run_says_how_to_stop_it_and_leaves_a_note_that_a_user_recognizes(tmp_path):
    assert said(tmp_path) == [
        "Ctrl-C ends the run; emergency stop of the robots: .venv/bin/python run.py stop",
        "5 rows, 2 pickers, seed 1, since HH:MM:SS",
    ]
    assert said(tmp_path, secure=tmp_path / "my roles")[0].endswith(".venv/bin/python run.py stop --secure 'my roles'")
    assert said(tmp_path, progress="json") == ["5 rows, 2 pickers, seed 1, since HH:MM:SS"], "for programs"


def test_a_run_that_cannot_leave_a_note_says_its_endpoint(tmp_path):
    (tmp_path / "runs").write_text("in its place")
    no_note, stop = said(tmp_path)
    assert no_note.endswith("runs: no note of this run can be written there: File exists")
    assert stop.endswith(f"run.py stop --connect {HERE}")


@pytest.mark.parametrize("endpoint", [HERE, "tcp/0.0.0.0:7447"])
def test_the_command_for_agents_left_to_others_is_whole(endpoint):
    line = how_to_join(HarvestOptions(without=["carrier", "bin_01"]), endpoint)
    words = shlex.split(line.removeprefix("carrier, bin_01: left to other processes: "))
    connect = words.pop(3)
    assert words == [".venv/bin/python", "run.py", "--connect", "--only", "carrier", "--only", "bin_01"]
    assert connect.endswith(":7447") and "0.0.0.0" not in connect


def test_only_a_run_that_others_can_reach_says_where(tmp_path):
    assert how_to_join(HarvestOptions(), HERE) == ""
    assert re.fullmatch(r"Other machines reach this run at tcp/(?!0\.0\.0\.0)[^/]+:7447", how_to_join(HarvestOptions(), "tcp/0.0.0.0:7447"))
