"""Starts the processes of a run, restarts those that die or freeze, and stops them."""

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
BAD_ORDER = 2  # exit code of a process that refuses its arguments, or what it finds: a port may be free again soon
REFUSALS = 9  # quick deaths in a row, after which a process is given up that ends with this code: half a minute
BACK_OFF = 0.25  # s before the second restart; twice as long before each further one
LONGEST_LINE = 2000  # characters of what a process says
MOST_LINES = (
    100  # that a process writes without its name, as C code or a traceback does, and that are shown
)
QUICK_START = {  # turns off needless work of libraries at their import: a fifth of a start's processor time
    "OPENBLAS_NUM_THREADS": "1",  # threads for large matrices
    "PYDANTIC_DISABLE_PLUGINS": "__all__",  # a search through all installed packages
}
QUICK_TICKS = {RUNTIME: ONE_THREAD}
# Files that this program may have open at once, beside those for its processes: a run of three
# processes takes 33 in all.
OWN_FILES = 56
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
    may_refuse: bool = (
        True  # False: if it ends with BAD_ORDER at its first start, it is not restarted
    )
    result: Path | None = (
        None  # a file that it writes when its work is done: then it is not restarted
    )


@dataclass
class _Running:
    program: ProcessSpec
    popen: subprocess.Popen[str]
    line: Line
    begun: float  # s, on the supervisor's clock
    deaths: int = 0  # quick deaths in a row
    due: float = math.inf  # s, on the supervisor's clock: the time of its restart
    is_asked: bool = False  # to end

    def is_over(self) -> bool:
        """Whether it has ended and is not restarted: an end that nothing has announced is a death."""
        code = self.popen.poll()
        is_refusal = code == BAD_ORDER and not self.deaths and not self.program.may_refuse
        is_done = self.line.code == 0 or (
            self.program.result is not None and self.program.result.exists()
        )
        return code is not None and (
            not self.program.again or self.is_asked or is_done or is_refusal
        )


@dataclass
class Supervisor(AbstractContextManager["Supervisor"]):
    """The processes of a run. At the end of its `with` statement all are stopped. `say` prints a line."""

    say: Callable[[str], None]
    run: str = ""  # the run's id
    running: dict[str, _Running] = field(default_factory=dict)
    clock: Callable[[], float] = time.monotonic
    given_up: dict[str, ProcessSpec] = field(
        default_factory=dict
    )  # name -> a process that died DEATHS times in a row

    def __exit__(self, *_: object) -> None:
        self.stop(0.0)

    def start(self, program: ProcessSpec) -> None:
        self.running[program.name] = _Running(
            program, *self._open(program, program.order), self.clock()
        )

    def _open(
        self, program: ProcessSpec, order: Sequence[str] | ProcessOptions
    ) -> tuple[subprocess.Popen[str], Line]:
        """Start a process in its own process group: Ctrl-C reaches only run.py, which stops the others in order.

        It has no session of its own: Linux shares the processor among sessions first, which costs an eighth of the ticks.
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
        if isinstance(
            order, ProcessOptions
        ):  # not in a file, which may be gone when it is restarted
            line.write(msgspec.json.encode(order).decode())
        threading.Thread(target=self._pass_on, args=(program, popen), daemon=True).start()
        return popen, line

    def _pass_on(self, program: ProcessSpec, popen: subprocess.Popen[str]) -> None:
        assert popen.stderr is not None
        name, unnamed = f"{program.module.rpartition('.')[2]}: ", 0
        with popen.stderr as lines:
            for line in lines:
                unnamed += not line.startswith(name)
                if line.startswith(name) or unnamed <= MOST_LINES:
                    self.say(
                        f"{program.name}: {printable(line.rstrip().removeprefix(name), LONGEST_LINE)}"
                    )
                elif unnamed == MOST_LINES + 1:
                    self.say(f"{program.name}: more of this is left out")

    @property
    def lost_agents(self) -> list[str]:
        return [agent for program in self.given_up.values() for agent in program.agents]

    def exit_code(self, name: str) -> int | None:
        """Return the exit code of a process; None while it runs, or if it was never started."""
        return self.running[name].popen.poll() if name in self.running else None

    def is_over(self, name: str) -> bool:
        return name in self.running and self.running[name].is_over()

    def is_any_left(self) -> bool:
        return any(running.popen.poll() is None for running in self.running.values())

    def has_refused(self) -> bool:
        return any(running.line.code == BAD_ORDER for running in self.running.values())

    def watch(self) -> None:
        """Restart what has died: at once, then later and later, and not after DEATHS quick deaths."""
        for name, running in list(self.running.items()):
            program, code = running.program, running.popen.poll()
            if code is None or running.is_over():
                continue
            if running.due == math.inf:
                self._count_death(running, code)
            if self.clock() >= running.due:
                opened = self._open(program, program.afterwards or program.order)
                self.running[name] = _Running(program, *opened, self.clock(), running.deaths)

    def _count_death(self, running: _Running, code: int) -> None:
        program, now = running.program, self.clock()
        self._clear_up(running)
        running.deaths = running.deaths + 1 if now - running.begun < QUICK_SECONDS else 1
        if running.deaths < (REFUSALS if code == BAD_ORDER else DEATHS):
            running.due = now + (
                BACK_OFF * 2 ** (running.deaths - 2) if running.deaths > 1 else 0.0
            )
            self.say(f"{program.name} ended with code {code}; starting it again")
        else:
            stands = f"; these stand: {', '.join(program.agents)}" if program.agents else ""
            self.say(
                f"{program.name} ended with code {code}, {running.deaths} times in a row; giving up on it{stands}"
            )
            self.given_up[program.name] = self.running.pop(program.name).program

    def pid(self, name: str) -> int | None:
        return self.running[name].popen.pid if name in self.running else None

    def terminate(self, *names: str) -> None:
        """Ask processes to end, if they run: let go of their lines."""
        for name in names:
            if name in self.running:
                self.running[name].is_asked = True
                self.running[name].line.let_go()

    def kill(self, name: str) -> None:
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
        """Close the line of a process, and kill its group: what an agent has started must not outlive it."""
        running.line.close()
        with suppress(ProcessLookupError):
            os.killpg(running.popen.pid, signal.SIGKILL)


def take_turns(pid: int) -> None:
    """Let no process that wakes up interrupt this one: 6 to 10 % more ticks, as its memory stays in the caches."""
    with suppress(
        AttributeError, ProcessLookupError
    ):  # only Linux has this policy; the process may have ended
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


def open_viewer(what: str) -> subprocess.Popen[bytes]:
    """Open Rerun's window, which stays when this process has ended. Return its process, which `terminate` ends."""
    return subprocess.Popen(window(what), start_new_session=True)


def let_go(
    viewer: subprocess.Popen[bytes] | None, is_stopped: bool, say: Callable[[str], None]
) -> None:
    """Leave a viewer when its run is over, or end it with a run that was stopped. Say so if it has died."""
    if viewer is not None and (code := viewer.poll()):
        say(f"the viewer has ended with exit code {code}")
    elif viewer is not None and is_stopped:
        viewer.terminate()


SECONDS = 3.0  # that a token may be gone: a session that was cut off returns sooner


class Watchdog:
    """Kills a frozen process: one whose liveliness token is gone for SECONDS. Before its first token it starts."""

    def __init__(self, supervisor: Supervisor, name: str) -> None:
        self._supervisor, self._name, self._clock = supervisor, name, supervisor.clock
        self._known: int | None = None  # the id of the process that had the token last
        self._gone: float | None = (
            0.0  # s, on the clock, since when the token is gone; None while it is there
        )
        self._is_known = True  # whether physics is there: without it all tokens are gone

    def hear(self, up: bool) -> None:
        self._gone = None if up else self._clock()
        if up:
            self._known = self._supervisor.pid(self._name)

    def hear_of_physics(self, up: bool) -> None:
        """Record that physics, which relays all tokens, appeared or disappeared."""
        self._is_known = up
        if self._gone is not None:
            self._gone = self._clock()

    def look(self) -> None:
        is_frozen = (
            self._is_known and self._gone is not None and self._clock() - self._gone >= SECONDS
        )
        if (
            is_frozen
            and self._known is not None
            and self._known == self._supervisor.pid(self._name)
        ):
            self._known = None
            self._supervisor.kill(self._name)

    def end(self) -> None:
        """Kill the process if its token is gone: the run is over, and does not wait for it."""
        if self._gone is not None:
            self._supervisor.kill(self._name)
