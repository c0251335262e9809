"""A process that dies is started again: at once, then ever later, and not for ever.

A fleet is the processes of one run, and the supervisor of run.py starts, watches and ends them.
Most tests are in virtual time, with pretended processes. A process refuses its options with the
exit code BAD_ORDER; it announces a good end on its lifeline.
"""

import io
import os
import subprocess
import sys
from queue import SimpleQueue
from time import monotonic
from types import SimpleNamespace
from typing import Any

import psutil
import pytest
from fleet import wait_for
from patience import PATIENCE
from recorded_messages import Clock
from rich.console import Console

from orchard.field.scenario import Scenario
from orchard.launch import follower
from orchard.launch.distributed import LaunchedRun
from orchard.launch.options import HarvestOptions
from orchard.launch.request import Credentials, RunRequest
from orchard.launch.supervisor import (
    BAD_ORDER,
    DEATHS,
    QUICK_SECONDS,
    REFUSALS,
    ProcessSpec,
    Supervisor,
    Watchdog,
    take_turns,
)
from orchard.launch.supervisor import SECONDS as FROZEN_SECONDS
from orchard.net.bus import Inbox
from orchard.net.ending import write_end
from orchard.report.progress import Progress
from orchard.server.options import RunOptions
from orchard.wire.keys import PHYSICS
from orchard.wire.messages import End

pytestmark = pytest.mark.processes


class Child:
    """A pretended process, and the lifeline to it."""

    def __init__(self, order):
        # Its options.
        self.order = order
        # Its exit code; None: it lives.
        self.returncode = None
        # The exit code that it has announced on the lifeline; None: none.
        self.code = None

    def poll(self):
        return self.returncode

    def die(self, code=-9):
        """End without a word."""
        self.returncode = code

    def end(self, code=0):
        """End by itself, and announce it."""
        self.returncode = self.code = code

    def let_go(self):
        """Close its lifeline, which this child does not heed."""


@pytest.fixture
def clock():
    return Clock()


class Watched(Supervisor):
    """A supervisor of pretended processes, which keeps what it says."""

    def __init__(self, clock):
        super().__init__(say=self._keep, clock=clock)
        self.said = []
        self.children = []

    def _keep(self, line):
        self.said.append(line)

    def _open(self, program, order):
        self.children.append(Child(order))
        return self.children[-1], self.children[-1]

    def _clear_up(self, running):
        """Do nothing: pretended processes leave nothing."""


@pytest.fixture
def fleet(clock):
    fleet = Watched(clock)
    fleet.start(
        ProcessSpec("agents 1", "orchard.processes.agents", [], again=True, agents=["picker_01"])
    )
    return fleet


def test_a_dead_process_starts_again_with_options_of_a_restart(fleet, clock):
    """Physics then goes on from a snapshot (`resume`)."""
    first = RunOptions(run="a")
    again = RunOptions(run="a", resume=True)
    fleet.start(
        ProcessSpec(PHYSICS, "orchard.processes.physics", first, again=True, afterwards=again)
    )
    clock.now += 60.0
    fleet.children[-1].die()
    fleet.watch()
    assert [child.order for child in fleet.children[1:]] == [first, again]
    assert fleet.said == ["physics ended with code -9; starting it again"]


def test_output_that_is_no_text_is_passed_on_and_blocks_no_child(tmp_path, monkeypatch):
    """A child prints 100 kB. If the fleet did not read it, the child would block for ever once its
    pipe is full, after 64 kB.
    """
    (tmp_path / "shouting.py").write_text(
        "import sys\nsys.stderr.buffer.write(b'\\xff\\n' + 20_000 * b'loud\\n' + b'shouting:"
        " over\\n')"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    lines = SimpleQueue()
    with Supervisor(lines.put) as fleet:
        fleet.start(ProcessSpec("child", "shouting", []))
        assert lines.get(timeout=PATIENCE) == r"child: \xff"
        wait_for(lines, lambda line: line == "child: over", 20.0)
        fleet.wait(PATIENCE)
        assert fleet.exit_code("child") == 0


def test_what_a_child_has_started_ends_with_it(tmp_path, monkeypatch):
    """A grandchild is ended when the child has died, and at the end of the fleet.

    Each child starts a program that sleeps, and prints its number. One dies at once, and the other
    waits.
    """
    program = (
        "import os, subprocess, sys\nchild = subprocess.Popen(['sleep', '600'])\nprint(child.pid,"
        " file=sys.stderr, flush=True)\n"
    )
    (tmp_path / "forking.py").write_text(
        program + "os._exit(7) if sys.argv[1:] else child.wait()\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    lines = SimpleQueue()
    with Supervisor(lines.put) as fleet:
        fleet.start(ProcessSpec("dies", "forking", ["now"], again=True))
        fleet.start(ProcessSpec("lives", "forking", []))
        forks = [psutil.Process(int(lines.get(timeout=PATIENCE).split()[1])) for _ in range(2)]
    _, alive = psutil.wait_procs(forks, 20.0)
    for fork in alive:
        fork.kill()
    assert alive == []


def launched_by(fleet, folder):
    """Return a run without processes, at an address where no router answers."""
    request = RunRequest(HarvestOptions(), Scenario(), None, folder)
    return LaunchedRun(
        request,
        Credentials(request.options),
        listen="tcp/127.0.0.1:9",
        supervisor=fleet,
        progress=Progress(Console(file=io.StringIO())),
    )


NEVER_BEGAN = "the run cannot begin without picker_01"


@pytest.mark.parametrize(
    ("why", "summary"),
    [("stopped", {"broken_agents": [], "ticks": 5}), (NEVER_BEGAN, None)],
    ids=["stopped", "never began"],
)
def test_a_result_that_physics_writes_late(fleet, tmp_path, monkeypatch, why, summary):
    """After Ctrl-C physics may write its result when the run is followed no more: it counts.

    A run that cannot begin keeps its reason, whatever physics writes when it is stopped.
    """
    launched = launched_by(fleet, tmp_path)
    files = []
    end = End(fleet.run, 5, False, "stopped", "0" * 64, {"broken_agents": [], "ticks": 5})

    def stop(seconds):
        write_end(end, str(files[0]))
        for child in fleet.children:
            child.end()

    monkeypatch.setattr(launched, "_start", files.append)
    monkeypatch.setattr(launched, "follow", lambda inbox: (None, why))
    monkeypatch.setattr(fleet, "stop", stop)
    assert launched.carry_out(Inbox()) == (summary, why)


@pytest.mark.parametrize(
    ("code", "words"),
    [(0, "its result is lost"), (BAD_ORDER, "could not start"), (-9, "ended with code -9")],
)
def test_why_physics_is_gone_is_told_in_words(fleet, tmp_path, code, words):
    """Physics that is killed counts as gone only while it is asked to end: else it starts again."""
    launched = launched_by(fleet, tmp_path)
    fleet.start(ProcessSpec(PHYSICS, "orchard.processes.physics", [], again=True, may_refuse=False))
    fleet.children[-1].end(code)
    fleet.terminate(PHYSICS)
    assert words in launched.follower.why_over(has_begun=True)


def test_physics_that_never_listens_is_told_with_its_time(fleet, tmp_path, monkeypatch):
    monkeypatch.setattr(follower, "BEGIN_SECONDS", 0.5)
    fleet.clock = monotonic
    fleet.start(ProcessSpec(PHYSICS, "orchard.processes.physics", [], again=True, may_refuse=False))
    summary, why = launched_by(fleet, tmp_path).follow(Inbox())
    assert summary is None
    assert (
        why == "tcp/127.0.0.1:9: physics does not listen 0.5 s after its start; is the machine too"
        " busy?"
    )


def test_no_process_starts_again_that_is_over_or_need_not_live(fleet):
    """The host ends by itself. The viewer dies, and is no process to start again (`again`)."""
    fleet.start(ProcessSpec("viewer", "rerun", []))
    fleet.children[0].end()
    fleet.children[1].die()
    fleet.watch()
    assert len(fleet.children) == 2


def test_a_process_with_a_written_result_is_not_started_again(fleet, tmp_path):
    """Whatever ends such a process, the run is over."""
    result = tmp_path / "result"
    fleet.start(ProcessSpec(PHYSICS, "orchard.processes.physics", [], again=True, result=result))
    fleet.children[-1].die()
    assert not fleet.is_over(PHYSICS)
    result.touch()
    assert fleet.is_over(PHYSICS)


@pytest.mark.parametrize("code", [0, 75, 100])
def test_an_end_that_was_not_announced_is_a_death(fleet, code):
    """An agent can end its process with code 0 by os._exit. Such a process is started again, unless
    it was asked to end.
    """
    fleet.children[0].die(code)
    fleet.watch()
    assert len(fleet.children) == 2
    fleet.terminate("agents 1")
    fleet.children[1].die(code=0)
    fleet.watch()
    assert len(fleet.children) == 2


def waits(fleet, clock, code=-9):
    """Let the last process die again. Return how long the fleet waits before it starts it, s."""
    fleet.children[-1].die(code)
    begun = clock.now
    count = len(fleet.children)
    while True:
        fleet.watch()
        if len(fleet.children) > count or fleet.given_up:
            return clock.now - begun
        clock.now += 0.125


def test_quick_deaths_wait_ever_longer_and_are_given_up(fleet, clock):
    """After the fifth death (DEATHS) the process is not started again, so there is no wait."""
    assert [waits(fleet, clock) for _ in range(DEATHS)] == [0.0, 0.25, 0.5, 1.0, 0.0]
    assert list(fleet.given_up) == ["agents 1"]
    assert "agents 1" in fleet.said[-1]
    assert "giving up on it; these stand: picker_01" in fleet.said[-1]
    fleet.watch()
    assert len(fleet.children) == DEATHS


def test_what_is_refused_may_pass_and_is_tried_for_half_a_minute(fleet, clock):
    assert sum(waits(fleet, clock, BAD_ORDER) for _ in range(REFUSALS - 1)) > 30.0
    assert not fleet.given_up
    waits(fleet, clock, BAD_ORDER)
    assert list(fleet.given_up) == ["agents 1"]


def test_a_process_that_refuses_at_first_is_not_started_again(fleet, clock):
    """Its options are wrong, so it would refuse them each time (`may_refuse=False`).

    A process that has worked before it refused is started again.
    """
    fleet.start(
        ProcessSpec("physics", "orchard.processes.physics", [], again=True, may_refuse=False)
    )
    fleet.children[-1].die(BAD_ORDER)
    fleet.watch()
    assert fleet.is_over("physics")
    fleet.start(
        ProcessSpec("physics", "orchard.processes.physics", [], again=True, may_refuse=False)
    )
    assert waits(fleet, clock) == 0.0
    assert waits(fleet, clock, BAD_ORDER) == 0.25


def test_deaths_that_are_far_apart_are_not_in_a_row(fleet, clock):
    for _ in range(3 * DEATHS):
        clock.now += QUICK_SECONDS
        assert waits(fleet, clock) == 0.0
    assert not fleet.given_up


@pytest.mark.skipif(not hasattr(os, "SCHED_BATCH"), reason="only Linux knows of it")
def test_processes_take_turns():
    """Under Linux's SCHED_BATCH a process that wakes up does not interrupt another one."""
    child = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    take_turns(child.pid)
    assert os.sched_getscheduler(child.pid) == os.SCHED_BATCH
    child.communicate(b"\n", timeout=PATIENCE)
    # A process that has ended takes no turn, and that is no mistake.
    take_turns(child.pid)


def test_a_process_is_ended_when_its_token_is_gone_too_long(clock):
    """The watchdog hears whether the liveliness token of the logger is there. A process that stays
    frozen without it for FROZEN_SECONDS is killed, so that it is started again as number 2.
    """
    fleet: Any = SimpleNamespace(clock=clock, number=1, killed=[])
    fleet.pid = lambda name: fleet.number
    fleet.kill = lambda name: fleet.killed.append(fleet.number)
    watchdog = Watchdog(fleet, "logger")
    watchdog.look()
    assert fleet.killed == [], "it has not been there yet"
    watchdog.hear(True)
    watchdog.hear(False)
    clock.now += FROZEN_SECONDS - 0.1
    watchdog.look()
    watchdog.hear(True)
    clock.now += FROZEN_SECONDS
    watchdog.look()
    assert fleet.killed == [], "it came back"
    watchdog.hear(False)
    clock.now += FROZEN_SECONDS
    watchdog.look()
    assert fleet.killed == [1]
    fleet.number = 2
    clock.now += 10 * FROZEN_SECONDS
    watchdog.look()
    assert fleet.killed == [1], "the next one starts"
    watchdog.end()
    assert fleet.killed == [1, 2], "a process that is away at the end is not waited for"
