"""The processes of a run as tasks, started and restarted by the rules of the real supervisor.

Each process runs its real code (`BODIES`), with a session of the simulated network and a disk in
virtual time. `World` has all that one schedule needs.
"""

import logging
import os
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field
from errno import ENOSPC
from math import inf
from pathlib import Path
from random import Random
from signal import SIGTERM
from subprocess import TimeoutExpired
from typing import Any
from unittest.mock import patch

import msgspec

from chaos.simulated.bare_client import BARE_CLIENT, NAMES, own_agent
from chaos.simulated.begin import wrong_begin
from chaos.simulated.clients import RUN
from chaos.simulated.disk import SimulatedDisk
from chaos.simulated.half import takes_half
from chaos.simulated.network import Network
from chaos.simulated.observer import Observer
from chaos.simulated.scheduler import Scheduler, Task, VirtualInbox
from chaos.simulated.session import SimulatedBus
from orchard.field.problems import ScenarioError
from orchard.launch import distributed
from orchard.launch.supervisor import ProcessSpec, Supervisor
from orchard.net.bus import Bus, Inbox, Signal
from orchard.net.endpoints import BusError
from orchard.net.host import Host, HostEnded, end_if_asked
from orchard.net.options import HostOptions, Options, read_options
from orchard.net.requests import fetch_layout
from orchard.net.zenoh_bus import CONNECT_SECONDS
from orchard.processes import agents, physics
from orchard.record.logger import FrameQueue, Logger
from orchard.server import snapshots
from orchard.server.loop import RunLoop
from orchard.server.options import RunOptions
from orchard.sim.engine import Engine
from orchard.sim.snapshot import SNAPSHOT, SnapshotError, store
from orchard.wire.keys import LOGGER, PHYSICS, Keys

log = logging.getLogger("orchard")
# Errors that a process logs, and ends with code 2.
MISTAKES = (BusError, ValueError, ScenarioError, SnapshotError, OSError)
# The exit code of a process that was killed by SIGKILL.
KILLED = -9
# s between two snapshots. That is short, because few schedules last for many seconds.
SNAPSHOT_SECONDS = 0.5
LOOK_SECONDS = 0.01  # s between two looks whether a process has ended
# ns: the time stamp of a file at the beginning of virtual time. It only has to be the same.
FIRST_STAMP = 10**18


class SimulatedLine:
    """run.py's end of the line to a process: what `lifeline.Line` is for a real one."""

    def __init__(self, process: "SimulatedProcess") -> None:
        self._process = process
        self.code: int | None = None

    def let_go(self) -> None:
        """Ask the process to end."""
        self._process.inbox.put(Signal(SIGTERM))

    def close(self) -> None:
        """Forget the line, and the exit code on it."""
        self.code = None


class SimulatedProcess:
    """A process of the supervisor: what `subprocess.Popen` is for a real one."""

    def __init__(
        self, world: "World", spec: ProcessSpec, order: Any, pid: int, start_seconds: float = 1.0
    ) -> None:
        """`order`: the options or arguments with which it is started.

        `start_seconds`: that it takes at most to load its modules.
        """
        self.world = world
        self.spec = spec
        self.pid = pid
        # Its exit code; None: it runs.
        self.code: int | None = None
        self.order = order
        self._start_seconds = start_seconds
        self.line = SimulatedLine(self)
        self.inbox = VirtualInbox(world.scheduler)
        self.task = world.scheduler.spawn(spec.name, self._run)
        world.processes[self.task] = self
        self.inbox.read_by(self.task)
        self.disk = SimulatedDisk(world, self)
        # The sessions that it has had.
        self.buses: list[SimulatedBus] = []
        # The hosts that it has run: a new one after each reset.
        self.hosts: list[Host] = []
        # Lines that it has printed, and lines of its log.
        self.printed: list[str] = []
        self.complaints: list[str] = []
        # What ends each fault that stops it now.
        self._thaws: list[Callable[[], None]] = []

    def _run(self) -> None:
        """Run as its task: load, do what the process is for, and end."""
        self.task.wait(self.world.random.random() * self._start_seconds)
        try:
            self.code = self.line.code = _code_of(self)
        except Exception as error:
            self.code = 1
            self.world.crash(self, error)
        self.world.network.trace(f"{self.spec.name} has ended with code {self.code}")

    def body(self) -> int:
        """Do what it does. Return its exit code."""
        return BODIES[self.spec.module](self)

    def poll(self) -> int | None:
        """Return its exit code; None while it runs."""
        return self.code

    def kill(self) -> None:
        """Kill it, if it runs."""
        if self.code is None:
            self.code = KILLED
            while self._thaws:
                # The system closes the links of a frozen process, too.
                thaw = self._thaws.pop()
                thaw()
            for bus in self.buses:
                self.world.network.end(bus, self._share())
            self.world.network.end_router(self.spec.name, self._share())
            if not self.world.is_disk_full:
                self.disk.break_off()
            self.task.kill()

    def _share(self) -> float:
        """Return how much still arrives of what a process has sent that is killed.

        The system sends on what it has been given: in half of all cases that is all.
        """
        return min(1.0, 2.0 * self.world.random.random())

    def freeze(self) -> None:
        """Stop it, as SIGSTOP does."""
        self._stop(self.world.network.freeze(self.spec.name))

    @property
    def is_stopped(self) -> bool:
        """Whether it is frozen, or thinks."""
        return bool(self._thaws)

    def think(self) -> None:
        """Let an agent think for long: its session goes on."""
        self._stop(lambda: None)

    def _stop(self, thaw: Callable[[], None]) -> None:
        """Stop its task. `thaw`: called when this fault ends."""
        self.task.freeze()
        self._thaws.append(thaw)

    def thaw(self) -> None:
        """End a fault that stops it. After the last one it goes on."""
        if self._thaws:
            thaw = self._thaws.pop()
            thaw()
            if not self._thaws:
                self.task.thaw()

    def wait(self, timeout: float = inf) -> int:
        """Let the task that calls it wait for its end.

        Return its exit code. Raises TimeoutExpired.
        """
        scheduler = self.world.scheduler
        deadline = self.world.scheduler.now + timeout
        while self.code is None:
            if scheduler.now >= deadline or scheduler.current is None:
                raise TimeoutExpired(self.spec.name, timeout)
            scheduler.current.wait(LOOK_SECONDS)
        return self.code

    @contextmanager
    def routed(self) -> Iterator[Bus]:
        """Open its session, and the router."""
        with self.world.network.router_session(
            self.spec.name, self.task, self.inbox, self.disk
        ) as bus:
            self.buses.append(bus)
            yield bus

    @contextmanager
    def connected(self, seconds: float = CONNECT_SECONDS) -> Iterator[Bus]:
        """Open its session at the router. Raises BusError if there is none within `seconds`."""
        with self.world.network.client_session(
            self.spec.name, self.task, self.inbox, self.disk, seconds
        ) as bus:
            self.buses.append(bus)
            yield bus


def _code_of(process: SimulatedProcess) -> int:
    """Run the code of a process. Return its exit code."""
    try:
        return process.body()
    except HostEnded as end:
        if end.code:
            log.error("%s", end)
        return end.code
    except MISTAKES as error:
        log.error("%s", error)
        return 2


def _options_of(process: SimulatedProcess, kind: type[Options]) -> Options:
    """Return what run.py gives the process, or what its command line says."""
    order = process.order
    if isinstance(order, kind):
        return order
    return read_options(kind, process.spec.module, order)


def _physics(process: SimulatedProcess) -> int:
    """Run the code of physics."""

    def opened(options: RunOptions, inbox: Inbox) -> AbstractContextManager[Bus]:
        """Open its session. If it has had one, the run begins again in this process."""
        if process.buses:
            process.world.resets += 1
        if options.connect is None:
            return process.routed()
        return process.connected()

    process.world.found = list(process.world.kept)
    return physics.simulate(
        process.inbox, _options_of(process, RunOptions), opened, process.world.begin
    )


def _agents(process: SimulatedProcess) -> int:
    """Run the code of a process that hosts agents."""
    agents.host(
        process.inbox,
        _options_of(process, HostOptions),
        lambda inbox: process.connected(),
        ready=process.hosts.append,
    )


def _router(process: SimulatedProcess) -> int:
    """Be a router of its own, until a signal comes."""
    network = process.world.network
    network.start_router(process.spec.name)
    print(f"listening on {network.ENDPOINT}")
    try:
        while not isinstance(process.inbox.take(), Signal):
            pass
    finally:
        network.end_router(process.spec.name)
    return 0


class _NoWriter:
    """Takes the place of the job that writes a recording: the frames stay in the queue."""

    def done(self) -> bool:
        return False

    def result(self) -> None:
        pass


def _logger(process: SimulatedProcess) -> int:
    """Run the code of the logger, up to the queue of what it would write."""
    with process.connected() as bus:
        keys = Keys()
        run, layout = fetch_layout(bus, keys, end_if_asked)
        queue = FrameQueue()
        process.world.frames.append(queue)
        logger = Logger(bus, keys, run.run, layout, queue)
        logger.listen()
        bus.declare_alive(keys.of("alive", LOGGER, run.run))
        return logger.run(_NoWriter())[0]  # type: ignore[arg-type]


# Module of a process -> what the simulated one does, and returns its exit code.
BODIES: dict[str, Callable[[SimulatedProcess], int]] = {
    "orchard.processes.physics": _physics,
    "orchard.processes.agents": _agents,
    "orchard.processes.logger": _logger,
    "orchard.processes.router": _router,
    "chaos.simulated.bare_client": lambda process: own_agent(process.inbox, process.connected),
}


class SimulatedSupervisor(Supervisor):
    """The supervisor, by its own rules, with processes in virtual time."""

    def __init__(self, world: "World") -> None:
        super().__init__(world.say, RUN, clock=lambda: world.scheduler.now)
        self._world = world
        self._pids = 0
        self.restarted: list[str] = []  # the names of processes, once for each restart

    def _open(self, program: ProcessSpec, order: Any) -> Any:
        self._pids += 1
        words = f"{program.name} is started"
        if program.name in self.running:
            self.restarted.append(program.name)
            words += " again"
        self._world.network.trace(words)
        if isinstance(order, RunOptions):
            order = msgspec.structs.replace(order, snapshot_every=SNAPSHOT_SECONDS)
        process = SimulatedProcess(self._world, program, order, self._pids)
        return process, process.line

    def _clear_up(self, running: Any) -> None:
        running.line.close()


@dataclass
class World:
    """All that one schedule needs: its time, network, disk, processes, and what was said."""

    scheduler: Scheduler
    network: Network
    random: Random
    folder: Path  # for snapshots, and all else that is written
    disk_seconds: float = 0.1  # s that a write takes at most
    is_disk_full: bool = False
    half_writes: int = 0  # how many writes the disk has taken half of
    loop: RunLoop | None = None  # of the physics that has begun last
    engine: Engine | None = None  # the engine of that loop
    physics: SimulatedProcess | None = None  # the process of that loop
    begun_at: int = 0  # the tick at which that loop has begun
    resets: int = 0  # how often a run has begun again in its process
    begun_after: int = 0  # how many resets there had been when that loop began
    lines: list[str] = field(default_factory=list)  # that users read
    processes: dict[Task, SimulatedProcess] = field(default_factory=dict)
    crashes: list[str] = field(default_factory=list)  # errors that no user should see
    frames: list[FrameQueue] = field(default_factory=list)  # one for each logger
    begins: int = 0  # how often physics has begun
    observer: Observer | None = None  # follows physics
    kept: list[int] = field(default_factory=list)  # ticks of the snapshots that were written
    found: list[int] = field(default_factory=list)  # `kept` when the last physics was started
    torn: set[int] = field(default_factory=set)  # ticks of the snapshots that are torn
    wrong_begins: list[str] = field(default_factory=list)  # complaints: see begin.py

    def process(self, name: str) -> SimulatedProcess | None:
        """Return the process of this name that runs; None if none does."""
        for process in self.processes.values():
            if process.spec.name == name and process.code is None:
                return process
        return None

    def begin(self, loop: RunLoop) -> None:
        """Note the loop of physics, which is about to begin."""
        engine = loop.run.engine
        self.loop = loop
        self.engine = engine
        self.physics = self._running
        self.begins += 1
        is_reset = self.resets != self.begun_after and engine.tick == 0
        self.begun_at = engine.tick
        self.begun_after = self.resets
        fault = wrong_begin(engine.tick, self.found, self.torn)
        if fault and not is_reset:
            self.wrong_begins.append(fault)
        if self.observer is not None and self.physics is not None:
            sessions: list[SimulatedBus] = []
            for process in self.processes.values():
                if process.spec.name == PHYSICS:
                    sessions += process.buses
            self.observer.begin(loop, sessions, is_reset)

    def say(self, line: str) -> None:
        """Take a line for the user."""
        # The folder has another name each time, and the same plan must give the same lines.
        line = line.replace(str(self.folder), "")
        self.lines.append(line)
        self.network.trace(f"  says: {line}")

    def log(self, line: str) -> None:
        """Take a line of the log of the process that runs."""
        process = self._running
        if process is not None:
            process.complaints.append(line)
            line = f"{process.spec.name}: {line}"
        self.say(line)

    def write(self, words: str) -> None:
        """Take what a process prints. `entered` puts the world in place of `sys.stdout`."""
        process = self._running
        if words.strip() and process is not None:
            process.printed += words.splitlines()

    def flush(self) -> None:
        """Do nothing: what is printed is there at once."""

    @property
    def _running(self) -> SimulatedProcess | None:
        """The process whose code runs now; None if it is the schedule's own or a client's."""
        task = self.scheduler.current
        if task is None:
            return None
        return self.processes.get(task)

    def crash(self, process: SimulatedProcess, error: Exception) -> None:
        """Take an error that no process may have."""
        import traceback

        self.crashes.append(
            f"{process.spec.name}: {''.join(traceback.format_exception(error)[-4:])}"
        )
        self.say(f"{process.spec.name} crashed: {type(error).__name__}: {error}")

    @contextmanager
    def entered(self) -> Iterator[None]:
        """In this context the project's log, printed lines and snapshots come here."""
        log = logging.getLogger("orchard")
        handler = _Handler(self)
        propagates = log.propagate
        log.propagate = False
        log.addHandler(handler)
        try:
            folders = patch.object(distributed, "TemporaryDirectory", self._new_folder)
            with patch.object(snapshots, "store", self._store), patch("sys.stdout", self), folders:
                yield
        finally:
            log.removeHandler(handler)
            log.propagate = propagates

    def _new_folder(self) -> AbstractContextManager[str]:
        """Return a context with a new folder, which stays after it, as after a kill."""
        path = self.folder / f"run_py_{len(self.processes)}"
        path.mkdir()
        return nullcontext(str(path))

    def _store(self, name: str, content: bytes, folder: Path, run: str) -> Path:
        """Write a snapshot, in place of `store` of orchard/sim/snapshot.py."""
        if self.is_disk_full:
            self.half_writes += 1
            # It raises this error.
            with takes_half(OSError(ENOSPC, os.strerror(ENOSPC))):
                store(name, content, folder, run)
        path = store(name, content, folder, run)
        self._keep(path)
        self.stamp(path)
        return path

    def stamp(self, path: Path) -> None:
        """Give a file the time stamp of this moment of virtual time."""
        at = int(self.scheduler.now * 1e9) + FIRST_STAMP
        os.utime(path, ns=(at, at))

    def _keep(self, path: Path) -> None:
        """Note a file that was written, if it is a snapshot: tick-000120.snapshot."""
        if path.suffix == SNAPSHOT:
            tick = int(path.stem.removeprefix("tick-"))
            self.torn.discard(tick)
            self.kept.append(tick)
            if self.observer is not None:
                self.observer.is_kept(tick)


class _Handler(logging.Handler):
    """Gives the lines of the log to the world."""

    def __init__(self, world: World) -> None:
        super().__init__(logging.WARNING)
        self._world = world

    def emit(self, record: logging.LogRecord) -> None:
        self._world.log(record.getMessage())


def spec_of_bare_client(mode: str) -> ProcessSpec:
    """Return the process of the bare client, which owns one agent: bare_client.py."""
    return ProcessSpec(
        BARE_CLIENT, "chaos.simulated.bare_client", [], again=True, agents=[NAMES[mode]]
    )
