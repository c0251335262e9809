"""Ticks in wall time."""

import math
import time
from collections.abc import Callable


class Pacer:
    """Spreads ticks over wall time: `speed` simulated seconds to a second; infinity does not wait."""

    CATCH_UP = 0.25  # s of lost time that are made good

    def __init__(self, speed: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._step = 0.1 / speed
        self._clock = clock
        self._due = -math.inf

    def wait(self) -> float:
        """Seconds until the next tick may begin."""
        return max(0.0, self._due - self._clock())

    def begin(self) -> float:
        """A tick begins; so many seconds after it was due."""
        now = self._clock()
        due = now if self._due == -math.inf else self._due
        self._due = max(due, now - self.CATCH_UP) + self._step
        return max(0.0, now - due)
