"""What a run shows to those outside it: the events of a step, and one frame of the picture for each tick."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta

from orchard.contract.messages import Text, Tick

STOPPED = "stopped"  # `doing` of a robot under an emergency stop
SCAN_TICKS = 5  # frames hold scans twice a second

What = Literal[
    "coupled", "uncoupled", "row picked", "bin full", "unloaded", "weed flattened", "deed refused", "collision", "stopped", "reset"
]


class Event(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Something that happened in the step from `tick` to the next: what physics did (`What`), or a message between agents ('Call')."""

    tick: Tick
    what: Text  # a short word
    who: Annotated[Text, Meta(description="whose deed, or whose step it was")]
    whom: Annotated[Text, Meta(description="'' or the other body")] = ""
    detail: Annotated[str, Meta(max_length=1000)] = ""


SELDOM = ("coupled", "fill", "alive", "row_picked")  # what a frame may leave out because it is as before


@dataclass(slots=True)
class Frame:
    """The orchard at one tick. n bodies in the order of `layout.starts`, r rows; SI units."""

    tick: int
    poses: np.ndarray  # (n, 3) float: x, y (m), yaw (rad)
    doing: Mapping[str, str] = field(default_factory=dict)  # name -> "picking row 3"; only changes need be in here
    scans: Sequence[np.ndarray | None] | None = None  # per body its ranges, m, float32, +inf where nothing returns
    coupled: np.ndarray | None = None  # (n,) int: index of the body at the other end of the bar, or -1; None: as before
    fill: np.ndarray | None = None  # (n,) float: of bins, metres of row in it, 0 to 70; None: as before
    alive: np.ndarray | None = None  # (n,) bool: False for a weed that is flattened; None: as before
    row_picked: np.ndarray | None = None  # (r,) float: metres of each row that are picked; None: as before
    delivered: int = 0  # bins unloaded so far
    events: Sequence[Event] = ()
    figures: Mapping[str, float] = field(default_factory=dict)  # name -> value; go to metrics/
    left_out: int = 0  # frames before it that it stands for

    @property
    def is_whole(self) -> bool:
        """Whether nothing is as before: one can begin with it."""
        return all(getattr(self, name) is not None for name in SELDOM)


def merged(old: Frame, new: Frame) -> Frame:
    """One frame in the place of two: the newer one, with what else changed in the older."""
    kept = {name: getattr(old, name) for name in SELDOM if getattr(new, name) is None}
    doing, figures, events = {**old.doing, **new.doing}, {**old.figures, **new.figures}, [*old.events, *new.events]
    return replace(new, doing=doing, figures=figures, events=events, left_out=old.left_out + new.left_out + 1, **kept)
