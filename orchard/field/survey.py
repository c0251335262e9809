"""The section `survey` of a scenario: the rows of a real orchard, and where on the earth they lie.

`orchard layout import` (orchard/surveys) writes it, and `orchard/field/lanes.py` lays its rows out.
They are parallel to the x axis of the frame `map` (REP-103), the first one in the north. The roads
at both ends of the rows are straight, and lie beyond the row that reaches furthest there.
"""

import cmath
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Annotated

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from orchard.field.problems import Section
from orchard.field.queue import LONGEST_ROW, SHORTEST_ROW

# Limits of the number of rows.
FEWEST_ROWS = 3
MOST_ROWS = 100
# Width of a tree's trunk, which is square, and of a post, m.
TRUNK = 0.5
# m, at least, from a row's centre line to the next one's. So a picker that turns out of its row
# with its bin stays 5 cm and more off a picker that stands straight at the next row
# (docs/traffic.md).
CLOSEST = 3.65
# Width of a row between its trees, m: at least, that of the manual, and at most.
NARROWEST_ROW = CLOSEST - TRUNK
USUAL_WIDTH = 5.0
WIDEST_ROW = 12.0
# m, at most, from a row's centre line to the next one's where no row is missing.
FURTHEST = WIDEST_ROW + TRUNK
# Between two rows that are more than so many usual spacings apart, rows are missing, or a road
# passes.
MISSING = 1.8
# m, at most, between two rows where some are missing, or where a farm road passes.
WIDEST_GAP = 60.0
# m by which a length may miss a limit, because decimals of a file are rounded.
ROUNDING = 1e-6
# Decimals of a width that is computed from a spacing. They cut the error of the subtraction off:
# 3.66 - 0.5 is 3.16, and not 3.1600000000000001.
DECIMALS = 9
# No control characters: names are printed.
NAME = r"^[^\x00-\x1f\x7f-\x9f]+$"


def spacing_of(row_width: float) -> float:
    """Return the spacing of rows as growers measure it, m: from one tree line to the next.

    It is also that from lane to lane. `row_width`: m between the trees of a row, as in a scenario.

    >>> spacing_of(4.0)
    4.5
    """
    return row_width + TRUNK


def row_width_of(spacing: float) -> float:
    """Return the width of a row between its trees, m: the inverse of `spacing_of`.

    >>> row_width_of(3.66)
    3.16
    """
    return round(spacing - TRUNK, DECIMALS)


class SurveyedRow(Section):
    """A row that is picked: the centre line of the lane between two lines of trees."""

    id: Annotated[
        str, Field(pattern=NAME, max_length=60, description="the row's name in the survey")
    ]
    south: Annotated[
        float,
        Field(
            ge=0.0,
            le=MOST_ROWS * WIDEST_GAP,
            description="how far south of the first row its centre line lies, m",
        ),
    ]
    start: Annotated[
        float,
        Field(
            ge=0.0,
            le=LONGEST_ROW,
            description="how far east of the westernmost row's end its west end lies, m",
        ),
    ]
    length: Annotated[
        float, Field(ge=SHORTEST_ROW, le=LONGEST_ROW, description="length of its picked part, m")
    ]


class Origin(Section):
    """Where the frame `map` lies in a projected coordinate system.

    It is shifted by x and y, turned by yaw, and scaled.
    """

    crs: Annotated[
        str,
        Field(
            pattern=NAME,
            max_length=200,
            description="projected coordinate system, such as EPSG:2193",
        ),
    ]
    x: Annotated[
        float,
        Field(
            ge=-1e9,
            le=1e9,
            description="easting of the origin of the frame map, in the system's unit",
        ),
    ]
    y: Annotated[
        float,
        Field(
            ge=-1e9,
            le=1e9,
            description="northing of the origin of the frame map, in the system's unit",
        ),
    ]
    yaw: Annotated[
        float,
        Field(
            ge=-3.2,
            le=3.2,
            description="from the system's east to the x axis of map, counter-clockwise, rad",
        ),
    ]
    scale: Annotated[
        float, Field(ge=0.1, le=10.0, description="the system's units in a metre on the ground")
    ]

    def place(self, x: float, y: float) -> tuple[float, float]:
        """Return easting and northing, in the system's unit, of a point of the frame map, m."""
        # As complex numbers: easting or x is the real part, northing or y the imaginary one.
        at = complex(self.x, self.y) + self.scale * cmath.exp(1j * self.yaw) * complex(x, y)
        return at.real, at.imag


IN_ORDER = "the rows, from north to south"


class Survey(Section):
    """Surveyed rows, from north to south, and where they lie on the earth."""

    rows: Annotated[
        tuple[SurveyedRow, ...],
        Field(strict=False, min_length=FEWEST_ROWS, max_length=MOST_ROWS, description=IN_ORDER),
    ]
    origin: Annotated[
        Origin | None, Field(description="where the frame map lies on the earth; null: not known")
    ] = None

    @property
    def length(self) -> float:
        """From the westernmost end of a row to the easternmost one, m."""
        return max(row.start + row.length for row in self.rows)

    @model_validator(mode="after")
    def _within_limits(self) -> "Survey":
        """Check the rows together. All their faults are one error, about the key `rows`."""
        faults = [f"{row.id}: {fault}" for row, fault in faults_of(self.rows)]
        if faults:
            error = {
                "text": "; ".join(faults),
                "fields": ("rows",),
                "values": (f"{len(self.rows)} rows",),
            }
            raise PydanticCustomError("rule", "{text}", error)
        return self


def faults_of(rows: Sequence[SurveyedRow]) -> Iterator[tuple[SurveyedRow, str]]:
    """Yield the rows that do not fit the others, and for each what is wrong and the limit.

    `rows`: from north to south.
    """
    yield from _faults_of_spacing(rows)
    yield from _faults_of_ends(rows)
    names = set[str]()
    for row in rows:
        if row.id in names:
            yield row, "the name of two rows; each needs its own"
        names.add(row.id)


def _faults_of_spacing(rows: Sequence[SurveyedRow]) -> Iterator[tuple[SurveyedRow, str]]:
    """Yield the rows that lie too near to or too far from others, and what is wrong."""
    first = rows[0]
    if first.south:
        yield first, f"is the first, and lies {first.south:g} m south of it; its south must be 0"
    for north, row in pairwise(rows):
        gap = row.south - north.south
        if not CLOSEST - ROUNDING <= gap <= WIDEST_GAP + ROUNDING:
            limits = f"{CLOSEST:g} to {WIDEST_GAP:g} m from centre line to centre line"
            yield row, f"lies {gap:.2f} m south of row {north.id}; must be {limits}"
    gaps = [row.south - north.south for north, row in pairwise(rows)]
    # With no two neighbours there is no usual spacing, and so no place for the lines of trees.
    # Gaps that are too wide have a fault already.
    if gaps and min(gaps) > FURTHEST + ROUNDING and max(gaps) <= WIDEST_GAP + ROUNDING:
        limits = f"two neighbours must be at most {FURTHEST:g} m apart"
        yield first, f"has no neighbour, and neither has any other row: {limits}"


def _faults_of_ends(rows: Sequence[SurveyedRow]) -> Iterator[tuple[SurveyedRow, str]]:
    """Yield the westernmost and the easternmost row if they are wrong, and what is wrong."""
    westernmost = min(rows, key=lambda row: row.start)
    easternmost = max(rows, key=lambda row: row.start + row.length)
    west = westernmost.start
    east = easternmost.start + easternmost.length
    if west:
        fault = f"is the westernmost, and starts at {west:g} m; its start must be 0"
        yield westernmost, fault
    if east - west > LONGEST_ROW + ROUNDING:
        fault = f"ends {east - west:.2f} m east of the westernmost end"
        yield easternmost, f"{fault}; must be at most {LONGEST_ROW:g} m"
