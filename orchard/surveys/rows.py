"""A scenario from the lines of rows, each the centre line of a row, m on the ground.

A line goes through three frames. On the ground: easting and northing about the middle of all, m.
In the rows' frame: turned so that rows lie along x, the first one in the north. In the frame `map`
(REP-103) of the scenario: shifted to where the layout has its first row. A point is a complex
number here: easting + i northing, or x + i y.
"""

import cmath
import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from orchard.field.lanes import ROW_WEST
from orchard.field.layout import lay_out
from orchard.field.queue import LONGEST_ROW, SHORTEST_ROW
from orchard.field.scenario import Scenario, check
from orchard.field.survey import CLOSEST, SurveyedRow, faults_of
from orchard.surveys.plane import Plane, middle

# m, at most, by which a row is bent, or its ends are off the direction of all rows.
STRAIGHT = 0.2
# Decimals of lengths in the scenario, m: to the millimetre.
DIGITS = 3
# Decimals of angle and scale of the scenario's origin: over a km they are exact to 1e-5 m.
DIGITS_OF_ORIGIN = 8


class SurveyedLine(NamedTuple):
    """A row, or a line of trees, as surveyed."""

    id: str
    # (n,) complex, m, on the ground or in the rows' frame.
    points: np.ndarray


class TurnedLines(NamedTuple):
    """Lines in the rows' frame: along x, from north to south."""

    lines: list[SurveyedLine]
    #: Of the rows on the ground, rad from east.
    yaw: float


def turned(lines: Sequence[SurveyedLine]) -> TurnedLines:
    """Return lines on the ground in the rows' frame."""
    yaw = direction_of(lines)
    in_frame = [_turned(line, -yaw) for line in lines]
    in_frame.sort(key=_middle_y, reverse=True)
    return TurnedLines(in_frame, yaw)


def _turned(line: SurveyedLine, angle: float) -> SurveyedLine:
    """Return a line after a turn about the middle of all, rad counter-clockwise."""
    return SurveyedLine(line.id, line.points * cmath.exp(1j * angle))


def _middle_y(line: SurveyedLine) -> float:
    """Return the y of a line in the rows' frame, m."""
    return middle(line.points.imag)


def direction_of(lines: Sequence[SurveyedLine]) -> float:
    """Return the direction of rows on the ground, rad from east, in (-pi / 2, pi / 2].

    It is the median, so that one line that is askew does not turn the others.
    """
    vectors = [_vector(line.points) for line in lines]
    longest = max(vectors, key=abs)
    # The angle of each line to the longest one. A line may run from either end: the square of a
    # vector is the same for both.
    turns = [cmath.phase((vector / longest) ** 2) / 2 for vector in vectors]
    yaw = cmath.phase(longest) + median(turns)
    # Half a turn more or less is the same direction.
    return yaw - math.pi * math.ceil(yaw / math.pi - 0.5)


def _vector(points: np.ndarray) -> complex:
    """Return the vector from a line's first point to its last one, m.

    If the line comes back to where it began, it is that to the point farthest away.
    """
    vectors = points - points[0]
    return complex(vectors[-1] or vectors[np.abs(vectors).argmax()])


def faults_of_lines(lines: Sequence[SurveyedLine]) -> Iterator[tuple[str, str]]:
    """Yield what is wrong with lines in the rows' frame: the id of a line, and its fault."""
    is_any_askew = False
    for line in lines:
        # Off its own direction, and off that of all rows.
        own_bend = _bend(_turned(line, -cmath.phase(_vector(line.points))))
        bend = _bend(line)
        # Such a line may cross its neighbour.
        is_any_askew |= bend > CLOSEST / 2
        if own_bend > STRAIGHT:
            yield (
                line.id,
                f"is bent: {own_bend:.2f} m off a straight line; must be at most {STRAIGHT:g} m",
            )
        elif bend > STRAIGHT:
            yield (
                line.id,
                f"is not parallel: {bend:.2f} m off the direction of the rows; must be at most"
                f" {STRAIGHT:g} m",
            )
        length = float(np.ptp(line.points.real))
        if not SHORTEST_ROW <= length <= LONGEST_ROW:
            yield line.id, f"is {length:.2f} m long; must be {SHORTEST_ROW:g} to {LONGEST_ROW:g} m"
    # With a line that is askew, it is not known which rows are neighbours.
    if not is_any_askew:
        for row, fault in faults_of(_rows(lines)):
            yield row.id, fault


def drawn_twice(lines: Sequence[SurveyedLine]) -> Iterator[tuple[str, str]]:
    """Yield the ids of two lines each that lie at the same place.

    `lines`: in the rows' frame, from north to south.
    """
    for other, line in pairwise(lines):
        if np.abs(_place(other) - _place(line)).max() <= STRAIGHT:
            yield line.id, other.id


def _place(line: SurveyedLine) -> np.ndarray:
    """Return where a line along x lies, (3,) m: x of its west and of its east end, and its y."""
    xs = line.points.real
    return np.array([xs.min(), xs.max(), _middle_y(line)])


def _bend(line: SurveyedLine) -> float:
    """Return how far a line is off a straight line along x, m: half the width that it takes."""
    return float(np.ptp(line.points.imag)) / 2


def _corner(lines: Sequence[SurveyedLine]) -> complex:
    """Return the point from which starts and souths of rows count, in the rows' frame, m.

    Its x is that of the westernmost end of all lines, its y that of the first line.
    """
    west = min(float(line.points.real.min()) for line in lines)
    return complex(west, _middle_y(lines[0]))


def _rows(lines: Sequence[SurveyedLine]) -> list[SurveyedRow]:
    """Return lines in the rows' frame as rows of a scenario, from north to south.

    They are not checked: `faults_of_lines` tells what is wrong in words of the file.
    """
    corner = _corner(lines)
    rows = []
    for line in lines:
        start = round(float(line.points.real.min()) - corner.real, DIGITS)
        end = round(float(line.points.real.max()) - corner.real, DIGITS)
        south = round(corner.imag - _middle_y(line), DIGITS)
        length = round(end - start, DIGITS)
        rows.append(
            SurveyedRow.model_construct(id=line.id, south=south, start=start, length=length)
        )
    return rows


def scenario_of(turned_rows: TurnedLines, plane: Plane, file: str) -> Scenario:
    """Return the scenario of lines, with the place of its frame `map` on the earth.

    `file`: names the values in errors. Raises ScenarioError.
    """
    lines = turned_rows.lines
    yaw = turned_rows.yaw
    rows = _rows(lines)
    survey: dict[str, Any] = {"rows": [row.model_dump() for row in rows]}
    length = round(max(row.start + row.length for row in rows), DIGITS)
    values = {"rows": len(rows), "row_length": length, "survey": survey}
    # A first layout, without the origin, tells where the first row lies on the map.
    layout = lay_out(check(values, file))
    corner_on_map = complex(ROW_WEST, layout.lane(1).y)
    shift = _corner(lines) - corner_on_map
    origin = plane.middle + plane.scale * cmath.exp(1j * yaw) * shift
    survey["origin"] = {
        "crs": plane.crs,
        "x": round(origin.real, DIGITS),
        "y": round(origin.imag, DIGITS),
        "yaw": round(yaw, DIGITS_OF_ORIGIN),
        "scale": round(plane.scale, DIGITS_OF_ORIGIN),
    }
    return check(values, file)
