"""The two sides of the rows, and the roads as drawings show them.

A route (orchard/plans/route.py) has its figures for the east side and rows of the usual length. A
`Side` turns them into the places of either side, in the frame `map`.
"""

from dataclasses import dataclass
from typing import NamedTuple

from orchard.field.kinds import KINDS
from orchard.field.layout import MIDDLE
from orchard.plans.sense import Box

_OPPOSITE = {"EAST": "WEST", "WEST": "EAST", "NORTH": "SOUTH", "SOUTH": "NORTH"}


@dataclass(frozen=True)
class Side:
    """One side of the rows.

    It turns a route's figures, for the east side and rows of the usual length, into x and y of
    either side. With rows of the usual length the west side is the east side after half a turn
    about x = -1.5, where carriers drive one way, or mirrored at x = -1.5.
    """

    #: 'east' or 'west'.
    name: str
    #: +1 east, -1 west.
    sign: int
    #: +1 if carriers that deliver drive south on this side, -1 if north.
    south: int
    #: How much further east the east side lies than with rows of the usual length, m.
    shift: float = 0.0

    def x(self, east: float) -> float:
        """Return x, m, of a point that lies at x = `east` on the east side of usual rows."""
        if self.sign > 0:
            return east + self.shift
        # The west side lies where it lies with rows of the usual length, so MIDDLE has no shift.
        return 2.0 * MIDDLE - east

    def y(self, lane_y: float, along: float) -> float:
        """Return y of a point `along` metres past a lane's centre line, m.

        Past is in the direction in which carriers that deliver drive. A negative `along` is before.
        """
        return lane_y - self.south * along

    def heading(self, east: str) -> str:
        """Return the heading on this side that corresponds to a heading on the east side.

        `east`: a key of HEADINGS, as the result.
        """
        if east in ("EAST", "WEST"):
            is_turned = self.sign < 0
        else:
            is_turned = self.south < 0
        if is_turned:
            return _OPPOSITE[east]
        return east

    def place(self, road: str, lane: int) -> str:
        """Return the name of a road's place at a lane, such as 'east/D/3'. `road`: 'D' or 'F'."""
        return f"{self.name}/{road}/{lane}"

    def crossing(self, lane: int) -> list[str]:
        """Return the places of both roads at a lane."""
        return [self.place("F", lane), self.place("D", lane)]


class Road(NamedTuple):
    """A road as drawings show it."""

    # 'D', 'F' or 'picker': a key of COLOURS in orchard/report/plan.py.
    name: str
    # x, y of its centre line, m.
    points: list[tuple[float, float]]
    # m; 0: the pickers' way, which is drawn as a dashed line.
    width: float


def box_of(kind: str, x: float, y: float) -> Box:
    """Return the box of a body of a kind at (x, y), m, that faces east or west."""
    return Box(x, y, KINDS[kind].length / 2, KINDS[kind].width / 2)
