"""Injects the faults of a trial into a running harvest, and measures how long each recovery takes.

A trial (schedule.py) is one run with its faults, each at a tick. A recovery is the time until the
run has passed the tick that it had reached when the fault began.
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

# Ticks that may be under way when a fault begins. Only a later one shows that the run goes on.
UNDER_WAY = 3
# s for a run to start; they also cover what the rest of the time limit does not count.
START_SECONDS = 90.0
# s by which one fault may delay a run.
FAULT_SECONDS = 30.0
# Simulated s: more than a whole harvest takes.
LONGEST = 700.0
# Simulated seconds a second that a run without a limit of its speed reaches at least.
LEAST_SPEED = 10.0
# s in which a killed process is gone, and its port free.
FREE_SECONDS = 2.0
# s that a fuzzer may take to end.
FUZZER_SECONDS = 20.0
# s between two looks at the clock of the run.
LOOK_SECONDS = 0.05
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


class _End(NamedTuple):
    """The end of a fault that lasts, in a heap: the earliest one comes first."""

    at: float  # s, of time.monotonic
    number: int  # breaks ties, because functions have no order
    act: Callable[[], object]


class _Begun(NamedTuple):
    """A fault from which the run has not recovered yet."""

    fault: Fault
    at: float  # s, of time.monotonic, when it began
    tick: int  # that the run had reached then

    def is_over(self, tick: int) -> bool:
        """Whether a run that is at a tick has recovered."""
        return tick > self.tick + UNDER_WAY


class FaultInjector:
    """Injects the faults of one trial into its run, each at its tick, and ends those that last."""

    def __init__(self, trial: Trial, harvest: Harvest, network: Network, bus: Bus) -> None:
        """`bus`: a session that is connected without the relay and subscribed to the clock."""
        self._harvest = harvest
        self._network = network
        self._bus = bus
        # The faults that are still to come, in the order of their ticks.
        self._pending = list(trial.faults)
        self._ends: list[_End] = []
        self._number = count()
        self._unrecovered: list[_Begun] = []
        self._fuzzers: list[threading.Thread] = []
        # The id of the run; '' before its first clock message.
        self._run = ""
        # The newest tick that was received; -1: none.
        self.tick = -1
        # Names of the faults that were injected.
        self.injected: list[str] = []
        self.recoveries: list[Recovery] = []

    def listen(self, seconds: float) -> None:
        """Read all clock messages that have arrived.

        If there is none, wait up to `seconds` for the next.
        """
        item = self._bus.inbox.take(seconds)
        while isinstance(item, Sample):
            self._receive(item)
            item = self._bus.inbox.take(0.0)

    def _receive(self, sample: Sample) -> None:
        """Read a sample on the clock's key, and note the recoveries that it shows.

        It is the clock of the run, or a message of the fuzzer, which is ignored.
        """
        with suppress(Refused, ValueError):
            self._run = self._run or read(sample.payload, Clock).run
            self.tick = read_message(sample.payload, Clock, self._run).tick
        now = time.monotonic()
        unrecovered = []
        for begun in self._unrecovered:
            if begun.is_over(self.tick):
                self.recoveries.append(Recovery(begun.fault.name, now - begun.at))
            else:
                unrecovered.append(begun)
        self._unrecovered = unrecovered

    def inject_due(self) -> None:
        """Begin the faults whose tick has come, and end those whose time is over."""
        while self._pending and self._pending[0].tick <= self.tick:
            fault = self._pending.pop(0)
            if INJECTIONS[fault.kind](self, fault):
                self.injected.append(fault.name)
                begun = time.monotonic()
                # The tick that the run has reached may have come meanwhile.
                self.listen(0.0)
                self._unrecovered.append(_Begun(fault, begun, self.tick))
        while self._ends and self._ends[0].at <= time.monotonic():
            heapq.heappop(self._ends).act()

    def end(self) -> None:
        """End all faults that still last."""
        while self._ends:
            heapq.heappop(self._ends).act()
        for fuzzer in self._fuzzers:
            fuzzer.join(FUZZER_SECONDS)

    # -- injections; each returns whether it was possible

    def _kill(self, fault: Fault) -> bool:
        """Send a process, all processes, the router or run.py a signal that ends it."""
        if fault.target == ROUTER:
            self._later(fault, self._network.start_router)
            return self._network.kill_router()
        if fault.target == RUN_PY:
            return self._harvest.kill_and_resume()
        targets = self._targets(fault)
        for process in targets:
            with suppress(psutil.NoSuchProcess):
                process.send_signal(SIGNALS[fault.kind])
        return bool(targets)

    def _freeze(self, fault: Fault) -> bool:
        """Stop a process for a time, as SIGSTOP does."""
        targets = self._targets(fault)
        for process in targets:
            with suppress(psutil.NoSuchProcess):
                process.suspend()
        self._later(fault, lambda: _resume(targets))
        return bool(targets)

    def _cut(self, fault: Fault) -> bool:
        """Break links. Without a relay that cannot be done, as for the next two."""
        relay = self._network.relay
        if relay is None:
            return False
        relay.cut(_link(fault))
        return True

    def _stall(self, fault: Fault) -> bool:
        """Let nothing pass through links for a time."""
        relay = self._network.relay
        if relay is None:
            return False
        relay.stall(_link(fault))
        self._later(fault, relay.heal)
        return True

    def _delay(self, fault: Fault) -> bool:
        """Make links slow for a time."""
        relay = self._network.relay
        if relay is None:
            return False
        relay.delay(_link(fault), DELAY_SECONDS)
        self._later(fault, relay.heal)
        return True

    def _fuzz(self, fault: Fault) -> bool:
        """Fuzz in a separate thread: a frozen router blocks a session that sends to it."""
        fuzzer = threading.Thread(
            target=fuzz, args=(self._network.endpoint, self._run, fault.chance), daemon=True
        )
        fuzzer.start()
        self._fuzzers.append(fuzzer)
        return True

    def _fill(self, fault: Fault) -> bool:
        """Fill the disk for a time."""
        self._later(fault, self._harvest.disk.clear)
        return self._harvest.disk.fill()

    def _tear(self, fault: Fault) -> bool:
        """Change a compiled kernel, and kill physics: it finds the kernel when it starts again."""
        return self._harvest.tear_kernel(fault.chance) and bool(self._kill_physics())

    def _take_port(self, fault: Fault) -> bool:
        """Kill physics: started again, it finds its port taken for a time."""
        killed = self._kill_physics()
        psutil.wait_procs(killed, FREE_SECONDS)
        if not killed:
            return False
        taken = self._network.take_port()
        if taken is None:
            return False
        self._later(fault, taken.close)
        return True

    def _kill_physics(self) -> list[psutil.Process]:
        """Kill physics. Return its process; empty if none ran."""
        running = self._harvest.processes(PHYSICS)
        for process in running:
            with suppress(psutil.NoSuchProcess):
                process.kill()
        return running

    def _targets(self, fault: Fault) -> list[psutil.Process]:
        """Return the processes that a fault hits: one of those of its role, or all.

        It is empty while none runs.
        """
        if fault.target == ALL:
            targets = []
            for role in (PHYSICS, HOST, LOGGER):
                targets += self._harvest.processes(role)
            return targets
        running = self._harvest.processes(fault.target)
        if not running:
            return []
        return [running[fault.chance % len(running)]]

    def _later(self, fault: Fault, action: Callable[[], object]) -> None:
        """Run an action when the fault's duration is over."""
        at = time.monotonic() + fault.seconds
        heapq.heappush(self._ends, _End(at, next(self._number), action))


def _mistakes_are_made(injector: FaultInjector, fault: Fault) -> bool:
    """Do nothing: the agent makes its mistakes from the first tick on."""
    return True


# Kind of fault -> what injects it, and returns whether that was possible.
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
    MISTAKES: _mistakes_are_made,
}


def _link(fault: Fault) -> int | None:
    """Return a number that selects the link that a fault hits; None: all links."""
    if fault.target == LINKS:
        return None
    return fault.chance


def _resume(processes: list[psutil.Process]) -> None:
    """Let frozen processes go on."""
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
                injector.listen(LOOK_SECONDS)
                injector.inject_due()
            injector.end()
    except BusError:
        return Execution([], [], harvest.exit_code, -1, limit)
    return Execution(
        injector.injected, injector.recoveries, harvest.exit_code, injector.tick, limit
    )


def time_limit(trial: Trial) -> float:
    """Return the seconds of wall time after which a run counts as not finished."""
    speed = LEAST_SPEED
    if trial.speed != "max":
        speed = float(trial.speed)
    return START_SECONDS + (trial.seconds or LONGEST) / speed + FAULT_SECONDS * len(trial.faults)
