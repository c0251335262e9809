"""Trees as points: the direction of their lines, and each line.

The right direction is that in which the points fill the fewest strips. If the points name their
rows, each name is a line.
"""

import cmath
import math
from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from orchard.surveys.choosing import listed
from orchard.surveys.features import Feature, all_points
from orchard.surveys.rows import SurveyedLine, turned

# m, width of the strips that points fill.
STRIP = 0.4
# m between points across the lines, from which on another line begins.
APART = 1.2
# Trees, from which on they are a line.
FEWEST_TREES = 3
# Directions that are tried at once, for the memory that they take.
_BATCH = 64
ROW_KEYS = ("row", "line", "row_id", "row_name", "rowname")


def lines_of_trees(features: Sequence[Feature]) -> tuple[list[SurveyedLine], list[str]]:
    """Return lines through trees, on the ground, and notes."""
    named = _named_lines(features)
    notes = []
    if named:
        lines = named
        notes.append(f"the {_count(features)} points name their lines")
    else:
        lines, strays = _found_lines(features)
        if strays:
            notes.append(
                f"left out, as fewer than {FEWEST_TREES} trees stand in a line: {listed(strays)}"
            )
    if len(lines) > 1:
        notes.append(_sizes(lines, _count(features)))
    return lines, notes


def _count(features: Sequence[Feature]) -> int:
    """Return how many points features have."""
    count = 0
    for feature in features:
        for part in feature.parts:
            count += part.size
    return count


def _sizes(lines: Sequence[SurveyedLine], count: int) -> str:
    """Return how many trees stand how far apart, in words."""
    steps: list[float] = []
    for line in lines:
        steps += np.abs(np.diff(line.points)).tolist()
    pitch = float(np.median(steps))
    return f"{count} trees stand in {len(lines)} lines, {pitch:.2f} m apart in a line"


def _named_lines(features: Sequence[Feature]) -> list[SurveyedLine]:
    """Return the lines that points name; none if a point names none, or a line has one point."""
    points_of: dict[str, list[complex]] = defaultdict(list)
    for feature in features:
        name = _row_name(feature)
        if not name:
            return []
        for part in feature.parts:
            points_of[name] += part.tolist()
    if min(map(len, points_of.values()), default=0) < 2:
        return []
    lines = []
    for name, points in points_of.items():
        lines.append(SurveyedLine(name, _in_order(np.array(points))))
    return lines


def _row_name(feature: Feature) -> str:
    """Return the line that a tree names; "" if it names none."""
    for key, value in feature.properties.items():
        if key.lower() in ROW_KEYS and isinstance(value, str | int):
            return str(value)
    return ""


def _in_order(points: np.ndarray) -> np.ndarray:
    """Return points in their order along the line from one end to the other."""
    farthest = points[np.abs(points - points[0]).argmax()]
    vector = points[0] - farthest
    if vector == 0.0:
        return points
    along = (points * vector.conjugate()).real
    return np.asarray(points[np.argsort(along, kind="stable")])


def _found_lines(features: Sequence[Feature]) -> tuple[list[SurveyedLine], list[str]]:
    """Return the lines in which points stand, from north to south, and the names of the others."""
    points = all_points(features)
    names = []
    for feature in features:
        for part in feature.parts:
            names += [feature.name] * len(part)
    yaw = _direction(points)
    in_frame = points * cmath.exp(-1j * yaw)
    order = np.argsort(-in_frame.imag, kind="stable")
    # A cut lies before the first point of the next line.
    cuts = np.flatnonzero(-np.diff(in_frame.imag[order]) > APART) + 1
    lines: list[SurveyedLine] = []
    strays = []
    for members in np.split(order, cuts):
        if len(members) < FEWEST_TREES:
            strays += [names[i] for i in members]
            continue
        line = points[members]
        lines.append(SurveyedLine(f"line {len(lines) + 1}", _in_order(line)))
    return _numbered(lines), strays


def _numbered(lines: list[SurveyedLine]) -> list[SurveyedLine]:
    """Return lines with names: t1 is the first one in the rows' frame, where north is up."""
    if len(lines) < 2:
        return lines
    in_frame, yaw = turned(lines)
    numbered = []
    for number, line in enumerate(in_frame, start=1):
        numbered.append(SurveyedLine(f"t{number}", line.points * cmath.exp(1j * yaw)))
    return numbered


def _direction(points: np.ndarray) -> float:
    """Return the direction in which points fill the fewest strips, rad from east.

    Two strips at a time, the second shifted by half, so that no line lies on an edge of both.
    """
    extent = max(1.0, float(np.abs(points - points.mean()).max()) * 2)
    # A line of this length stays within half a strip.
    count = math.ceil(math.pi * extent / (STRIP / 2))
    angles = np.arange(count) * math.pi / count
    fewest = np.empty(count)
    for begin in range(0, count, _BATCH):
        turn = np.exp(-1j * angles[begin : begin + _BATCH])
        across = (points[None, :] * turn[:, None]).imag
        fewest[begin : begin + _BATCH] = np.minimum(_filled(across), _filled(across + STRIP / 2))
    least = fewest.min()
    # Of directions that are equally good, the middle one of the first group.
    best = np.flatnonzero(fewest == least)
    ends_of_groups = np.flatnonzero(np.diff(best) > 1)
    group = best
    if len(ends_of_groups):
        group = best[: ends_of_groups[0] + 1]
    return float(angles[group[len(group) // 2]])


def _filled(across: np.ndarray) -> np.ndarray:
    """Return how many strips points fill, for each direction. `across`: (angles, points), m."""
    strips = np.sort(np.floor(across / STRIP), axis=1)
    return np.asarray((np.diff(strips, axis=1) > 0).sum(axis=1) + 1)
