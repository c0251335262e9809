"""The processes of a run as tasks, with the supervisor's own rules, and a disk that takes time."""

import logging
import os
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field
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
# Exit code.
KILLED = -9
SNAPSHOT_SECONDS = 0.5  # between two snapshots: few schedules last for seconds


class SimulatedLine:
    """run.py's end of the line to a process: what `lifeline.Line` is for a real one."""

    def __init__(self, process: "SimulatedProcess") -> None:
        self._process = process
        self.code: int | None = None

    def let_go(self) -> None:
        self._process.inbox.put(Signal(SIGTERM))

    def close(self) -> None:
        self.code = None


class SimulatedProcess:
    """A process of the supervisor: what `subprocess.Popen` is for a real one."""

    def __init__(
        self, world: "World", spec: ProcessSpec, order: Any, pid: int, start_seconds: float = 1.0
    ) -> None:
        """`start_seconds`: that it takes at most to load its modules."""
        self.world = world
        self.spec = spec
        self.pid = pid
        self.code: int | None = None
        self.order = order
        self._start_seconds = start_seconds
        self.line = SimulatedLine(self)
        self.inbox = VirtualInbox(world.scheduler)
        self.task = world.scheduler.spawn(spec.name, self._run)
        world.processes[self.task] = self
        self.inbox.read_by(self.task)
        self.disk = SimulatedDisk(world, self)
        self.buses: list[SimulatedBus] = []
        self.hosts: list[Host] = []  # those that it has run
        self.printed: list[str] = []  # lines
        self.complaints: list[str] = []  # lines of its log
        self._thaws: list[Callable[[], None]] = []

    def _run(self) -> None:
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
        return self.code

    def kill(self) -> None:
        if self.code is None:
            self.code = KILLED
            while self._thaws:
                self._thaws.pop()()  # the system closes the links of a frozen process, too
            for bus in self.buses:
                self.world.network.end(bus, self._share())
            self.world.network.end_router(self.spec.name, self._share())
            if not self.world.is_disk_full:
                self.disk.break_off()
            self.task.kill()

    def _share(self) -> float:
        """How much of what it has sent still arrives: the system sends on what it has been
        given.
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
        self.task.freeze()
        self._thaws.append(thaw)

    def thaw(self) -> None:
        """Let it go on."""
        if self._thaws:
            self._thaws.pop()()
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
            scheduler.current.wait(0.01)
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
    return order if isinstance(order, kind) else read_options(kind, process.spec.module, order)


def _physics(process: SimulatedProcess) -> int:
    def opened(options: RunOptions, inbox: Inbox) -> AbstractContextManager[Bus]:
        process.world.resets += bool(process.buses)  # the run begins again in this process
        return process.routed() if options.connect is None else process.connected()

    process.world.found = list(process.world.kept)
    return physics.simulate(
        process.inbox, _options_of(process, RunOptions), opened, process.world.begin
    )


def _agents(process: SimulatedProcess) -> int:
    agents.host(
        process.inbox,
        _options_of(process, HostOptions),
        lambda inbox: process.connected(),
        ready=process.hosts.append,
    )


def _router(process: SimulatedProcess) -> int:
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
    with process.connected() as bus:
        keys = Keys()
        run, layout = fetch_layout(bus, keys, end_if_asked)
        queue = FrameQueue()
        process.world.frames.append(queue)
        logger = Logger(bus, keys, run.run, layout, queue)
        logger.listen()
        bus.declare_alive(keys.of("alive", LOGGER, run.run))
        return logger.run(_NoWriter())[0]  # type: ignore[arg-type]


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
        is_again = program.name in self.running
        self.restarted += [program.name] * is_again
        self._world.network.trace(f"{program.name} is started{' again' if is_again else ''}")
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
    folder: Path  # for snapshots
    disk_seconds: float = 0.1  # that a write takes at most
    is_disk_full: bool = False
    half_writes: int = 0  # of which the disk has taken half
    loop: RunLoop | None = None  # of physics
    engine: Engine | None = None  # of that
    physics: SimulatedProcess | None = None  # the process that has it
    begun_at: int = 0  # the tick at which that has begun
    resets: int = 0  # how often a run has begun again in its process
    begun_after: int = 0  # the resets before that of `engine`
    lines: list[str] = field(default_factory=list)  # what users are told
    processes: dict[Task, SimulatedProcess] = field(default_factory=dict)
    crashes: list[str] = field(default_factory=list)  # what no user should see
    frames: list[FrameQueue] = field(default_factory=list)  # of each logger
    begins: int = 0  # how often physics has begun
    observer: Observer | None = None  # follows physics
    kept: list[int] = field(default_factory=list)  # ticks of the snapshots that were written
    found: list[int] = field(default_factory=list)  # of these, what physics finds when it starts
    torn: set[int] = field(default_factory=set)  # the ticks of those that are torn
    wrong_begins: list[str] = field(default_factory=list)  # where physics may not have begun

    def process(self, name: str) -> SimulatedProcess | None:
        """Return the process of this name that runs."""
        return next(
            (
                process
                for process in self.processes.values()
                if process.spec.name == name and process.code is None
            ),
            None,
        )

    def begin(self, loop: RunLoop) -> None:
        """Know the loop of physics, which is about to begin."""
        engine = loop.run.engine
        self.loop = loop
        self.engine = engine
        self.physics = self._running
        self.begins += 1
        is_reset = self.resets != self.begun_after and engine.tick == 0
        self.begun_at = engine.tick
        self.begun_after = self.resets
        if not is_reset and (fault := wrong_begin(engine.tick, self.found, self.torn)):
            self.wrong_begins.append(fault)
        if self.observer is not None and self.physics is not None:
            sessions = [
                bus
                for process in self.processes.values()
                if process.spec.name == PHYSICS
                for bus in process.buses
            ]
            self.observer.begin(loop, sessions, is_reset)

    def say(self, line: str) -> None:
        """Take a line for the user."""
        line = line.replace(str(self.folder), "")  # which has another name each time
        self.lines.append(line)
        self.network.trace(f"  says: {line}")

    def log(self, line: str) -> None:
        """Take a line of the log of the process that runs."""
        if (process := self._running) is not None:
            process.complaints.append(line)
            line = f"{process.spec.name}: {line}"
        self.say(line)

    def write(self, words: str) -> None:
        """Take what the process that runs prints: it is the standard output of all."""
        if words.strip() and (process := self._running) is not None:
            process.printed += words.splitlines()

    def flush(self) -> None:
        """Do nothing: what is printed is there at once."""

    @property
    def _running(self) -> SimulatedProcess | None:
        task = self.scheduler.current
        return None if task is None else self.processes.get(task)

    def crash(self, process: SimulatedProcess, error: Exception) -> None:
        """Take an error that no process may have."""
        import traceback

        self.crashes.append(
            f"{process.spec.name}: {''.join(traceback.format_exception(error)[-4:])}"
        )
        self.say(f"{process.spec.name} crashed: {type(error).__name__}: {error}")

    @contextmanager
    def entered(self) -> Iterator[None]:
        """Let the project's log, its printed lines and its writes come here."""
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
        """A folder that stays, as after a kill."""
        path = self.folder / f"run_py_{len(self.processes)}"
        path.mkdir()
        return nullcontext(str(path))

    def _store(self, name: str, content: bytes, folder: Path, run: str) -> Path:
        if self.is_disk_full:
            self.half_writes += 1
            with takes_half(OSError(28, os.strerror(28))):
                store(name, content, folder, run)
        path = store(name, content, folder, run)
        self._keep(path)
        self.stamp(path)
        return path

    def stamp(self, path: Path) -> None:
        """Let a file be of this moment of virtual time."""
        at = int(self.scheduler.now * 1e9) + 10**18
        os.utime(path, ns=(at, at))

    def _keep(self, path: Path) -> None:
        """Know that a snapshot is written."""
        if path.suffix == SNAPSHOT:
            tick = int(path.stem.removeprefix("tick-"))
            self.torn.discard(tick)
            self.kept.append(tick)
            if self.observer is not None:
                self.observer.is_kept(tick)


class _Handler(logging.Handler):
    def __init__(self, world: World) -> None:
        super().__init__(logging.WARNING)
        self._world = world

    def emit(self, record: logging.LogRecord) -> None:
        self._world.log(record.getMessage())


def spec_of_bare_client(mode: str) -> ProcessSpec:
    """A client of its own, which owns one agent."""
    return ProcessSpec(
        BARE_CLIENT, "chaos.simulated.bare_client", [], again=True, agents=[NAMES[mode]]
    )
