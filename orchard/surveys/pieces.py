"""Joins the pieces of which a row is drawn to one line.

A row may be drawn in pieces as parts of one feature, as features of the same name, or as features
with names of their own. The rows' frame is one whose x axis runs along the rows, in m.
"""

import cmath
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from orchard.field.lanes import TREE_PITCH
from orchard.surveys.choosing import listed
from orchard.surveys.features import Feature
from orchard.surveys.rows import SurveyedLine, direction_of

# Pieces of one row may lie so far beside each other, m.
IN_LINE = 1.0
# Between pieces of one row with different names may lie so much, m; with the same name more.
CLOSE = 10.0
# Pieces of one row may overlap by so much, m.
OVERLAP = 0.5
# So many rows with one name: it tells nothing of a row, as that of a variety or of the block.
NAMES_NOTHING = 3


class _Piece(NamedTuple):
    """A part of a row, in the rows' frame."""

    name: str
    #: Whether other pieces have the same name.
    has_others: bool
    #: (n,) complex, x + i y, m.
    points: np.ndarray

    @property
    def west(self) -> float:
        """x of its west end, m."""
        return float(self.points.real.min())

    @property
    def east(self) -> float:
        """x of its east end, m."""
        return float(self.points.real.max())


def joined(features: Sequence[Feature]) -> tuple[list[SurveyedLine], list[str]]:
    """Return a line for each row, on the ground, and notes of what was joined.

    Rows come in the order of the file. A row has the name of its westernmost piece.
    """
    lines = []
    # Name of a row -> its place in the file.
    places: dict[str, int] = {}
    for number, feature in enumerate(features):
        places.setdefault(feature.name, number)
        for part in feature.parts:
            lines.append(SurveyedLine(feature.name, part))
    if not lines:
        return [], []
    yaw = direction_of(lines)
    pieces = _pieces(lines, yaw)
    rows = sorted(_rows(pieces), key=lambda row: places[row[0].name])
    notes = _notes(rows)
    rows, more = _numbered(rows)
    back = cmath.exp(1j * yaw)
    result = []
    for row in rows:
        points = row[0].points
        if len(row) > 1:
            points = np.concatenate([_eastward(piece.points) for piece in row])
        result.append(SurveyedLine(row[0].name, points * back))
    return result, [*notes, *more]


def _numbered(rows: list[list[_Piece]]) -> tuple[list[list[_Piece]], list[str]]:
    """Return rows with numbers as names if all have the same name, and that this was done.

    `rows`: the pieces of each row, in the rows' frame. The first number is in the north.
    """
    names = {row[0].name for row in rows}
    if len(names) > 1 or len(rows) < NAMES_NOTHING:
        return rows, []
    result = []
    for number, row in enumerate(sorted(rows, key=_north_of, reverse=True), start=1):
        result.append([piece._replace(name=f"row {number}") for piece in row])
    name = rows[0][0].name
    return result, [f"all {len(rows)} rows are named {name}: here they are row 1, row 2 and so on"]


def _north_of(row: Sequence[_Piece]) -> float:
    """Return the y of the west end of a row, m."""
    return float(_eastward(row[0].points)[0].imag)


def _pieces(lines: Sequence[SurveyedLine], yaw: float) -> list[_Piece]:
    """Return lines as pieces of rows, in the rows' frame. `yaw`: of the rows, rad."""
    names = [line.id for line in lines]
    pieces = []
    for line in lines:
        points = line.points * cmath.exp(-1j * yaw)
        pieces.append(_Piece(line.id, names.count(line.id) > 1, points))
    return pieces


def _eastward(points: np.ndarray) -> np.ndarray:
    """Return the points of a piece from west to east."""
    if points[0].real > points[-1].real:
        return points[::-1]
    return points


def _rows(pieces: Sequence[_Piece]) -> list[list[_Piece]]:
    """Return the pieces of each row, from west to east."""
    rows: list[list[_Piece]] = []
    # From west to east, so that a piece only ever follows the last piece of a row.
    for piece in sorted(pieces, key=lambda piece: piece.west):
        for row in rows:
            if _continues(row[-1], piece):
                row.append(piece)
                break
        else:
            # It continues no row, and so begins another one.
            rows.append([piece])
    return rows


def _continues(west: _Piece, east: _Piece) -> bool:
    """Whether a piece belongs to the row of another one, which lies west of it."""
    beside = abs(_eastward(east.points)[0].imag - _eastward(west.points)[-1].imag)
    gap = east.west - west.east
    if beside > IN_LINE or gap < -OVERLAP:
        return False
    is_named_alike = west.name == east.name and west.has_others
    return is_named_alike or gap <= CLOSE


def _notes(rows: Sequence[Sequence[_Piece]]) -> list[str]:
    """Return what was joined, and which gaps in rows are not gaps any more, a sentence each.

    `rows`: the pieces of each row.
    """
    several = [row for row in rows if len(row) > 1]
    if not several:
        return []
    names = listed([_named(row) for row in several])
    notes = [f"joined from pieces in one line: {names}"]
    # Width, m, and row of each gap.
    gaps = []
    for row in several:
        for west, east in pairwise(row):
            gap = east.west - west.east
            if gap > TREE_PITCH:
                gaps.append((gap, row[0].name))
    if not gaps:
        return notes
    without_trees = sum(gap for gap, _ in gaps)
    metres = sum(row[-1].east - row[0].west for row in rows)
    widest, name = max(gaps)
    count = len({name for _, name in gaps})
    share = 100.0 * without_trees / metres
    notes.append(
        f"{_rows_have(count)} wider than {TREE_PITCH:g} m, up to {widest:.2f} m (row {name}). Here"
        f" rows have no gaps: {without_trees:.0f} of {metres:.0f} m ({share:.0f} %) are picked as"
        " if fruit hung there. If robots can cross a gap, it parts two blocks: draw them so, with"
        " a property `block`"
    )
    return notes


def _rows_have(count: int) -> str:
    """Return that so many rows have gaps."""
    if count == 1:
        return "1 row has a gap"
    return f"{count} rows have gaps"


def _named(row: Sequence[_Piece]) -> str:
    """Return a row with its pieces: "r1 (2)", or "r1 and r2" of unlike names."""
    names = list(dict.fromkeys(piece.name for piece in row))
    if len(names) == 1:
        return f"{names[0]} ({len(row)} pieces)"
    return f"{names[0]} (with {listed(names[1:])})"
