"""Whether a run is over. In an open run any client may publish an `end`: it counts only if physics goes, too."""

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

GOES_SECONDS = 3.0  # s between the message of the end and the end of physics' liveliness token, in either order


class Ending:
    """What has been said of the end of a run, and whether physics, the only one that may say it, is there."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._said: End | None = None
        self._said_at = -math.inf  # s, on the clock
        self.gone_at = math.inf  # s, on the clock: when physics went; infinity while it is there
        self._tokens: set[str] = (
            set()
        )  # of physics: two if the router has not noticed yet that the link of a dead one is closed

    def hear(self, end: End) -> None:
        self._said, self._said_at = end, self._clock()

    def track(self, token: str, up: bool) -> None:
        """Record a liveliness token of physics that appeared (`up`) or is gone."""
        (self._tokens.add if up else self._tokens.discard)(token)
        self.gone_at = math.inf if self._tokens else self._clock()

    @property
    def end(self) -> End | None:
        """The end of the run; None if it is not over, or if that is not credible."""
        return self._said if abs(self._said_at - self.gone_at) <= GOES_SECONDS else None


def write_end(end: End, path: str) -> None:
    """Write the end of a run to a file. A disk error is only logged: then the message that it publishes counts."""
    try:
        write_whole(Path(path), pack(end))
    except OSError as error:
        log.error("the end of the run could not be written: %s", error)


def read_end(path: Path, run: str) -> End | None:
    """Return the end that physics has written for this run; None if there is no complete one."""
    with suppress(OSError, Refused):
        return read_message(path.read_bytes(), End, run)
    return None
