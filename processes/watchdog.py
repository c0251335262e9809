"""A frozen process does not die: once its liveliness token is gone for too long it is ended, so that it is started again."""

import time
from collections.abc import Callable

from processes.fleet import Fleet

SECONDS = 3.0  # for which a token may be gone: a session that was cut off comes back sooner


class Watchdog:
    """Watches one process of a fleet by its token. A process that has never been there yet is given all the time that it needs."""

    def __init__(self, fleet: Fleet, name: str, clock: Callable[[], float] = time.monotonic) -> None:
        self._fleet, self._name, self._clock = fleet, name, clock
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
