"""What run.py does about a run of many processes: which end counts, for which processes it waits
then, which snapshots it takes.

run.py follows a run as a session of its own (orchard/launch/follower.py). Physics tells the end of
a run with the summary; it counts once the liveliness token of physics is gone, too.
"""

import io
import signal
from contextlib import ExitStack, nullcontext
from pathlib import Path
from time import monotonic, sleep
from types import SimpleNamespace
from typing import ClassVar

import msgspec
import pytest
from command_line import orchard, running, scenario_file
from local_runs import SMALL
from patience import PATIENCE
from rich.console import Console
from run_endings import harvested

from orchard.contract.messages import pack
from orchard.folders import runs_folder
from orchard.launch import follower, hosts
from orchard.launch.supervisor import ProcessSpec, Supervisor, Watchdog
from orchard.net.bus import Alive, Inbox, Sample, Signal
from orchard.net.ending import Ending
from orchard.net.endpoints import BusError
from orchard.net.refusals import Refused
from orchard.report.progress import Progress
from orchard.server.snapshots import sole_writer
from orchard.sim.snapshot import SnapshotError
from orchard.wire.keys import LOGGER, PHYSICS, Keys
from orchard.wire.messages import End

# A process that does not heed the signal that asks it to end.
DEAF = """\
import signal, sys, time
signal.signal(signal.SIGTERM, signal.SIG_IGN)
print("deaf", file=sys.stderr, flush=True)
time.sleep(600)
"""
PROGRESS = Progress(Console(file=io.StringIO()))
SUMMARY = msgspec.to_builtins(harvested())


TOKEN = Keys().of("physics", "run1", "a1")


def an_end(**summary):
    """Return the message that a run is over."""
    return Sample("orchard/end", pack(End("run1", 5, True, "harvested", "0" * 64, summary)))


def test_an_end_that_says_nothing_of_the_run_is_refused():
    with pytest.raises(Refused, match="malformed"):
        follower._hear(an_end(), "run1", PROGRESS)
    with pytest.raises(Refused, match="malformed"):
        follower._hear(an_end(**SUMMARY | {"ticks": "many"}), "run1", PROGRESS)
    assert follower._hear(an_end(**SUMMARY), "run1", PROGRESS).why == "harvested"


def test_an_end_is_believed_only_while_physics_goes():
    """The message and the loss of the token may come in either order, but must come together."""
    now = [0.0]
    end = End("run1", 5, True, "harvested", "0" * 64, {})
    for first, second in (("hear", "track"), ("track", "hear")):
        ending = Ending(lambda: now[0])
        heard = {
            "hear": lambda ending=ending: ending.hear(end),
            "track": lambda ending=ending: ending.track(TOKEN, False),
        }
        heard[first]()
        assert ending.end is None
        heard[second]()
        assert ending.end == end
    ending.track(TOKEN, True)
    assert ending.end is None, "it is back"
    now[0] = 60.0
    ending.track(TOKEN, False)
    assert ending.end is None, "that was long ago: physics was killed"


@pytest.fixture
def deaf(tmp_path, monkeypatch):
    """Give a fleet with a process that heeds no request to end, and what the fleet says."""
    (tmp_path / "deaf.py").write_text(DEAF)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    lines = []
    begun = []

    def keep(line: str) -> None:
        if line.endswith("deaf"):
            begun.append(line)
        else:
            lines.append(line)

    with Supervisor(keep) as fleet:
        fleet.start(ProcessSpec("agents 1", "deaf", []))
        while not begun:
            assert fleet.exit_code("agents 1") is None, lines
            sleep(0.01)
        yield fleet, lines


def test_an_agent_that_thinks_on_after_the_end_is_not_waited_for(deaf, monkeypatch):
    monkeypatch.setattr(hosts, "THINK_SECONDS", 0.0)
    fleet, lines = deaf
    hosts.await_exits(fleet, ["agents 1"], Inbox(), 60.0)
    assert fleet.exit_code("agents 1") == -signal.SIGKILL
    assert lines[0].startswith("agents 1 has not ended 0 s after the run, and is ended by force")


def test_ctrl_c_ends_the_wait_for_processes_that_go_on(deaf, monkeypatch):
    monkeypatch.setattr(hosts, "STOP_SECONDS", 0.0)
    fleet, lines = deaf
    inbox = Inbox()
    inbox.put(Signal(signal.SIGINT))
    hosts.await_exits(fleet, ["agents 1"], inbox, 60.0)
    assert fleet.exit_code("agents 1") == -signal.SIGKILL
    assert lines == []


class Loading:
    """A supervisor whose physics process still loads its modules."""

    given_up: ClassVar[dict] = {}
    run = "run1"
    clock = staticmethod(monotonic)

    def __init__(self):
        self.asked_to_end = []

    def terminate(self, name):
        self.asked_to_end.append(name)

    def watch(self):
        pass

    def exit_code(self, name):
        return None

    def is_over(self, name):
        return bool(self.asked_to_end)


def loading(supervisor, connect=None):
    """Return what follows a run of which physics still loads its modules."""
    return follower.RunFollower(
        endpoint="tcp/127.0.0.1:1",
        snapshots=Path("snapshots"),
        supervisor=supervisor,
        watchdog=Watchdog(supervisor, LOGGER),
        progress=PROGRESS,
        connect=connect,
    )


@pytest.mark.parametrize(
    ("signals", "ended"),
    [(1, "stopped: tick 0"), (2, "stopped")],
    ids=["Ctrl-C", "Ctrl-C twice"],
)
def test_the_summary_of_a_run_stopped_early_is_waited_for(monkeypatch, signals, ended):
    """The run is stopped before its first tick. A second Ctrl-C waits for no summary."""
    monkeypatch.setattr(follower, "STOP_SECONDS", 0.0)
    supervisor = Loading()
    following = loading(supervisor)
    keys = Keys()
    inbox = Inbox()
    summary = SUMMARY | {"ticks": 0, "ended": "stopped"}
    end = Sample("orchard/end", pack(End("run1", 0, False, "stopped: tick 0", "0" * 64, summary)))
    for item in [*[Signal(signal.SIGINT)] * signals, end, Alive(TOKEN, False)]:
        inbox.put(item)
    assert following._listen(SimpleNamespace(inbox=inbox), keys) == (
        summary if signals == 1 else None,
        ended,
    )
    assert supervisor.asked_to_end == [PHYSICS] * signals


@pytest.mark.parametrize(
    ("signals", "is_reached"), [(1, True), (2, False)], ids=["Ctrl-C", "Ctrl-C twice"]
)
def test_a_run_stopped_before_physics_listens_is_stopped(signals, is_reached):
    """Physics listens at the third try. After one Ctrl-C run.py waits for that, and then tells
    physics to stop: the signal is still in the inbox.
    """
    inbox = Inbox()
    tries = []

    def connect(*_):
        tries.append(len(tries))
        if len(tries) <= 2:
            raise BusError("nothing listens")
        return nullcontext("a session")

    for _ in range(signals):
        inbox.put(Signal(signal.SIGINT))
    assert loading(Loading(), connect)._reach(inbox, ExitStack()) == (
        "a session" if is_reached else None
    )
    assert len(inbox) == is_reached, "it is told to physics next"


def test_only_one_run_keeps_snapshots_in_a_folder(tmp_path):
    """A second one is refused until the first has ended. Another folder, or none, is free."""
    folder = tmp_path / "one.snapshots"
    with sole_writer(folder):
        with (
            pytest.raises(
                SnapshotError, match=r"one.snapshots: the run of these snapshots is still active"
            ),
            sole_writer(folder),
        ):
            pass
        with sole_writer(tmp_path / "other.snapshots"), sole_writer(None):
            pass
    with sole_writer(folder):
        pass


@pytest.mark.parametrize("mode", ["local", "lockstep"])
def test_a_run_that_goes_on_is_not_gone_on_with_a_second_time(tmp_path, mode):
    with running(
        scenario_file(tmp_path, SMALL),
        "--mode",
        mode,
        "--hosts",
        1,
        "--speed",
        5,
        "--duration",
        60,
        "--record",
        "none",
    ) as run:
        (folder,) = runs_folder().glob(f"*-{run.pid}.snapshots")
        again = orchard("--resume", folder, "--record", "none", code=2)
        assert "the run of these snapshots is still active; stop it first" in again.stderr
        run.send_signal(signal.SIGINT)
        printed, _ = run.communicate(timeout=PATIENCE)
    assert run.returncode == 0, printed
