"""The clock of a run: wall time that stands while the run is paused, for how many ticks the run plays, and the pace of its ticks."""

import math
from collections.abc import Callable

from orchard.field.scenario import TIME_STEP


class RunClock:
    """Deadlines, pace and watchdogs of a run read this clock, so a pause makes no agent late and no velocity old.

    A pause takes effect between two steps. `pause`, `play` and `count_step` are called by the thread that reads the clock.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._left: float = math.inf  # steps that are done before the run is paused
        self._since: float | None = None  # s, on `clock`: the begin of the pause; None while the run plays
        self._paused = 0.0  # s in all pauses that are over

    def __call__(self) -> float:
        """Return the time, s."""
        return (self._clock() if self._since is None else self._since) - self._paused

    @property
    def is_paused(self) -> bool:
        return self._since is not None

    def pause(self) -> None:
        """Let the clock stand from now on."""
        if self._since is None:
            self._since = self._clock()

    def play(self, steps: float = math.inf) -> None:
        """Let the clock go on, for so many steps."""
        self._left = steps
        if self._since is not None:
            self._paused += self._clock() - self._since
            self._since = None

    def count_step(self) -> None:
        """Record that a step is done. After the last one of `play` the clock stands."""
        self._left -= 1
        if self._left <= 0:
            self.pause()


class Pacer:
    """Paces ticks in wall time: `speed` simulated seconds per second; with infinity it never waits."""

    CATCH_UP = 0.25  # s: the largest delay that later ticks make up for

    def __init__(self, speed: float, clock: Callable[[], float]) -> None:
        self._step = TIME_STEP / speed
        self._clock = clock
        self._due = -math.inf

    def wait(self) -> float:
        """Return the seconds until the next tick may begin."""
        return max(0.0, self._due - self._clock())

    def begin(self) -> float:
        """Begin a tick, and return the seconds that it begins late."""
        now = self._clock()
        due = now if self._due == -math.inf else self._due
        self._due = max(due, now - self.CATCH_UP) + self._step
        return max(0.0, now - due)
