"""Ctrl-C at any moment: before there is anything to stop, in a tick that never ends, and where a
viewer was opened.
"""

import os
import signal
import subprocess
import sys
import time

import psutil
import pytest
from command_line import ROOT, orchard, scenario_file
from local_runs import driven_by, local_hash
from patience import PATIENCE

from orchard.field.scenario import Scenario
from orchard.launch import local_run
from orchard.launch.options import HarvestOptions
from orchard.launch.request import RunRequest

SHORT = ("--rows", "3", "--record", "none", "--speed", "1", "--duration", "30")
# A program in place of the viewer: it writes its number into a file, and waits for ever.
STAND_IN = f"""#!{sys.executable}
import os, signal, sys
with open(os.environ["VIEWER_PID"], "a") as file:
    print(os.getpid(), file=file)
signal.pause()
"""


# A program that runs another one, and sends itself Ctrl-C when that is about to import a module.
# Its words: the module, and then the other program as Python takes it.
INTERRUPTED = """
import os, runpy, signal, sys

class Interrupting:
    @staticmethod
    def find_spec(name, path=None, target=None):
        if name == MODULE:
            os.kill(os.getpid(), signal.SIGINT)

MODULE = sys.argv.pop(1)
del sys.argv[0]
sys.meta_path.insert(0, Interrupting)
if sys.argv[0] == "-m":
    runpy.run_module(sys.argv.pop(1), run_name="__main__")
else:
    runpy.run_path(sys.argv[0], run_name="__main__")
raise SystemExit(f"{MODULE} was never imported")
"""


def interrupted_at(module: str, *command: str) -> tuple[int, str]:
    """Start a program, and press Ctrl-C when it is about to import a module.

    Return its exit code and output.
    """
    line = [sys.executable, "-c", INTERRUPTED, module, *command]
    done = subprocess.run(
        line,
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        timeout=PATIENCE,
    )
    return done.returncode, done.stderr


@pytest.mark.parametrize(
    "module",
    [
        "math",
        "typer",
        "rich.console",
        "numpy",
        "pydantic",
        "orchard.field.scenario",
        "orchard.launch.request",
        "zenoh",
    ],
)
def test_ctrl_c_during_the_imports_of_run_py_ends_it_silently(module):
    code, output = interrupted_at(module, "run.py", *SHORT)
    assert code in (-signal.SIGINT, 130), "a shell shows both as 130"
    assert output.strip() == ""


def test_ctrl_c_held_back_before_the_start_is_heard():
    """The page holds Ctrl-C back while it starts a run, because Python loses one that comes while
    it starts. The run then hears it.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        line = [sys.executable, "run.py", *SHORT]
        process = subprocess.Popen(
            line, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        process.send_signal(signal.SIGINT)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    try:
        out, _ = process.communicate(timeout=PATIENCE)
    finally:
        process.kill()
    assert process.returncode == -signal.SIGINT
    assert out == ""


@pytest.mark.parametrize("command", [("run.py", "app"), ("-m", "orchard", "app")])
def test_ctrl_c_during_the_imports_of_the_page_ends_it_silently(command):
    pytest.importorskip("nicegui")
    code, output = interrupted_at("nicegui.helpers", *command, "--quiet", "--port", "0")
    assert code in (-signal.SIGINT, 130)
    assert output.strip() == ""


@pytest.mark.parametrize("mode", ["local", "lockstep"])
def test_ctrl_c_ends_the_viewer_that_the_run_has_opened(mode, tmp_path):
    viewer = tmp_path / "viewer"
    pids = tmp_path / "pids"
    viewer.write_text(STAND_IN)
    viewer.chmod(0o755)
    pids.touch()
    line = [sys.executable, "-u", "run.py", "--mode", mode, "--view", *SHORT]
    there = os.environ | {"RERUN_CLI_PATH": str(viewer), "VIEWER_PID": str(pids), "DISPLAY": ":0"}
    run = subprocess.Popen(
        line,
        cwd=ROOT,
        env=there,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    try:
        assert run.stdout is not None
        assert any(pids.read_text() and "real time" in line for line in run.stdout), (
            "the run shows its progress, and the viewer has started"
        )
        viewer_process = psutil.Process(int(pids.read_text()))
        run.send_signal(signal.SIGINT)
        run.wait(PATIENCE)
        viewer_process.wait(PATIENCE)
    finally:
        # The viewer first: as long as it lives it holds run.py's output open.
        for pid in map(int, pids.read_text().split()):
            if psutil.pid_exists(pid):
                os.kill(pid, signal.SIGKILL)
        run.kill()
        run.communicate(timeout=PATIENCE)


def test_ctrl_c_stops_a_slow_run_at_once(tmp_path, monkeypatch):
    """A tick would take 10^11 s. The run sleeps for less than a second at a time, and Ctrl-C comes
    in the first sleep.
    """
    naps = []

    def nap(seconds):
        if seconds > 0.0:
            naps.append(seconds)
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(time, "sleep", nap)
    wish = RunRequest(HarvestOptions(mode="local", speed=1e-12), Scenario(), None, tmp_path)
    summary, why = local_run.run(wish, None, lambda *figures: None)
    assert why == "stopped"
    assert summary["ticks"] == 1
    assert max(naps) < 1.0


def test_ctrl_c_ends_an_endless_tick_with_the_result_so_far(tmp_path, capsys):
    """The class `Endless` of picker_01 never ends its tick 3, and sends Ctrl-C itself."""
    scenario = driven_by(picker_01="Endless")
    wish = RunRequest(HarvestOptions(mode="local"), scenario, None, tmp_path)
    summary, why = local_run.run(wish, None, lambda *figures: None)
    assert why == "stopped"
    assert summary["ticks"] == 3
    assert summary["hash"] == local_hash(scenario, 3)
    err = capsys.readouterr().err.replace("\n", "")
    assert "picker_01 still thinks about tick 3, in" in err
    assert "own_agents.py, line" in err
    assert {path.stem for path in tmp_path.glob("tick-*")} == {"tick-000000000"}, (
        "none of the tick that was broken off"
    )


def test_ctrl_c_ends_an_agent_that_catches_everything_by_force(tmp_path):
    """The class `Stubborn` of picker_01 catches what Ctrl-C raises, and goes on."""
    path = scenario_file(tmp_path, driven_by(picker_01="Stubborn"))
    done = orchard(path, "--mode", "local", "--record", "none", code=1)
    assert "picker_01 still thinks about tick 3, in" in done.stderr
    assert "ended by force" in done.stderr
