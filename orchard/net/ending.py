"""Whether a run is over. In an open run any client may publish an `end`: it counts only if physics goes at about the same time."""

import math
from collections.abc import Callable

from orchard.wire.messages import End

GOES_SECONDS = 3.0  # s between the message of the end and the end of physics' liveliness token, in either order


class Ending:
    """What has been said of the end of a run, and whether physics, the only one that may say it, is there."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._said: End | None = None
        self._said_at = self._gone_at = -math.inf  # s, on the clock

    def hear(self, end: End) -> None:
        self._said, self._said_at = end, self._clock()

    def track(self, up: bool) -> None:
        """Hear that physics' liveliness token appeared (`up`) or disappeared."""
        self._gone_at = -math.inf if up else self._clock()

    @property
    def end(self) -> End | None:
        """The end of the run; None if it is not over, or if that is not credible."""
        return self._said if abs(self._said_at - self._gone_at) <= GOES_SECONDS else None
