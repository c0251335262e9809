"""`run.py stop`, `reset`, `pause`, `resume` and `step`: how they find the run that goes on, and
what they tell of its answer.

A run that goes on leaves a note in the folder of runs: a file *.going, with its id and the endpoint
of its router. The commands find it there. A router without physics stands in for a run in some
tests, and the test answers for it.
"""

import re
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from queue import SimpleQueue

import pytest
import typer
from code_blocks import block, commands
from command_line import orchard, running, summary_of
from fleet import Client, assert_goes_on, assert_stands, wait_for
from patience import PATIENCE

from orchard.commands import asking
from orchard.commands.asking import control, of_robots, reset, stop
from orchard.contract.messages import pack
from orchard.launch.run_notes import RunNote, find_run, find_runs, noted, running_here
from orchard.net.endpoints import BusError
from orchard.net.zenoh_bus import router
from orchard.wire.messages import RunInfo, Stopped


@pytest.fixture(autouse=True)
def runs(tmp_path, monkeypatch):
    monkeypatch.setenv("ORCHARD_RUNS", str(tmp_path / "runs"))
    return tmp_path / "runs"


@pytest.mark.parametrize(
    "mode", [("--mode", "realtime", "--speed", 5), ("--speed", 4)], ids=["realtime", "lockstep"]
)
def test_the_command_line_stops_a_robot_of_a_run_here(tmp_path, runs, mode):
    path = tmp_path / "summary.json"
    small = ("--rows", 3, "--hosts", 1, "--record", "none")
    words = (*small, *mode, "--duration", 3000, "--summary", path)
    with running(*words) as run, ExitStack() as stack:
        (going,) = running_here(runs)
        someone = stack.enter_context(Client.open(going.endpoint, going.run))
        poses = someone.hear("orchard/picker_01/pose")
        velocities = someone.hear("orchard/picker_01/velocity")
        done = orchard("stop", "picker_01")
        assert done.stdout == "stopped: bin_01, picker_01\n"
        stands = assert_stands(poses)
        wait_for(
            velocities,
            lambda velocity: velocity["tick"] > stands["tick"] and velocity["linear"]["x"] > 0.0,
        )
        assert_stands(poses)
        done = orchard("stop", "carrier", "piker_01", code=2)
        assert "piker_01: no such agent or kind" in done.stderr
        done = orchard("stop")
        assert re.fullmatch(
            r"stopped: bin_02, .*tractor_01\nstopped before: bin_01, picker_01\n", done.stdout
        ), done.stdout
        assert orchard("reset", "picker_01").stdout.startswith(
            "reset: bin_01, picker_01\nstill stopped: bin_02, "
        )
        assert_goes_on(poses)
        for _, _, *words in commands(block("docs/how-to.md", "emergency stop")):
            orchard(*words)
        assert_goes_on(poses)
        if "--mode" not in mode:
            assert_pauses_and_steps()
            assert_goes_on(poses)
        someone.quit()
        out, _ = run.communicate(timeout=PATIENCE)
        assert run.returncode == 0, out
    summary = summary_of(path)
    assert summary["violations"] == []
    assert summary["stopped_seconds"]["picker_01"] > 2.0
    assert running_here(runs) == []
    assert not list(runs.glob("*.going"))


def assert_pauses_and_steps() -> None:
    """Run the commands of the document: pause, step, resume."""
    lines = [
        orchard(*words).stdout
        for _, _, *words in commands(block("docs/how-to.md", "pause and step"))
    ]
    # It is paused at some tick. It then does 1 step, 20 steps, and plays on.
    first = int(lines[0].removeprefix("paused: tick ").partition(",")[0])
    then = [
        ("paused", first),
        ("paused", first + 1),
        ("paused", first + 21),
        ("playing", first + 21),
    ]
    assert lines == [f"{state}: tick {tick}, {tick / 10:.1f} s\n" for state, tick in then]
    assert "pause it first" in orchard("step", code=2).stderr


def test_a_late_answer_of_physics_is_told_and_taken(monkeypatch):
    """While physics does not answer, the command says that it waits."""
    monkeypatch.setattr(asking, "QUIET_SECONDS", 0.2)
    lines = SimpleQueue()
    robots = ["picker_01"]
    monkeypatch.setattr(asking, "print_error", lines.put)
    with router() as physics, ThreadPoolExecutor() as pool:
        physics.answer("orchard/stop")
        answer = pool.submit(
            control, RunNote("a", physics.endpoint), of_robots(robots, is_stop=True)
        )
        question = physics.inbox.take(PATIENCE)
        assert "has not answered yet" in lines.get(timeout=PATIENCE)
        question.reply(pack(Stopped("a", 0, robots, robots)))
        question.drop()
        assert answer.result(20.0).changed == robots


def test_a_stop_is_asked_once_where_the_run_is_asked_for_first():
    """A command that knows only the endpoint asks for the run's id first.

    The end of the first question (`Final`) must not be taken for an end of the second one: then the
    stop would be asked again.
    """
    with router() as physics, ThreadPoolExecutor() as pool:
        for what in ("scenario", "stop"):
            physics.answer(f"orchard/{what}")
        answer = pool.submit(control, RunNote("", physics.endpoint), of_robots([], is_stop=True))
        replies = {"scenario": RunInfo("a", 0, "lockstep", [], {}), "stop": Stopped("a", 0, [], [])}
        for what in replies:
            question = physics.inbox.take(PATIENCE)
            assert question.key == f"orchard/{what}"
            assert physics.inbox.take(1.0) is None
            question.reply(pack(replies[what]))
            question.drop()
        assert answer.result(20.0).kept is False


def test_a_stop_that_is_never_answered_may_have_arrived(monkeypatch):
    """The command says so after 1 s here."""
    monkeypatch.setattr(asking, "ANSWER_SECONDS", 1.0)
    with router() as physics:
        physics.answer("orchard/stop")
        unknown = "did not answer within 1 s; the command may have arrived"
        with pytest.raises(BusError, match=unknown):
            control(RunNote("a", physics.endpoint), of_robots([], is_stop=True))


@contextmanager
def two_runs(folder: Path):
    """Give the routers of two runs, a and b, which have left notes in a folder."""
    with router() as router_a, router() as router_b, ExitStack() as stack:
        for physics, name in ((router_a, "a"), (router_b, "b")):
            physics.answer("orchard/stop")
            stack.enter_context(noted(folder, RunNote(name, physics.endpoint, f"run {name}")))
        yield router_a, router_b


def test_a_stop_stops_all_runs_here_whatever_one_does(runs, monkeypatch, capsys):
    # Where the third run, c, should be, no router answers.
    monkeypatch.setattr(asking, "LOOK_SECONDS", 0.5)
    gone = noted(runs, RunNote("c", "tcp/127.0.0.1:9", "run c"))
    with two_runs(runs) as going, gone, ThreadPoolExecutor() as pool:
        answer = pool.submit(stop)
        # The second one is asked before the first one has answered.
        questions = [physics.inbox.take(PATIENCE) for physics in going]
        for question, name in zip(questions, "ab", strict=True):
            question.reply(pack(Stopped(name, 0, [f"picker_{name}"], [f"picker_{name}"], True)))
            question.drop()
        with pytest.raises(typer.Exit) as ended:
            answer.result(20.0)
    assert ended.value.exit_code == 2
    out, err = capsys.readouterr()
    assert sorted(out.splitlines()) == ["run a: stopped: picker_a", "run b: stopped: picker_b"]
    assert err.startswith("run c: tcp/127.0.0.1:9: ")


def test_robots_of_several_runs_are_not_reset_together(runs, capsys):
    with two_runs(runs) as going, pytest.raises(typer.Exit) as ended:
        reset()
    assert ended.value.exit_code == 2
    lines = [
        f"  --connect {physics.endpoint}  (run {name})"
        for physics, name in zip(going, "ab", strict=True)
    ]
    assert capsys.readouterr().err.splitlines() == ["2 runs are active here; choose one:", *lines]


def test_a_run_that_was_killed_is_none_of_the_active_ones(tmp_path):
    """Its note is still there, but no process holds the file any more."""
    with noted(tmp_path, RunNote("b", "tcp/127.0.0.1:2")):
        (tmp_path / "killed.going").write_text('{"run": "killed", "endpoint": "tcp/127.0.0.1:3"}')
        assert find_run(tmp_path, None) == [RunNote("b", "tcp/127.0.0.1:2")]
        with noted(tmp_path, RunNote("a", "tcp/127.0.0.1:1")):
            assert [note.run for note in find_runs(tmp_path, None)] == ["a", "b"]
