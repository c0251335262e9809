"""Kill any process of run.py's, without help by a person: the same run goes on, and its hash is
that of one that nothing happened to.
"""

import re
import signal
import subprocess
import time
from contextlib import suppress

import psutil
import pyarrow.parquet as pq
import pytest
from command_line import (
    ROOT,
    line_with,
    orchard,
    running,
    scenario_file,
    starting,
    summary_of,
    wait_until_simulated,
)
from local_runs import driven_by, local_hash
from patience import PATIENCE
from stage import empty_orchard

from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario

pytestmark = pytest.mark.processes

SECONDS = 30.0  # simulated
# Slow enough that a kill meets the run before it ends.
PACE = ("--rows", 3, "--hosts", 1, "--speed", 10, "--duration", SECONDS)


@pytest.fixture(scope="module")
def undisturbed():
    return local_hash(Scenario(rows=3), round(SECONDS * 10))


def process_of(run: subprocess.Popen, word: str) -> psutil.Process:
    """Return the first process of a run with this word in its module.

    Raises StopIteration if there is none.
    """
    return next(
        child
        for child in psutil.Process(run.pid).children(recursive=True)
        if f"orchard.processes.{word}" in child.cmdline()
    )


def first_process(run: subprocess.Popen, word: str) -> psutil.Process:
    """Wait until a run has a process with this word in its module. Return it."""
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        # Not there yet, or just gone.
        with suppress(StopIteration, psutil.Error):
            return process_of(run, word)
    raise AssertionError(f"{word} was never started")


def end(run: subprocess.Popen) -> str:
    """Wait for the end of a run. Return what it printed."""
    printed, _ = run.communicate(timeout=PATIENCE)
    assert run.returncode == 0, printed
    return printed


@pytest.fixture(scope="module")
def battered(tmp_path_factory):
    """Kill a host and physics of a run, and then end a process of each kind by a signal.

    run.py has not sent these signals, so it takes the ends for deaths, and starts the processes
    again. Return the folder of the run, and what run.py printed.
    """
    folder = tmp_path_factory.mktemp("battered")
    order = (
        "--hosts",
        2,
        "--speed",
        5,
        "--record",
        folder / "run.rrd",
        "--summary",
        folder / "summary.json",
        "--table",
        folder / "tables",
    )
    with running(*PACE, *order) as run:
        wait_until_simulated(run, 2.0)
        process_of(run, "agents").kill()
        printed = line_with("starting it again", run)
        process_of(run, "physics").kill()
        printed += line_with("starting it again", run)
        line_with("real time", run)
        for word, number in (
            ("agents", signal.SIGTERM),
            ("logger", signal.SIGINT),
            ("physics", signal.SIGTERM),
        ):
            process_of(run, word).send_signal(number)
        printed += end(run)
    return folder, printed


def test_whatever_is_killed_the_same_run_goes_on(battered, undisturbed):
    """A process that is killed has the exit code -9, the number of SIGKILL."""
    folder, printed = battered
    assert re.findall(r"(agents|physics).* ended with code -9; starting it again", printed) == [
        "agents",
        "physics",
    ]
    assert summary_of(folder / "summary.json")["hash"] == undisturbed


@pytest.mark.soak
def test_a_dispatcher_resumed_elsewhere_plans_on_alike(tmp_path):
    """The policy `rolling` remembers what it has decided."""
    roads = {
        "rows": 6,
        "pickers": 3,
        "carriers": 2,
        "row_length": 20.0,
        "route": "two-way",
        "rows_to_pickers": "balanced-ends",
    }
    scenario = empty_orchard(**roads, dispatch="rolling")
    path = tmp_path / "summary.json"
    seconds = 200.0
    command = (
        scenario_file(tmp_path, scenario),
        "--hosts",
        1,
        "--speed",
        30,
        "--duration",
        seconds,
        "--record",
        "none",
        "--summary",
        path,
    )
    with running(*command) as run:
        wait_until_simulated(run, 20.0)
        process_of(run, "agents").kill()
        line_with("starting it again", run)
        wait_until_simulated(run, 150.0)
        psutil.Process(run.pid).terminate()
        printed = end(run)
    folder = re.search(r"To go on: .* --resume (\S+)", printed).group(1)
    for mode in ("local", "lockstep"):
        orchard(
            "--resume",
            folder,
            "--mode",
            mode,
            "--speed",
            30,
            "--duration",
            seconds,
            "--record",
            "none",
            "--summary",
            path,
        )
        assert summary_of(path)["hash"] == local_hash(scenario, round(10 * seconds))


def test_a_signal_that_run_py_has_not_sent_is_a_death_too(battered):
    """Exit codes 143 and 130 are 128 and the number of SIGTERM, 15, or SIGINT, 2."""
    for word in ("agents \\d", "logger", "physics"):
        assert re.search(rf"{word} ended with code 1(43|30); starting it again", battered[1]), (
            battered[1]
        )


def test_the_tables_of_a_run_that_is_killed_have_each_row_once(battered):
    rows = pq.read_table(battered[0] / "tables" / "bodies.parquet")
    bodies = lay_out(Scenario(rows=3)).names
    assert rows["tick"].to_pylist() == [
        tick for tick in range(1, round(SECONDS * 10) + 1) for _ in bodies
    ]
    assert rows["name"].to_pylist() == [*bodies] * round(SECONDS * 10)


def test_a_signal_to_all_stops_a_run_that_can_go_on(tmp_path, undisturbed):
    """All processes get a signal when a machine is shut down.

    tests/launch/test_run.py tests Ctrl-C.
    """
    path = tmp_path / "summary.json"
    with running(*PACE, "--speed", 5, "--record", "none", "--summary", path) as run:
        wait_until_simulated(run, 5.0)
        for process in [*psutil.Process(run.pid).children(), psutil.Process(run.pid)]:
            process.terminate()
        printed = end(run)
    assert "again" not in printed
    folder = re.search(r"To go on: .* --resume (\S+)", printed).group(1)
    # The newest snapshot is of the last tick: nothing is lost. 5 s of 50 ticks had passed.
    ticks = summary_of(path)["ticks"]
    kept = [int(path.stem.removeprefix("tick-")) for path in (ROOT / folder).glob("tick-*")]
    assert max(kept) == ticks
    assert ticks >= 50
    for mode in ("local", "lockstep"):
        orchard(
            "--resume",
            folder,
            "--mode",
            mode,
            "--duration",
            SECONDS,
            "--record",
            "none",
            "--summary",
            path,
        )
        assert summary_of(path)["hash"] == undisturbed


def test_ctrl_c_while_physics_does_not_listen_yet_ends_the_run():
    with starting(*PACE, "--record", "none") as run:
        physics = first_process(run, "physics")
        physics.suspend()
        first_process(run, "agents")
        run.send_signal(signal.SIGINT)
        printed, _ = run.communicate(timeout=PATIENCE)
        assert "Traceback" not in printed
        assert run.returncode in (1, 130), (
            "there was nothing to finish yet; 130 is what a shell shows while it is still loading"
        )
        assert not physics.is_running()


def test_a_run_that_can_never_begin_ends_and_names_what_it_lacks(tmp_path):
    """The class `Stillborn` of picker_01 ends its process with code 7 when it is made.

    The other host, which has picker_02, is well.
    """
    done = orchard(
        scenario_file(tmp_path, driven_by(picker_01="Stillborn")),
        "--hosts",
        2,
        "--record",
        "none",
        code=1,
    )
    assert re.search(
        r"agents \d ended with code 7, 5 times in a row; giving up on it; these stand: .*picker_01",
        done.stdout,
    )
    assert re.search(r"the run cannot begin without .*picker_01", done.stderr)
    assert "picker_02" not in done.stderr


@pytest.mark.soak
def test_robots_of_a_dying_process_stand_and_the_run_goes_on(tmp_path):
    """The class `Mortal` of picker_01 ends its process at tick 20, each time anew."""
    arguments = ("--hosts", 2, "--record", "none", "--duration", 40, "--patience", 3)
    path = tmp_path / "summary.json"
    done = orchard(
        scenario_file(tmp_path, driven_by(picker_01="Mortal")),
        *arguments,
        "--summary",
        path,
        code=1,
    )
    assert "broken: picker_01, its process died again and again" in done.stderr
    assert re.search("no answer to tick 20 from .*picker_01.*: no longer waited for", done.stdout)
    assert summary_of(path)["ticks"] == 400
