"""What happened in a step: told to the logger, the metrics and whoever looks on."""

from typing import Literal

import msgspec

What = Literal[
    "coupled", "uncoupled", "row picked", "bin full", "unloaded", "weed flattened", "deed refused", "collision", "stopped", "reset"
]


class Event(msgspec.Struct, frozen=True):
    """Something that physics did, or did not do, in the step from `tick` to the next."""

    tick: int
    what: What
    who: str  # whose deed, or whose step it was
    whom: str = ""  # the other body that it concerns
    detail: str = ""
