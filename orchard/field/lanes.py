"""The rows of an orchard and its lines of trees, for `orchard/field/layout.py`: all alike, or as
surveyed.

A row is picked from the lane between two lines of trees, so `Lane` is a row. The two ways to lay
them out are `alike` and `surveyed`. Metres, in the frame `map`: x east, y north. A survey has
distances south of its first row instead, m; names of such are `souths...`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from math import ceil
from statistics import median
from typing import NamedTuple

from orchard.field.scenario import Scenario
from orchard.field.survey import (
    FURTHEST,
    MISSING,
    ROUNDING,
    TRUNK,
    Survey,
    SurveyedRow,
    spacing_of,
)

# y of the northernmost line of trees, m (manual), unless the first lane would then lie further
# north than y = FIRST_LANE, where roads and turns north of it leave no more room.
TREE_TOP_LINE = 13.5
FIRST_LANE = 10.85
# x of the first tree, m.
FIRST_TREE = -34.5
# From tree to tree in a line, m.
TREE_PITCH = 6.0
# A tree belongs to a line that is too short for it by at most this share of TREE_PITCH, which is
# rounding.
PART_OF_PITCH = 1e-9
# m, at least, from the last tree to the row's end.
LAST_TREE = 3.0
# x of the west end of the picked part of a row, m.
ROW_WEST = -35.5


@dataclass(frozen=True)
class Lane:
    """A row that is picked, between two tree lines. Rows count from 1 at the top."""

    number: int
    #: y of its centre line, m.
    y: float
    #: m/s, from end to end; the bins of a row may be picked faster or slower.
    picking_speed: float
    #: x of the west end of its picked part, m.
    west: float
    #: m, of its picked part.
    length: float
    #: m between its trees; twice the nearer side, if its centre line is not in the middle.
    width: float

    @property
    def east(self) -> float:
        """x of the east end of its picked part, m."""
        return self.west + self.length


class TreeLine(NamedTuple):
    """A line of trees: y, and the x from and up to which it has rows beside it, m."""

    y: float
    west: float
    east: float

    @property
    def trees_x(self) -> tuple[float, ...]:
        """x of each tree, m.

        Trees of all lines stand in one grid, so that the wires of the pergola run straight across:
        at FIRST_TREE, and each TREE_PITCH east and west of it. The first tree of a line stands at
        least 1 m east of its west end, as in a usual row. The last one stands at least LAST_TREE
        before its east end.
        """
        first = ceil((self.west - ROW_WEST) / TREE_PITCH - PART_OF_PITCH)
        last = int((self.east - LAST_TREE - FIRST_TREE) / TREE_PITCH + PART_OF_PITCH)
        return tuple(FIRST_TREE + TREE_PITCH * i for i in range(first, last + 1))

    @property
    def posts_x(self) -> tuple[float, ...]:
        """x of each post, m: halfway between two trees."""
        return tuple(x + TREE_PITCH / 2 for x in self.trees_x[:-1])


# All lanes and all lines of trees of an orchard, both from north to south.
Rows = tuple[tuple[Lane, ...], tuple[TreeLine, ...]]


def top_line(to_first_lane: float) -> float:
    """Return y of the northernmost line of trees, m. `to_first_lane`: from it to the first lane."""
    return min(TREE_TOP_LINE, FIRST_LANE + to_first_lane)


def alike(scenario: Scenario, speeds: Mapping[int, float]) -> Rows:
    """Return the lanes and lines of trees of rows that are all alike.

    `speeds`: row -> how fast it is picked, m/s.
    """
    pitch = spacing_of(scenario.row_width)
    top = top_line(pitch / 2)
    length = scenario.row_length
    lanes = []
    for number in range(1, scenario.rows + 1):
        y = top - (number - 0.5) * pitch
        lane = Lane(
            number=number,
            y=y,
            picking_speed=speeds[number],
            west=ROW_WEST,
            length=length,
            width=scenario.row_width,
        )
        lanes.append(lane)
    lines = []
    for number in range(scenario.rows + 1):
        lines.append(TreeLine(top - number * pitch, ROW_WEST, ROW_WEST + length))
    return tuple(lanes), tuple(lines)


def surveyed(survey: Survey, speeds: Mapping[int, float]) -> Rows:
    """Return the lanes of surveyed rows. A line of trees lies midway between two of them.

    Where rows are missing, or a road passes, each of the two has a line of trees of its own, as far
    away as midway between two rows elsewhere. `speeds`: row -> how fast it is picked, m/s.
    """
    souths_of_lines = _souths_of_lines([row.south for row in survey.rows])
    first = souths_of_lines[0][0]
    top = top_line(survey.rows[0].south - first)
    lanes = []
    for number, row in enumerate(survey.rows, start=1):
        # y of the last line north of the row, and of the first line south of it.
        y_north = top - (souths_of_lines[number - 1][-1] - first)
        y_south = top - (souths_of_lines[number][0] - first)
        y = top - (row.south - first)
        lanes.append(_lane(number, row, speeds[number], y, min(y_north - y, y - y_south)))
    lines = []
    for i, souths_in_gap in enumerate(souths_of_lines):
        # The gap before the first row and the one after the last row have one lane beside them, all
        # others two.
        beside = lanes[max(0, i - 1) : i + 1]
        if len(souths_in_gap) == 1:
            west = min(lane.west for lane in beside)
            east = max(lane.east for lane in beside)
            lines.append(TreeLine(top - (souths_in_gap[0] - first), west, east))
        else:
            # Of two lines each is as long as the row on its own side.
            for line, lane in zip(souths_in_gap, beside, strict=True):
                lines.append(TreeLine(top - (line - first), lane.west, lane.east))
    return tuple(lanes), tuple(lines)


def _souths_of_lines(souths: list[float]) -> list[list[float]]:
    """Return how far south the lines of trees lie, m: a list for each gap.

    The first list has the line before the first row, the last one the line after the last row.
    Between them is a list of one or two lines for each gap between two rows. `souths`: how far
    south each row lies, m.
    """
    gaps = [south - north for north, south in pairwise(souths)]
    # Wider gaps are none of the usual ones: rows are missing there.
    usual = median(gap for gap in gaps if gap <= FURTHEST + ROUNDING)
    between = [_lines_between(north, south, usual) for north, south in pairwise(souths)]
    # The outermost lines mirror the next ones at the first and at the last row.
    first = 2 * souths[0] - between[0][0]
    last = 2 * souths[-1] - between[-1][-1]
    return [[first], *between, [last]]


def _lines_between(north: float, south: float, usual: float) -> list[float]:
    """Return how far south the lines of trees between two rows lie, m.

    `north`, `south`: how far south the rows lie. `usual`: from a row to the next one elsewhere, m.
    """
    if south - north <= MISSING * usual:
        return [(north + south) / 2]
    return [north + usual / 2, south - usual / 2]


def _lane(number: int, row: SurveyedRow, speed: float, y: float, beside: float) -> Lane:
    """Return the lane of a surveyed row.

    `speed`: at which it is picked, m/s. `y`: of its centre line; `beside`: from there to the nearer
    line of trees, m.
    """
    return Lane(
        number=number,
        y=y,
        picking_speed=speed,
        west=ROW_WEST + row.start,
        length=row.length,
        width=2 * beside - TRUNK,
    )
