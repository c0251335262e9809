"""Starts the processes of a run, restarts those that die or freeze, and stops them.

Each process is held by a line, its standard input (orchard/net/lifeline.py): it ends when this
program lets go of the line, and it writes its exit code there if it ends by itself.
"""

import math
import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from orchard.field.problems import printable
from orchard.net import lifeline
from orchard.net.endpoints import LOOPBACK, ONE_THREAD, RUNTIME, with_port
from orchard.net.lifeline import Line
from orchard.net.options import FROM_STDIN, ProcessOptions
from orchard.start_module import command_for
from orchard.terminal.open_files import allow_files
from orchard.view.files import window

QUICK_SECONDS = 10.0  # a process that lives shorter than this has died quickly
DEATHS = 5  # quick deaths in a row, after which a process is given up
# Exit code of a process that refuses its arguments, or what it finds, such as a port in use.
BAD_ORDER = 2
# Quick deaths in a row, after which a process that ends with BAD_ORDER is given up. It is more than
# DEATHS, because a port may be free again soon: with BACK_OFF that takes half a minute.
REFUSALS = 9
BACK_OFF = 0.25  # s before the second restart; twice as long before each further one
LONGEST_LINE = 2000  # characters of what a process says
# Lines that a process writes without its name, as C code or a traceback does, and that are shown.
MOST_LINES = 100
# Environment that turns off needless work of libraries at their import: a fifth of a start's time.
QUICK_START = {
    "OPENBLAS_NUM_THREADS": "1",  # threads for large matrices
    "PYDANTIC_DISABLE_PLUGINS": "__all__",  # a search through all installed packages
}
# Environment with which Zenoh hands messages to the thread that waits: ticks are quicker.
QUICK_TICKS = {RUNTIME: ONE_THREAD}
# Files that this program may have open at once, beside those for its processes. A run of three
# processes takes 33 in all; the rest is a reserve.
OWN_FILES = 56
# Files that this program has open for each of its processes.
FILES_OF_A_PROCESS = 3


@dataclass(frozen=True)
class ProcessSpec:
    """A process to start: a module, with arguments, or with options at its standard input."""

    name: str
    module: str
    order: Sequence[str] | ProcessOptions
    again: bool = False  # restart it when it dies
    afterwards: ProcessOptions | None = None  # the options of a restart, if they are others
    agents: Sequence[str] = ()  # the agents that it hosts
    # Whether it is restarted if it ends with BAD_ORDER at its first start.
    may_refuse: bool = True
    # A file that it writes when its work is done: then it is not restarted.
    result: Path | None = None


@dataclass
class _Running:
    """A process that was started and is not given up. It may have ended meanwhile."""

    program: ProcessSpec
    popen: subprocess.Popen[str]
    line: Line
    begun: float  # s, on the supervisor's clock
    deaths: int = 0  # quick deaths in a row
    # s, on the supervisor's clock: when it is restarted after its death; infinity: it has not died,
    # or its death has not been seen yet.
    due: float = math.inf
    # Whether it was asked to end.
    is_asked: bool = False

    def is_over(self) -> bool:
        """Whether it has ended and is not restarted.

        If it has ended, it is over if it was asked to end, has done its work, has refused its first
        start, or is not to be restarted at all. Else it has died.
        """
        code = self.popen.poll()
        is_refusal = code == BAD_ORDER and not self.deaths and not self.program.may_refuse
        result = self.program.result
        has_result = result is not None and result.exists()
        is_done = self.line.code == 0 or has_result
        return code is not None and (
            not self.program.again or self.is_asked or is_done or is_refusal
        )


@dataclass
class Supervisor(AbstractContextManager["Supervisor"]):
    """The processes of a run. At the end of its `with` statement all are stopped.

    `say` prints a line.
    """

    say: Callable[[str], None]
    run: str = ""  # the run's id
    # Name -> a process that was started, unless it is given up.
    running: dict[str, _Running] = field(default_factory=dict)
    clock: Callable[[], float] = time.monotonic
    # Name -> a process that died too often in a row, and is not restarted any more.
    given_up: dict[str, ProcessSpec] = field(default_factory=dict)

    def __exit__(self, *_: object) -> None:
        self.stop(0.0)

    def start(self, program: ProcessSpec) -> None:
        """Start a process. Raises OSError."""
        self.running[program.name] = _Running(
            program, *self._open(program, program.order), self.clock()
        )

    def _open(
        self, program: ProcessSpec, order: Sequence[str] | ProcessOptions
    ) -> tuple[subprocess.Popen[str], Line]:
        """Start a process in a process group of its own. Return it, and its line.

        So Ctrl-C reaches only this program, which stops the others in order. The process does not
        get a session of its own, because Linux shares the processor among sessions first: that
        costs an eighth of the ticks.
        """
        environment = QUICK_START | QUICK_TICKS | os.environ | lifeline.environment(self.run)
        arguments = [FROM_STDIN] if isinstance(order, ProcessOptions) else order
        line = Line()
        popen = subprocess.Popen(
            command_for(program.module, arguments),
            env=environment,
            stdin=line.of_process.fileno(),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            errors="backslashreplace",
            process_group=0,
        )
        line.of_process.close()
        take_turns(popen.pid)
        # They go over the line. A file with them might be gone when the process is restarted.
        if isinstance(order, ProcessOptions):
            line.write(msgspec.json.encode(order).decode())
        threading.Thread(target=self._pass_on, args=(program, popen), daemon=True).start()
        return popen, line

    def _pass_on(self, program: ProcessSpec, popen: subprocess.Popen[str]) -> None:
        """Say each line that a process writes to stderr, until it ends.

        Its log begins each line with the name of its module. Of lines without it, which C code or a
        traceback writes, only the first MOST_LINES are said.
        """
        assert popen.stderr is not None
        prefix = f"{program.module.rpartition('.')[2]}: "
        unnamed_count = 0
        with popen.stderr as lines:
            for line in lines:
                is_named = line.startswith(prefix)
                unnamed_count += not is_named
                if is_named or unnamed_count <= MOST_LINES:
                    text = printable(line.rstrip().removeprefix(prefix), LONGEST_LINE)
                    self.say(f"{program.name}: {text}")
                elif unnamed_count == MOST_LINES + 1:
                    self.say(f"{program.name}: more of this is left out")

    @property
    def lost_agents(self) -> list[str]:
        """The agents of the processes that are given up."""
        agents: list[str] = []
        for program in self.given_up.values():
            agents += program.agents
        return agents

    def exit_code(self, name: str) -> int | None:
        """Return the exit code of a process; None while it runs, or if it was never started."""
        if name not in self.running:
            return None
        return self.running[name].popen.poll()

    def is_running(self, name: str) -> bool:
        """Whether a process was started and has not ended."""
        return name in self.running and self.exit_code(name) is None

    def is_over(self, name: str) -> bool:
        """Whether a process has ended and is not restarted."""
        return name in self.running and self.running[name].is_over()

    def is_any_left(self) -> bool:
        """Whether some process runs."""
        return any(running.popen.poll() is None for running in self.running.values())

    def has_refused(self) -> bool:
        """Whether some process has refused what it was told to do."""
        return any(running.line.code == BAD_ORDER for running in self.running.values())

    def watch(self) -> None:
        """Restart what has died: at once, then later and later, until it is given up."""
        for name, running in list(self.running.items()):
            program = running.program
            code = running.popen.poll()
            if code is None or running.is_over():
                continue
            if running.due == math.inf:
                self._count_death(running, code)
            if self.clock() >= running.due:
                popen, line = self._open(program, program.afterwards or program.order)
                self.running[name] = _Running(program, popen, line, self.clock(), running.deaths)

    def _count_death(self, running: _Running, code: int) -> None:
        """Set when a process is restarted that has died, or give it up."""
        name = running.program.name
        now = self.clock()
        self._clear_up(running)
        is_quick = now - running.begun < QUICK_SECONDS
        if not is_quick:
            running.deaths = 0
        running.deaths += 1
        most_deaths = DEATHS
        if code == BAD_ORDER:
            most_deaths = REFUSALS
        if running.deaths < most_deaths:
            running.due = now
            if running.deaths > 1:
                running.due += BACK_OFF * 2 ** (running.deaths - 2)
            self.say(f"{name} ended with code {code}; starting it again")
            return
        agents = ", ".join(running.program.agents)
        consequence = f"; these stand: {agents}" if agents else ""
        self.say(
            f"{name} ended with code {code}, {running.deaths} times in a row; "
            f"giving up on it{consequence}"
        )
        self.given_up[name] = self.running.pop(name).program

    def pid(self, name: str) -> int | None:
        """Return the id of a process; None if it was never started."""
        if name not in self.running:
            return None
        return self.running[name].popen.pid

    def terminate(self, *names: str) -> None:
        """Ask processes to end, if they run: let go of their lines."""
        for name in names:
            if name in self.running:
                self.running[name].is_asked = True
                self.running[name].line.let_go()

    def kill(self, name: str) -> None:
        """Kill a process, if it was started."""
        if name in self.running:
            self.running[name].popen.kill()

    def wait(self, seconds: float) -> None:
        """Wait until all processes have ended, at most `seconds`."""
        deadline = self.clock() + seconds
        with suppress(subprocess.TimeoutExpired):
            for running in self.running.values():
                running.popen.wait(max(0.0, deadline - self.clock()))

    def stop(self, seconds: float) -> None:
        """Ask all processes to end, and kill those that have not ended after `seconds`."""
        self.terminate(*self.running)
        self.wait(seconds)
        for running in self.running.values():
            running.popen.kill()
            running.popen.wait()
            self._clear_up(running)

    def _clear_up(self, running: _Running) -> None:
        """Close the line of a process, and kill its group.

        What an agent has started must not outlive it.
        """
        running.line.close()
        with suppress(ProcessLookupError):
            os.killpg(running.popen.pid, signal.SIGKILL)


def take_turns(pid: int) -> None:
    """Ask the system that a process which wakes up does not interrupt the process `pid`.

    So its memory stays in the processor's caches, and a run has 6 to 10 % more ticks.
    """
    # Only Linux has this policy, and the process may have ended.
    with suppress(AttributeError, ProcessLookupError):
        os.sched_setscheduler(pid, os.SCHED_BATCH, os.sched_param(0))


def allow_processes(number: int) -> None:
    """Let this program open as many files as a run of so many processes needs.

    Raises ValueError if the system does not allow it.
    """
    needed = OWN_FILES + FILES_OF_A_PROCESS * number
    allow_files(needed, f"{number} processes need", ", and --mode local needs fewer")


def free_port() -> int:
    """Return a TCP port of the loopback that was free a moment ago."""
    return int(with_port(LOOPBACK).rpartition(":")[2])


def open_viewer(uri: str) -> subprocess.Popen[bytes]:
    """Open Rerun's window, which stays when this process has ended. Return its process.

    Raises OSError without a viewer or a screen.
    """
    return subprocess.Popen(window(uri), start_new_session=True)


def let_go(
    viewer: subprocess.Popen[bytes] | None, is_stopped: bool, say: Callable[[str], None]
) -> None:
    """Leave a viewer when its run is over, or end it with a run that was stopped.

    Say so if it has died.
    """
    if viewer is None:
        return
    code = viewer.poll()
    if code:
        say(f"the viewer has ended with exit code {code}")
    elif is_stopped:
        viewer.terminate()


# s that a token may be gone: a session that was only cut off returns sooner.
SECONDS = 3.0


class Watchdog:
    """Kills a frozen process, so that the supervisor restarts it.

    A process is frozen if it had a liveliness token that is gone for SECONDS. Two cases do not
    count: before its first token a process is still starting, and without physics, which relays
    all tokens, none is there.
    """

    def __init__(self, supervisor: Supervisor, name: str) -> None:
        """`name`: of the process."""
        self._supervisor = supervisor
        self._name = name
        self._clock = supervisor.clock
        # The id of the process that had the token last; None: it had none, or has been killed.
        self._pid_of_token: int | None = None
        # s, on the clock, since when the token is gone; None while it is there.
        self._gone_since: float | None = 0.0
        self._has_physics = True

    def hear(self, up: bool) -> None:
        """Record that the token of the process appeared or disappeared."""
        if up:
            self._gone_since = None
            self._pid_of_token = self._supervisor.pid(self._name)
        else:
            self._gone_since = self._clock()

    def hear_of_physics(self, up: bool) -> None:
        """Record that physics, which relays all tokens, appeared or disappeared."""
        self._has_physics = up
        if self._gone_since is not None:
            self._gone_since = self._clock()

    def look(self) -> None:
        """Kill the process if it is frozen. It is killed once, until it has a token again."""
        is_known = self._pid_of_token is not None and self._pid_of_token == self._supervisor.pid(
            self._name
        )
        if is_known and self._is_frozen():
            self._pid_of_token = None
            self._supervisor.kill(self._name)

    def _is_frozen(self) -> bool:
        """Whether the token is gone for so long that no lost link explains it."""
        if self._gone_since is None or not self._has_physics:
            return False
        return self._clock() - self._gone_since >= SECONDS

    def end(self) -> None:
        """Kill the process if its token is gone: the run is over, and does not wait for it."""
        if self._gone_since is not None:
            self._supervisor.kill(self._name)
