"""One harvest, and what happens to it: faults when their ticks have come, their ends when their time is over, and who recovers when."""

import heapq
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from itertools import count
from typing import NamedTuple

import psutil

from chaos.harvest import Harvest
from chaos.place import DELAY_SECONDS, Place
from chaos.schedule import ALL, BYTES, CUT, DELAY, FREEZE, HOST, KILL, LINKS, LOGGER, PHYSICS, ROUTER, STALL, Fault, Trial
from chaos.stranger import babble
from orchard.net.bus import Bus, Sample, client
from orchard.net.endpoints import BusError
from orchard.net.refusals import Refused, read_message
from orchard.wire.keys import Keys
from orchard.wire.messages import Clock
from orchard.wire.types import read

UNDER_WAY = 3  # ticks that may be under way when a fault begins; further ones were stepped after it
START_SECONDS = 90.0  # for a run to begin, and beyond all that is reckoned
FAULT_SECONDS = 30.0  # that one fault may hold a run up
LONGEST = 700.0  # s, simulated: more than a whole harvest takes


class Recovery(NamedTuple):
    """A fault, and how long it took until the run was further than it had been."""

    fault: str
    seconds: float  # of wall time, from the fault's beginning


class Course(NamedTuple):
    """What was done to a run, and what it did."""

    injected: list[str]  # the names of the faults
    recoveries: list[Recovery]
    exit_code: int | None  # None: it did not end in time
    last: int  # the last tick that was heard
    limit: float  # s, the time that it had


class Ordeal:
    """Does to a run what its trial says."""

    def __init__(self, trial: Trial, harvest: Harvest, place: Place, bus: Bus) -> None:
        """`bus`: that of somebody who listens, at the place itself."""
        self._harvest, self._place, self._bus = harvest, place, bus
        self._to_come = list(trial.faults)
        self._ends: list[tuple[float, int, Callable[[], object]]] = []  # (when on the clock, one after the other, what)
        self._number = count()
        self._hurt: list[tuple[Fault, float, int]] = []  # (fault, when on the clock, the tick then)
        self._strangers: list[threading.Thread] = []
        self._run = ""
        self.tick = -1
        self.injected: list[str] = []
        self.recoveries: list[Recovery] = []

    def listen(self, seconds: float) -> None:
        """Hear the clock; everything that is there, or the next that comes in time."""
        while isinstance(item := self._bus.inbox.take(seconds), Sample):
            self._hear(item)
            seconds = 0.0

    def _hear(self, sample: Sample) -> None:
        """The clock of the run, or what a stranger says in its place."""
        with suppress(Refused, ValueError):
            self._run = self._run or read(sample.payload, Clock).run
            self.tick = read_message(sample.payload, Clock, self._run).tick
        now = time.monotonic()
        self.recoveries += [Recovery(fault.name, now - begun) for fault, begun, tick in self._hurt if self.tick > tick + UNDER_WAY]
        self._hurt = [hurt for hurt in self._hurt if self.tick <= hurt[2] + UNDER_WAY]

    def look(self) -> None:
        """Do what it is time for."""
        while self._to_come and self._to_come[0].tick <= self.tick:
            fault = self._to_come.pop(0)
            if DEEDS[fault.kind](self, fault):
                self.injected.append(fault.name)
                begun = time.monotonic()
                self.listen(0.0)
                self._hurt.append((fault, begun, self.tick))
        while self._ends and self._ends[0][0] <= time.monotonic():
            heapq.heappop(self._ends)[2]()

    def end(self) -> None:
        """End all faults that last."""
        while self._ends:
            heapq.heappop(self._ends)[2]()
        for stranger in self._strangers:
            stranger.join(20.0)

    # -- the deeds; each tells whether it could be done

    def _kill(self, fault: Fault) -> bool:
        if fault.target == ROUTER:
            self._later(fault, self._place.start_router)
            return self._place.kill_router()
        for process in (victims := self._victims(fault)):
            with suppress(psutil.NoSuchProcess):
                process.kill()
        return bool(victims)

    def _freeze(self, fault: Fault) -> bool:
        for process in (victims := self._victims(fault)):
            with suppress(psutil.NoSuchProcess):
                process.suspend()
        self._later(fault, lambda: _wake(victims))
        return bool(victims)

    def _cut(self, fault: Fault) -> bool:
        if self._place.relay is not None:
            self._place.relay.cut(_which(fault))
        return self._place.relay is not None

    def _stall(self, fault: Fault) -> bool:
        if self._place.relay is not None:
            self._place.relay.stall(_which(fault))
            self._later(fault, self._place.relay.heal)
        return self._place.relay is not None

    def _delay(self, fault: Fault) -> bool:
        if self._place.relay is not None:
            self._place.relay.delay(_which(fault), DELAY_SECONDS)
            self._later(fault, self._place.relay.heal)
        return self._place.relay is not None

    def _babble(self, fault: Fault) -> bool:
        """In a thread of its own: a router that is frozen holds up whoever speaks to it."""
        stranger = threading.Thread(target=babble, args=(self._place.endpoint, self._run, fault.chance), daemon=True)
        stranger.start()
        self._strangers.append(stranger)
        return True

    def _victims(self, fault: Fault) -> list[psutil.Process]:
        """One of those that there are, or everybody; nobody while they are away."""
        if fault.target == ALL:
            return [process for role in (PHYSICS, HOST, LOGGER) for process in self._harvest.processes(role)]
        there = self._harvest.processes(fault.target)
        return [there[fault.chance % len(there)]] if there else []

    def _later(self, fault: Fault, what: Callable[[], object]) -> None:
        heapq.heappush(self._ends, (time.monotonic() + fault.seconds, next(self._number), what))


DEEDS: dict[str, Callable[[Ordeal, Fault], bool]] = {
    KILL: Ordeal._kill,
    FREEZE: Ordeal._freeze,
    CUT: Ordeal._cut,
    STALL: Ordeal._stall,
    DELAY: Ordeal._delay,
    BYTES: Ordeal._babble,
}


def _which(fault: Fault) -> int | None:
    """Which link; None: all of them."""
    return None if fault.target == LINKS else fault.chance


def _wake(processes: list[psutil.Process]) -> None:
    for process in processes:
        with suppress(psutil.NoSuchProcess):
            process.resume()


def undergo(trial: Trial, harvest: Harvest, place: Place) -> Course:
    """Follow a run, which has been started, until it ends or its time is over."""
    limit = time_limit(trial)
    deadline = time.monotonic() + limit
    try:
        with client(place.endpoint, seconds=START_SECONDS) as bus:
            ordeal = Ordeal(trial, harvest, place, bus)
            bus.subscribe(Keys().of("clock"))
            while harvest.exit_code is None and time.monotonic() < deadline:
                ordeal.listen(0.05)
                ordeal.look()
            ordeal.end()
    except BusError:
        return Course([], [], harvest.exit_code, -1, limit)
    return Course(ordeal.injected, ordeal.recoveries, harvest.exit_code, ordeal.tick, limit)


def time_limit(trial: Trial) -> float:
    """Seconds of wall time, after which a run counts as one that does not finish."""
    speed = 10.0 if trial.speed == "max" else float(trial.speed)
    return START_SECONDS + (trial.seconds or LONGEST) / speed + FAULT_SECONDS * len(trial.faults)
