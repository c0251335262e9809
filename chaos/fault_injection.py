"""Injects the faults of a trial into a running harvest, and measures how long each recovery
takes.
"""

import heapq
import signal
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from itertools import count
from typing import NamedTuple

import psutil

from chaos.fuzzer import fuzz
from chaos.harvest import Harvest
from chaos.network import DELAY_SECONDS, Network
from chaos.schedule import (
    ALL,
    BYTES,
    CUT,
    DELAY,
    FREEZE,
    FULL,
    HOST,
    INTERRUPT,
    KILL,
    LINKS,
    LOGGER,
    MISTAKES,
    PHYSICS,
    PORT,
    ROUTER,
    RUN_PY,
    STALL,
    TERMINATE,
    TORN,
    Fault,
    Trial,
)
from orchard.net.bus import Bus, Sample
from orchard.net.endpoints import BusError
from orchard.net.refusals import Refused, read_message
from orchard.net.zenoh_bus import client
from orchard.wire.keys import Keys
from orchard.wire.messages import Clock, read

UNDER_WAY = (
    3  # ticks that may be under way when a fault begins; later ticks are stepped after the fault
)
START_SECONDS = (
    90.0  # for a run to start; it also covers what the rest of the time limit does not count
)
FAULT_SECONDS = 30.0  # by which one fault may delay a run
LONGEST = 700.0  # simulated s; more than a whole harvest takes
FREE_SECONDS = 2.0  # in which a killed process is gone, and its port free
SIGNALS = {KILL: signal.SIGKILL, TERMINATE: signal.SIGTERM, INTERRUPT: signal.SIGINT}


class Recovery(NamedTuple):
    """A fault, and the time until the run had passed the tick that it had reached when the fault
    began.
    """

    fault: str
    seconds: float  # of wall time, since the beginning of the fault


class Execution(NamedTuple):
    """The faults of a run, and how the run ended."""

    injected: list[str]  # names of the faults
    recoveries: list[Recovery]
    exit_code: int | None  # None: it did not end in time
    last: int  # the last tick that was received; -1: none
    limit: float  # s, the time limit


class FaultInjector:
    """Injects the faults of one trial into its run, each at its tick, and ends those that have a
    duration.
    """

    def __init__(self, trial: Trial, harvest: Harvest, network: Network, bus: Bus) -> None:
        """`bus`: a session that is connected without the relay and subscribed to the clock."""
        self._harvest = harvest
        self._network = network
        self._bus = bus
        self._pending = list(trial.faults)
        self._ends: list[
            tuple[float, int, Callable[[], object]]
        ] = []  # (monotonic time, a number that breaks ties, action)
        self._number = count()
        self._unrecovered: list[
            tuple[Fault, float, int]
        ] = []  # (fault, monotonic time and tick when it began)
        self._fuzzers: list[threading.Thread] = []
        self._run = ""
        self.tick = -1
        self.injected: list[str] = []
        self.recoveries: list[Recovery] = []

    def listen(self, seconds: float) -> None:
        """Read all clock messages that have arrived.

        If there is none, wait up to `seconds` for the next.
        """
        while isinstance(item := self._bus.inbox.take(seconds), Sample):
            self._receive(item)
            seconds = 0.0

    def _receive(self, sample: Sample) -> None:
        """Read a sample on the clock's key: the clock of the run, or a message of the fuzzer, which
        is ignored.
        """
        with suppress(Refused, ValueError):
            self._run = self._run or read(sample.payload, Clock).run
            self.tick = read_message(sample.payload, Clock, self._run).tick
        now = time.monotonic()
        self.recoveries += [
            Recovery(fault.name, now - begun)
            for fault, begun, tick in self._unrecovered
            if self.tick > tick + UNDER_WAY
        ]
        self._unrecovered = [
            entry for entry in self._unrecovered if self.tick <= entry[2] + UNDER_WAY
        ]

    def inject_due(self) -> None:
        """Begin the faults whose tick has come, and end those whose time is over."""
        while self._pending and self._pending[0].tick <= self.tick:
            fault = self._pending.pop(0)
            if INJECTIONS[fault.kind](self, fault):
                self.injected.append(fault.name)
                begun = time.monotonic()
                self.listen(0.0)
                self._unrecovered.append((fault, begun, self.tick))
        while self._ends and self._ends[0][0] <= time.monotonic():
            heapq.heappop(self._ends)[2]()

    def end(self) -> None:
        """End all faults that still last."""
        while self._ends:
            heapq.heappop(self._ends)[2]()
        for fuzzer in self._fuzzers:
            fuzzer.join(20.0)

    # -- injections; each returns whether it was possible

    def _kill(self, fault: Fault) -> bool:
        if fault.target == ROUTER:
            self._later(fault, self._network.start_router)
            return self._network.kill_router()
        if fault.target == RUN_PY:
            return self._harvest.kill_and_resume()
        for process in (targets := self._targets(fault)):
            with suppress(psutil.NoSuchProcess):
                process.send_signal(SIGNALS[fault.kind])
        return bool(targets)

    def _freeze(self, fault: Fault) -> bool:
        for process in (targets := self._targets(fault)):
            with suppress(psutil.NoSuchProcess):
                process.suspend()
        self._later(fault, lambda: _resume(targets))
        return bool(targets)

    def _cut(self, fault: Fault) -> bool:
        if self._network.relay is not None:
            self._network.relay.cut(_link(fault))
        return self._network.relay is not None

    def _stall(self, fault: Fault) -> bool:
        if self._network.relay is not None:
            self._network.relay.stall(_link(fault))
            self._later(fault, self._network.relay.heal)
        return self._network.relay is not None

    def _delay(self, fault: Fault) -> bool:
        if self._network.relay is not None:
            self._network.relay.delay(_link(fault), DELAY_SECONDS)
            self._later(fault, self._network.relay.heal)
        return self._network.relay is not None

    def _fuzz(self, fault: Fault) -> bool:
        """Fuzz in a separate thread: a frozen router blocks a session that sends to it."""
        fuzzer = threading.Thread(
            target=fuzz, args=(self._network.endpoint, self._run, fault.chance), daemon=True
        )
        fuzzer.start()
        self._fuzzers.append(fuzzer)
        return True

    def _fill(self, fault: Fault) -> bool:
        self._later(fault, self._harvest.disk.clear)
        return self._harvest.disk.fill()

    def _tear(self, fault: Fault) -> bool:
        """Physics, started again, finds a kernel that is not what it was."""
        return self._harvest.tear_kernel(fault.chance) and bool(self._kill_physics())

    def _take_port(self, fault: Fault) -> bool:
        """Physics, started again, finds its port taken for a time."""
        killed = self._kill_physics()
        psutil.wait_procs(killed, FREE_SECONDS)
        if taken := self._network.take_port() if killed else None:
            self._later(fault, taken.close)
        return taken is not None

    def _kill_physics(self) -> list[psutil.Process]:
        for process in (running := self._harvest.processes(PHYSICS)):
            with suppress(psutil.NoSuchProcess):
                process.kill()
        return running

    def _targets(self, fault: Fault) -> list[psutil.Process]:
        """The processes that a fault hits: one of those of its role, or all; empty while
        none runs.
        """
        if fault.target == ALL:
            return [
                process
                for role in (PHYSICS, HOST, LOGGER)
                for process in self._harvest.processes(role)
            ]
        running = self._harvest.processes(fault.target)
        return [running[fault.chance % len(running)]] if running else []

    def _later(self, fault: Fault, action: Callable[[], object]) -> None:
        """Run an action when the fault's duration is over."""
        heapq.heappush(self._ends, (time.monotonic() + fault.seconds, next(self._number), action))


INJECTIONS: dict[str, Callable[[FaultInjector, Fault], bool]] = {
    KILL: FaultInjector._kill,
    TERMINATE: FaultInjector._kill,
    INTERRUPT: FaultInjector._kill,
    FREEZE: FaultInjector._freeze,
    CUT: FaultInjector._cut,
    STALL: FaultInjector._stall,
    DELAY: FaultInjector._delay,
    BYTES: FaultInjector._fuzz,
    FULL: FaultInjector._fill,
    TORN: FaultInjector._tear,
    PORT: FaultInjector._take_port,
    MISTAKES: lambda injector, fault: True,  # the agent makes them from the beginning
}


def _link(fault: Fault) -> int | None:
    """The link that a fault hits; None: all links."""
    return None if fault.target == LINKS else fault.chance


def _resume(processes: list[psutil.Process]) -> None:
    for process in processes:
        with suppress(psutil.NoSuchProcess):
            process.resume()


def inject_faults(trial: Trial, harvest: Harvest, network: Network) -> Execution:
    """Inject the trial's faults into a run that has been started.

    Return when the run has ended or its time limit is over.
    """
    limit = time_limit(trial)
    deadline = time.monotonic() + limit
    try:
        with client(network.endpoint, seconds=START_SECONDS) as bus:
            injector = FaultInjector(trial, harvest, network, bus)
            bus.subscribe(Keys().of("clock"))
            while harvest.exit_code is None and time.monotonic() < deadline:
                injector.listen(0.05)
                injector.inject_due()
            injector.end()
    except BusError:
        return Execution([], [], harvest.exit_code, -1, limit)
    return Execution(
        injector.injected, injector.recoveries, harvest.exit_code, injector.tick, limit
    )


def time_limit(trial: Trial) -> float:
    """Return the seconds of wall time after which a run counts as not finished."""
    speed = 10.0 if trial.speed == "max" else float(trial.speed)
    return START_SECONDS + (trial.seconds or LONGEST) / speed + FAULT_SECONDS * len(trial.faults)
