"""Starts the processes of a run, starts them again when they die or freeze, and stops them."""

import math
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from orchard.view.program import window

ROOT = Path(__file__).parents[2]
QUICK_SECONDS = 10.0  # who lives shorter than this has died quickly
DEATHS = 5  # quick ones in a row, after which a process is given up
BACK_OFF = 0.25  # s before the second start again, and twice as long before each further one
QUICK_START = {  # what libraries do when they are loaded and nobody here needs; a fifth of the processor time of a process' start
    "OPENBLAS_NUM_THREADS": "1",  # threads for large matrices
    "PYDANTIC_DISABLE_PLUGINS": "__all__",  # a search through all installed packages
}
QUICK_TICKS = {  # what arrives is handled by the thread that waits for it, instead of waking two others
    "ZENOH_RUNTIME": "(rx: (handover: app), acc: (handover: app))",
}


@dataclass(frozen=True)
class ProcessSpec:
    """One line of the table."""

    name: str
    module: str
    arguments: Sequence[str]
    again: bool = False  # start it again when it dies
    afterwards: Sequence[str] = ()  # further arguments when it is started again
    final: Sequence[int] = (0,)  # exit codes with which it ends by itself, and for good
    agents: Sequence[str] = ()  # whom it hosts


@dataclass
class _Running:
    program: ProcessSpec
    popen: subprocess.Popen[str]
    begun: float  # on the clock
    deaths: int = 0  # quick ones in a row
    due: float = math.inf  # on the clock: when it is started again

    def is_dead(self) -> bool:
        """Whether it has ended although it should not have, and shall be started again."""
        return self.program.again and self.popen.poll() not in (None, *self.program.final)

    def mourn(self, now: float) -> None:
        """Count a death, and settle when it is started again."""
        self.deaths = self.deaths + 1 if now - self.begun < QUICK_SECONDS else 1
        self.due = now + (BACK_OFF * 2 ** (self.deaths - 2) if self.deaths > 1 else 0.0)


@dataclass
class Supervisor:
    """All processes of a run; use it with `with`, and none is left behind."""

    say: Callable[[str], None]
    running: dict[str, _Running] = field(default_factory=dict)
    clock: Callable[[], float] = time.monotonic
    given_up: dict[str, ProcessSpec] = field(default_factory=dict)  # what died again and again, by name

    def __enter__(self) -> "Supervisor":
        return self

    def __exit__(self, *_: object) -> None:
        self.stop(0.0)

    def start(self, program: ProcessSpec) -> None:
        self.running[program.name] = _Running(program, self._open(program, program.arguments), self.clock())

    def _open(self, program: ProcessSpec, arguments: Sequence[str]) -> subprocess.Popen[str]:
        """A process group of its own, so that Ctrl-C reaches run.py alone, which stops the others in order.

        No session of its own: Linux shares a machine out among sessions first, which costs those that work together an eighth of
        their ticks.
        """
        command = [sys.executable, "-m", program.module, *arguments]
        null, pipe = subprocess.DEVNULL, subprocess.PIPE
        popen = subprocess.Popen(
            command, cwd=ROOT, env=_environment(), stdin=null, stdout=null, stderr=pipe,
            text=True, errors="backslashreplace", process_group=0,
        )  # fmt: skip
        take_turns(popen.pid)
        threading.Thread(target=self._pass_on, args=(program, popen), daemon=True).start()
        return popen

    def _pass_on(self, program: ProcessSpec, popen: subprocess.Popen[str]) -> None:
        """What a process says, with its name in place of its module's."""
        assert popen.stderr is not None
        module = program.module.rpartition(".")[2]
        with popen.stderr as lines:
            for line in lines:
                self.say(f"{program.name}: {line.rstrip().removeprefix(f'{module}: ')}")

    def exit_code(self, name: str) -> int | None:
        """None while a process runs, or was never started."""
        return self.running[name].popen.poll() if name in self.running else None

    def exit_codes(self) -> list[int | None]:
        """Of all; None of one that runs."""
        return [running.popen.poll() for running in self.running.values()]

    def goes_on(self) -> bool:
        """Whether any of them runs."""
        return None in self.exit_codes()

    def watch(self) -> None:
        """Start again what has died: at once, and then ever later. What dies quickly again and again is given up."""
        for name, running in list(self.running.items()):
            if not running.is_dead():
                continue
            if running.due == math.inf:
                self._mourn(name, running)
            if self.clock() >= running.due:
                program = running.program
                popen = self._open(program, [*program.arguments, *program.afterwards])
                self.running[name] = _Running(program, popen, self.clock(), running.deaths)

    def _mourn(self, name: str, running: _Running) -> None:
        running.mourn(self.clock())
        code = running.popen.returncode
        if running.deaths < DEATHS:
            self.say(f"{name} ended with code {code}; starting it again")
            return
        standing = f"; these stand: {', '.join(running.program.agents)}" if running.program.agents else ""
        self.say(f"{name} ended with code {code}, {DEATHS} times in a row; giving up on it{standing}")
        self.given_up[name] = running.program
        del self.running[name]
        running.due = math.inf

    def terminate(self, name: str) -> None:
        if name in self.running and self.running[name].popen.poll() is None:
            self.running[name].popen.terminate()

    def terminate_all(self) -> None:
        for name in self.running:
            self.terminate(name)

    def pid(self, name: str) -> int | None:
        return self.running[name].popen.pid if name in self.running else None

    def kill(self, name: str) -> None:
        """End it by force, also when it is frozen."""
        if name in self.running:
            self.running[name].popen.kill()

    def wait(self, seconds: float) -> None:
        """Until all have ended by themselves, but not longer."""
        deadline = time.monotonic() + seconds
        for running in self.running.values():
            try:
                running.popen.wait(max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                return

    def stop(self, seconds: float) -> None:
        """Ask all to end, and end by force those that do not in time."""
        self.terminate_all()
        self.wait(seconds)
        for running in self.running.values():
            if running.popen.poll() is None:
                running.popen.kill()
            running.popen.wait()


def take_turns(pid: int) -> None:
    """Let a process that has just begun finish what it does before the next one runs, instead of being interrupted by whoever wakes up.

    Each finds its memory in the caches for longer: 6 to 10 % more ticks on two cores, with two agent processes and with one for each agent.
    """
    with suppress(AttributeError, ProcessLookupError):  # only Linux knows of it; the process may have ended
        os.sched_setscheduler(pid, os.SCHED_BATCH, os.sched_param(0))


def _environment() -> dict[str, str]:
    """In which also modules of the user's present directory are found."""
    paths = [os.environ.get("PYTHONPATH", ""), os.getcwd()]
    return QUICK_START | QUICK_TICKS | os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))}


def free_port() -> int:
    """A TCP port of the loopback that was free a moment ago."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def open_viewer(what: str) -> subprocess.Popen[bytes]:
    """Rerun's own window, which stays when this process has ended; what is given is the viewer itself, to be ended by `terminate`."""
    return subprocess.Popen(window(what), start_new_session=True)


SECONDS = 3.0  # for which a token may be gone: a session that was cut off comes back sooner


class Watchdog:
    """Watches one process of a supervisor by its token. A process that has never been there yet is given all the time that it needs."""

    def __init__(self, supervisor: Supervisor, name: str, clock: Callable[[], float] = time.monotonic) -> None:
        self._fleet, self._name, self._clock = supervisor, name, clock
        self._known: int | None = None  # the process whose token this is
        self._gone: float | None = 0.0  # since when it is gone; None while it is there
        self._is_known = True  # whether anybody could know: without physics all tokens are gone

    def hear(self, up: bool) -> None:
        """The token came or went."""
        self._gone = None if up else self._clock()
        if up:
            self._known = self._fleet.pid(self._name)

    def hear_of_physics(self, up: bool) -> None:
        """Physics, through which all tokens are heard of, came or went."""
        self._is_known = up
        if self._gone is not None:
            self._gone = self._clock()

    def look(self) -> None:
        """End the process if it is time."""
        is_frozen = self._is_known and self._gone is not None and self._clock() - self._gone >= SECONDS
        if is_frozen and self._known is not None and self._known == self._fleet.pid(self._name):
            self._known = None
            self._fleet.kill(self._name)

    def end(self) -> None:
        """The run is over: who is away now is not waited for."""
        if self._gone is not None:
            self._fleet.kill(self._name)
