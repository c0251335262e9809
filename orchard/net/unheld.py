"""Robots that no session holds: the newest velocity drives them, for half a second."""

import time
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from orchard.contract.agent import Action
from orchard.net.refusals import WHOSE, Refused, refuse_other_tick
from orchard.wire.codec import action_of
from orchard.wire.messages import Velocity

WATCHDOG = 0.5  # s: for how long one velocity drives a robot that nobody holds; of the clock that is slower, simulated or wall
WATCHDOG_TICKS = 5


class RecentTicks:
    """The ticks of the last half second, and of the last five: how old a velocity may be that still drives a robot."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.clock = clock
        self._begun: deque[tuple[int, float]] = deque([(0, clock())])  # (tick, when it was published)

    def begin(self, tick: int) -> None:
        """A new tick is published."""
        self._begun.append((tick, self.clock()))
        while self.is_over(*self._begun[0], tick):
            self._begun.popleft()

    @property
    def oldest(self) -> int:
        return self._begun[0][0]

    @property
    def newest(self) -> int:
        return self._begun[-1][0]

    def is_over(self, tick: int, at: float, now: int) -> bool:
        """Whether a velocity for a tick, which came at some time, drives no longer at the tick `now`."""
        return now - tick >= WATCHDOG_TICKS and self.clock() - at >= WATCHDOG


class TimedVelocity(NamedTuple):
    """A velocity, and when it came."""

    velocity: Velocity
    at: float  # s, monotonic


class UnheldCommands:
    """Robots that no agent holds: the newest velocity drives them, for half a second."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._recent = RecentTicks(clock)
        self._puts: dict[str, TimedVelocity] = {}

    def begin(self, tick: int) -> None:
        """A new tick is published."""
        self._recent.begin(tick)

    def take(self, name: str, velocity: Velocity) -> None:
        if velocity.holder:
            raise Refused("not held", WHOSE["not held"])
        newest_put = self._puts[name].velocity.tick if name in self._puts else 0
        refuse_other_tick(velocity.tick, max(self._recent.oldest, newest_put), self._recent.newest)
        self._puts[name] = TimedVelocity(velocity, self._recent.clock())

    def drives(self, name: str) -> bool:
        """Whether somebody has driven it lately."""
        return name in self._puts

    def actions(self, tick: int) -> dict[str, Action]:
        is_over = self._recent.is_over
        self._puts = {name: put for name, put in self._puts.items() if not is_over(put.velocity.tick, put.at, tick)}
        return {name: Action(action_of(put.velocity).twist) for name, put in self._puts.items()}
