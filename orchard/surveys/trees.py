"""Trees as points: finds the lines in which they stand.

If the points name their lines, each name is a line. Else their direction is found first: the ground
is cut into narrow strips in many directions, and in the right one the points lie in the fewest
strips. Points are complex numbers, easting + i northing, m on the ground.
"""

import cmath
import math
from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from orchard.surveys.choosing import listed
from orchard.surveys.features import Feature, all_points
from orchard.surveys.rows import SurveyedLine, turned

# Width of the strips in which points lie, m.
STRIP = 0.4
# Points that lie further apart than this, across the lines, stand in different lines, m.
APART = 1.2
# A line has so many trees, at least.
FEWEST_TREES = 3
# Directions that are tried at once. More would take more memory.
_BATCH = 64
# Properties that name the line of a tree, in small letters.
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
    """Return the note how many trees stand in how many lines, and how far apart."""
    steps: list[float] = []
    for line in lines:
        steps += np.abs(np.diff(line.points)).tolist()
    pitch = float(np.median(steps))
    return f"{count} trees stand in {len(lines)} lines, {pitch:.2f} m apart in a line"


def _named_lines(features: Sequence[Feature]) -> list[SurveyedLine]:
    """Return the lines that points name.

    None are returned if a point names no line, or a name has one point only: names are not those of
    lines then.
    """
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
    """Return points in their order along their line, from one end to the other.

    The order begins at the point that is farthest from the first one: that is an end of the line.
    """
    farthest = points[np.abs(points - points[0]).argmax()]
    vector = points[0] - farthest
    if vector == 0.0:
        return points
    along = (points * vector.conjugate()).real
    return np.asarray(points[np.argsort(along, kind="stable")])


def _found_lines(features: Sequence[Feature]) -> tuple[list[SurveyedLine], list[str]]:
    """Return the lines in which points stand, from north to south.

    Also return the names of points that stand in no line.
    """
    points = all_points(features)
    names = []
    for feature in features:
        for part in feature.parts:
            names += [feature.name] * len(part)
    yaw = _direction(points)
    in_frame = points * cmath.exp(-1j * yaw)
    order = np.argsort(-in_frame.imag, kind="stable")
    # Positions in `order` at which the next line begins.
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
    """Return the direction in which points lie in the fewest strips, rad from east.

    Each direction is tried with two sets of strips, the second one shifted by half a strip. So no
    line of trees lies on an edge in both.
    """
    # m, at most, from one point to another.
    extent = max(1.0, float(np.abs(points - points.mean()).max()) * 2)
    # From one direction to the next the end of a line of this length moves by half a strip.
    count = math.ceil(math.pi * extent / (STRIP / 2))
    angles = np.arange(count) * math.pi / count
    fewest = np.empty(count)
    for begin in range(0, count, _BATCH):
        turn = np.exp(-1j * angles[begin : begin + _BATCH])
        # (angles, points): m to the left of a line in each direction.
        across = (points[None, :] * turn[:, None]).imag
        fewest[begin : begin + _BATCH] = np.minimum(_filled(across), _filled(across + STRIP / 2))
    least = fewest.min()
    # Of directions that are equally good, neighbours form groups; the middle one of the first group
    # is taken.
    best = np.flatnonzero(fewest == least)
    ends_of_groups = np.flatnonzero(np.diff(best) > 1)
    group = best
    if len(ends_of_groups):
        group = best[: ends_of_groups[0] + 1]
    return float(angles[group[len(group) // 2]])


def _filled(across: np.ndarray) -> np.ndarray:
    """Return in how many strips points lie, for each direction, (angles,).

    `across`: (angles, points), m.
    """
    strips = np.sort(np.floor(across / STRIP), axis=1)
    return np.asarray((np.diff(strips, axis=1) > 0).sum(axis=1) + 1)
