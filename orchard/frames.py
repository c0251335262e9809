"""What the picture is made of: one plain frame a tick, from whoever runs the orchard to whoever shows it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np


class Event(NamedTuple):
    """Something worth telling: `what` is a short word ('call', 'offer', 'couple'), `whom` is '' where nobody is meant."""

    what: str
    who: str
    whom: str
    text: str


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
    events: Sequence[tuple[str, str, str, str]] = ()  # see Event
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
