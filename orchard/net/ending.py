"""Whether a run is over, for hosts, the logger and the follower of a run.

Theory of operation. In an open run any client may publish an `end`. It counts only if the
liveliness token of physics goes too, within GOES_SECONDS before or after it. Physics publishes the
end before it removes the token; but a router may pass them on in another order.
"""

import logging
import math
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from orchard.contract.messages import pack
from orchard.folders import write_whole
from orchard.net.refusals import Refused, read_message
from orchard.wire.messages import End

log = logging.getLogger("orchard")

# s between the message of the end and the end of physics' liveliness token, in either order.
GOES_SECONDS = 3.0


class Ending:
    """What has been heard of the end of a run, and whether physics is there.

    >>> ending = Ending(clock=lambda: 12.0)
    >>> ending.track("orchard/alive/physics/a1/s1", up=True)
    >>> ending.hear(End("a1", 5, True, "harvested", "0" * 64, {}))
    >>> ending.end is None  # the token of physics is still there
    True
    >>> ending.track("orchard/alive/physics/a1/s1", up=False)
    >>> ending.end.why
    'harvested'
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._heard: End | None = None
        self._heard_at = -math.inf  # s, on the clock
        # s, on the clock: when the last token of physics went; infinity while one is there, and
        # before the first one.
        self.gone_at = math.inf
        # The tokens of physics. There are two if physics has just been restarted, and the router
        # has not noticed yet that the process before is dead.
        self._tokens: set[str] = set()

    def hear(self, end: End) -> None:
        """Record a message of the end. Another one takes its place."""
        self._heard = end
        self._heard_at = self._clock()

    def track(self, token: str, up: bool) -> None:
        """Record a liveliness token of physics that appeared (`up`) or is gone."""
        if up:
            self._tokens.add(token)
        else:
            self._tokens.discard(token)
        self.gone_at = math.inf if self._tokens else self._clock()

    @property
    def end(self) -> End | None:
        """The end of the run; None if it is not over, or if that is not credible."""
        # It is False while nothing was heard, or physics is there: then a time is infinite.
        has_gone_too = abs(self._heard_at - self.gone_at) <= GOES_SECONDS
        if not has_gone_too:
            return None
        return self._heard


def write_end(end: End, path: str) -> None:
    """Write the end of a run to a file.

    A disk error is only logged: then the message that physics publishes counts.
    """
    try:
        write_whole(Path(path), pack(end))
    except OSError as error:
        log.error("the end of the run could not be written: %s", error)


def read_end(path: Path, run: str) -> End | None:
    """Return the end that physics has written for this run; None if there is no complete one."""
    with suppress(OSError, Refused):
        return read_message(path.read_bytes(), End, run)
    return None
