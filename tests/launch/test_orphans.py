"""run.py is killed: its processes end by themselves, soon, and the run goes on from where it was;
what does not end is ended.
"""

import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil
import pytest
from command_line import ROOT, line_with, orchard, scenario_file, summary_of, wait_until_simulated
from local_runs import SMALL, local_at, local_hash
from patience import PATIENCE

from orchard.launch import run_notes
from orchard.launch.distributed import RESULT
from orchard.launch.run_notes import end_orphaned_processes, processes_of
from orchard.net.ending import read_end
from orchard.net.lifeline import STARTED_BY
from orchard.sim.snapshot import as_file, newest, store

DURATION = 30.0  # s, simulated


def run_py(folder: Path, *arguments: object) -> subprocess.Popen:
    """Start run.py in a folder, and keep its runs there."""
    command = [sys.executable, "-u", ROOT / "run.py", *arguments]
    there = os.environ | {"ORCHARD_RUNS": str(folder / "runs")}
    return subprocess.Popen(
        list(map(str, command)),
        cwd=folder,
        env=there,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


@contextmanager
def begun(folder: Path, *arguments: object):
    """Start a run and wait until 3 s are simulated. Give run.py, and the processes it started."""
    pace = ("--speed", 5, "--duration", DURATION, "--hosts", 2)
    run = run_py(folder, scenario_file(folder, SMALL), *pace, *arguments)
    processes = []
    try:
        line_with("real time", run)
        processes = psutil.Process(run.pid).children(recursive=True)
        wait_until_simulated(run, 3.0)
        yield run, processes
    finally:
        for process in [*processes, run]:
            with suppress(psutil.NoSuchProcess):
                process.kill()
        run.communicate(timeout=PATIENCE)


def ended(folder: Path, *arguments: object) -> tuple[int, str]:
    """Run run.py to its end. Return its exit code, and what it printed."""
    run = run_py(folder, *arguments)
    printed, _ = run.communicate(timeout=PATIENCE)
    return run.returncode, printed


@pytest.mark.parametrize(
    "number",
    [
        signal.SIGKILL,
        pytest.param(signal.SIGHUP, marks=pytest.mark.soak),
        pytest.param(signal.SIGQUIT, marks=pytest.mark.soak),
    ],
)
def test_processes_end_with_run_py_and_the_run_can_go_on(tmp_path, monkeypatch, number):
    """The run then goes on to the same hash."""
    path = tmp_path / "summary.json"
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setenv("TMPDIR", str(temporary))
    with begun(tmp_path, "--record", tmp_path / "run.rrd") as (run, processes):
        assert len(processes) == 4, "physics, two hosts of agents, logger"
        (physics,) = [
            process for process in processes if "orchard.processes.physics" in process.cmdline()
        ]
        # run.py dies, and physics ends by itself with a snapshot.
        run.send_signal(number)
        run.wait(PATIENCE)
        physics.wait(PATIENCE)
        (folder,) = (tmp_path / "runs").glob("*.snapshots")
        (end,) = temporary.glob(f"*/{RESULT}")
        last = newest(folder, [])
        assert last.tick == read_end(end, last.run).tick, "physics writes a snapshot when it ends"
        resumed = ("--resume", "last", "--mode", "local", "--duration", DURATION)
        code, printed = ended(tmp_path, *resumed, "--record", "none", "--summary", path)
        assert code == 0, printed
        _, alive = psutil.wait_procs(processes, PATIENCE)
        assert alive == [], printed
    assert summary_of(path)["hash"] == local_hash(SMALL, round(DURATION * 10))
    assert not list((tmp_path / "runs").glob("*.going"))


@pytest.mark.soak
def test_frozen_processes_end_too(tmp_path):
    """Linux wakes them up with a hang-up signal when run.py, the leader of their session, dies."""
    with begun(tmp_path, "--record", "none") as (run, processes):
        for process in processes:
            process.suspend()
        run.kill()
        run.wait(PATIENCE)
        assert psutil.wait_procs(processes, PATIENCE)[1] == []
    code, printed = ended(tmp_path, "stop")
    assert code == 2
    assert "no run is active here" in printed


def test_what_does_not_end_by_itself_is_ended_by_force(tmp_path, monkeypatch):
    """Two programs sleep, and their environment says that they are of run7 and run8. The note of
    run7 shows that its run.py is gone, so its program is ended, and that of run8 is not.
    """
    monkeypatch.setattr(run_notes, "ALONE_SECONDS", 0.2)
    lines = []
    (tmp_path / "run7.going").write_text('{"run": "run7", "endpoint": "tcp/127.0.0.1:9"}')
    others = [
        subprocess.Popen(["sleep", "60"], env=os.environ | {STARTED_BY: f"1 {run}"})
        for run in ("run7", "run8")
    ]
    try:
        deadline = time.monotonic() + PATIENCE
        while not all(map(processes_of, ("run7", "run8"))):
            assert time.monotonic() < deadline
        assert end_orphaned_processes(tmp_path, lines.append)
        assert others[0].wait(PATIENCE) == -signal.SIGKILL
        assert processes_of("run8") == [others[1].pid]
        assert "run run7: its `orchard` is gone; ending the 1 processes" in lines[0]
        assert not end_orphaned_processes(tmp_path, lines.append)
    finally:
        for other in others:
            other.kill()
            other.wait()
    assert list(tmp_path.iterdir()) == []


def test_a_run_for_which_a_host_was_gone_is_resumed_with_a_word(tmp_path):
    """`lost`: the agents that no host ran when the snapshot was taken, since which tick."""
    before = local_at(12).snapshot()
    before.lost = {"picker_01": 7}
    store(*as_file(before), tmp_path)
    done = orchard("--resume", tmp_path, "--mode", "local", "--duration", 1.3, "--record", "none")
    assert "no host was there for picker_01 (tick 7)" in done.stderr
    snapshot = newest(tmp_path, [])
    assert snapshot.lost == before.lost, "it is not forgotten"
    assert snapshot.run, "runs in local mode have an id, too"
