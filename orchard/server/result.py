"""How physics leaves its end on the disk for whoever started it: its last message may be lost, with a router that is down just then."""

import logging
from contextlib import suppress
from pathlib import Path

from orchard.contract.messages import pack
from orchard.net.refusals import Refused, read_message
from orchard.wire.messages import End

log = logging.getLogger("orchard")


def leave(end: End, path: Path) -> None:
    """Write it. A disk that is full is told of: the message is likely to have come."""
    try:
        path.write_bytes(pack(end))
    except OSError as error:
        log.error("the end could not be left on the disk: %s", error)


def left(path: Path, run: str) -> End | None:
    """What physics, which has ended, has left of a run; None where there is nothing, or not the whole of it."""
    with suppress(OSError, Refused):
        return read_message(path.read_bytes(), End, run)
    return None
