"""A scenario from the lines of rows, each the centre line of a row, m on the ground.

One rotation and one shift lead to the frame `map`: rows along x, the first one in the north
(REP-103). A point is a complex number here: easting + i northing, or x + i y.
"""

import cmath
import math
from collections.abc import Iterator, Sequence
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from orchard.field.lanes import ROW_WEST
from orchard.field.layout import lay_out
from orchard.field.queue import LONGEST_ROW, SHORTEST_ROW
from orchard.field.scenario import Scenario, check
from orchard.field.survey import CLOSEST, SurveyedRow, faults_of
from orchard.surveys.plane import Plane, middle

# m, at most, from a point of a row to its straight line, and to the direction of all rows.
STRAIGHT = 0.2
# Of metres, in the scenario.
DIGITS = 3


class SurveyedLine(NamedTuple):
    """A row as surveyed."""

    id: str
    # (n,) complex, m on the ground about the middle of all, then m in the rows' frame.
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
    """Return the rows' direction, rad, in (-pi / 2, pi / 2]: the median, so that one line that is
    askew does not turn the others.
    """
    vectors = [_vector(line.points) for line in lines]
    longest = max(vectors, key=abs)
    # A line may run from either end: the square of a vector is the same for both.
    turns = [cmath.phase((vector / longest) ** 2) / 2 for vector in vectors]
    yaw = cmath.phase(longest) + median(turns)
    return yaw - math.pi * math.ceil(yaw / math.pi - 0.5)


def _vector(points: np.ndarray) -> complex:
    """Return the vector from a line's first point to its last one; to the farthest one, if the line
    comes back to where it began.
    """
    vectors = points - points[0]
    return complex(vectors[-1] or vectors[np.abs(vectors).argmax()])


def faults_of_lines(lines: Sequence[SurveyedLine]) -> Iterator[tuple[str, str]]:
    """Yield what is wrong with lines in the rows' frame: the id of a line, and its fault."""
    is_any_askew = False
    for line in lines:
        own_bend = _bend(_turned(line, -cmath.phase(_vector(line.points))))
        bend = _bend(line)
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


def _bend(line: SurveyedLine) -> float:
    """Return how far a line is from a straight one along x, m."""
    return float(np.ptp(line.points.imag)) / 2


def _corner(lines: Sequence[SurveyedLine]) -> complex:
    """Return the corner from which rows count: the x that lies farthest west, the first row's y."""
    west = min(float(line.points.real.min()) for line in lines)
    return complex(west, _middle_y(lines[0]))


def _rows(lines: Sequence[SurveyedLine]) -> list[SurveyedRow]:
    """Return lines in the rows' frame as rows of a scenario, from north to south."""
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


def scenario_of(rows_on_ground: TurnedLines, plane: Plane, file: str) -> Scenario:
    """Return the scenario of lines, with the origin of its frame `map`. Raises ScenarioError."""
    lines = rows_on_ground.lines
    yaw = rows_on_ground.yaw
    rows = _rows(lines)
    survey: dict[str, Any] = {"rows": [row.model_dump() for row in rows]}
    length = round(max(row.start + row.length for row in rows), DIGITS)
    values = {"rows": len(rows), "row_length": length, "survey": survey}
    layout = lay_out(check(values, file))
    corner_on_map = complex(ROW_WEST, layout.lane(1).y)
    shift = _corner(lines) - corner_on_map
    origin = plane.middle + plane.scale * cmath.exp(1j * yaw) * shift
    survey["origin"] = {
        "crs": plane.crs,
        "x": round(origin.real, DIGITS),
        "y": round(origin.imag, DIGITS),
        "yaw": round(yaw, 8),
        "scale": round(plane.scale, 8),
    }
    return check(values, file)
