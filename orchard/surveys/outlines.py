"""Lines of rows from polygons: each polygon is a row, or one is the outline of a block.

In an outline rows are laid out. Points are complex numbers here, x + i y, m on the ground.
"""

import cmath
import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from orchard.field.problems import Problem, ScenarioError
from orchard.field.queue import SHORTEST_ROW
from orchard.field.survey import CLOSEST, FEWEST_ROWS, FURTHEST
from orchard.surveys.choosing import listed
from orchard.surveys.features import Feature
from orchard.surveys.options import ImportOptions, Source
from orchard.surveys.rows import SurveyedLine

# A polygon is a row if its length is at least so many times its width.
ELONGATED = 3.0
# m without trees at both ends of the rows in an outline, where the user does not say it.
HEADLAND = 0.0
# Degrees.
FULL_TURN = 360.0
# Rows by which a number of rows may miss a whole number because of rounding.
ROUNDING = 1e-6


def lines_of_polygons(
    features: Sequence[Feature], north: float, source: Source
) -> tuple[list[SurveyedLine], list[str]]:
    """Return the centre lines of rows, on the ground, and notes. Raises ScenarioError.

    `north`: its direction, rad from the x axis.
    """
    options = source.options
    are_rows = len(features) >= FEWEST_ROWS and all(map(_is_row, features))
    if options.spacing is None and are_rows:
        lines = [SurveyedLine(row.name, _centre_line(row.parts[0])) for row in features]
        widths = [_sizes(row.parts[0])[1] for row in features]
        note = (
            f"{len(lines)} polygons are taken for rows, {min(widths):.2f} to {max(widths):.2f} m"
            " wide, by their centre lines"
        )
        return lines, [note]
    names = listed([feature.name for feature in features])
    if options.spacing is None:
        example = source.command(spacing=5.0, direction=30.0, headland=8.0)
        text = (
            f"has {len(features)} polygons, and no rows: {names}. If one is the outline of a"
            " block, say how its rows lie: m between them, clockwise from north, m without trees"
            f" at both ends, for example {example}"
        )
        raise ScenarioError([Problem(source.file, text)])
    if len(features) > 1 or len(features[0].parts) > 1:
        text = f"has several outlines, {names}; leave out all but one: --without NAME"
        raise ScenarioError([Problem(source.file, text)])
    return _rows_in(features[0], north, source)


def _sizes(outline: np.ndarray) -> tuple[float, float]:
    """Return length and width of a polygon, along its longest side, m."""
    turned = outline * cmath.exp(-1j * _longest_side(outline))
    return float(np.ptp(turned.real)), float(np.ptp(turned.imag))


def _longest_side(outline: np.ndarray) -> float:
    """Return the direction of the longest side of a polygon, rad from the x axis."""
    sides = np.diff(np.append(outline, outline[0]))
    return cmath.phase(complex(sides[np.abs(sides).argmax()]))


def _is_row(feature: Feature) -> bool:
    """Whether a polygon is one row: long for its width, and no wider than rows can be."""
    if len(feature.parts) != 1:
        return False
    length, width = _sizes(feature.parts[0])
    return length >= ELONGATED * width and width <= FURTHEST


def _centre_line(outline: np.ndarray) -> np.ndarray:
    """Return the ends of the line through the middle of a polygon, (2,) complex."""
    turn = cmath.exp(1j * _longest_side(outline))
    turned = outline / turn
    middle = (turned.imag.min() + turned.imag.max()) / 2
    ends = np.array(
        [complex(turned.real.min(), middle), complex(turned.real.max(), middle)],
    )
    return ends * turn


def _check(options: ImportOptions) -> None:
    """Check the options of rows that are laid out in an outline. Raises ScenarioError."""
    spacing = options.spacing
    assert spacing is not None
    headland = options.headland
    problems = []
    if not CLOSEST <= spacing <= FURTHEST:
        text = f"must be {CLOSEST:g} to {FURTHEST:g} m between two rows"
        problems.append(Problem("--spacing", f"{spacing:g}: {text}"))
    if headland is not None and not 0.0 <= headland < math.inf:
        problems.append(Problem("--headland", f"{headland:g}: must be at least 0 m"))
    if options.direction is not None and not -FULL_TURN <= options.direction <= FULL_TURN:
        text = f"must be {-FULL_TURN:g} to {FULL_TURN:g} degrees clockwise from north"
        problems.append(Problem("--direction", f"{options.direction:g}: {text}"))
    if problems:
        raise ScenarioError(problems)


def _rows_in(
    feature: Feature, north: float, source: Source
) -> tuple[list[SurveyedLine], list[str]]:
    """Return rows in an outline, and notes.

    The first row lies half the spacing inside the edge, each further one a spacing away. `north`:
    its direction, rad from the x axis.
    """
    options = source.options
    spacing = options.spacing
    assert spacing is not None
    headland = options.headland
    _check(source.options)
    outline = feature.parts[0]
    notes = []
    if headland is None:
        headland = HEADLAND
        notes.append(
            "assumed: rows end at the outline; --headland METRES says how much has no trees"
        )
    if options.direction is None:
        yaw = _longest_side(outline)
        bearing = math.degrees(north - yaw) % 180.0
        notes.append(
            f"assumed: rows run along the longest side, {bearing:.1f} degrees clockwise from"
            " north; --direction DEGREES says otherwise"
        )
    else:
        yaw = north - math.radians(options.direction)
    # In a frame whose x axis runs along the rows.
    turn = cmath.exp(1j * yaw)
    in_frame = outline / turn
    lines: list[SurveyedLine] = []
    # Numbers of rows that are too short, and that leave the outline and come back.
    short = 0
    parted = 0
    top = float(in_frame.imag.max())
    count = int((np.ptp(in_frame.imag) - spacing / 2) / spacing + ROUNDING) + 1
    for number in range(count):
        y = top - spacing * (number + 0.5)
        spans = _spans(in_frame, y)
        parted += len(spans) > 1
        west, east = max(spans, key=lambda span: span[1] - span[0], default=(0.0, 0.0))
        if east - west - 2 * headland < SHORTEST_ROW:
            short += 1
            continue
        ends = np.array([complex(west + headland, y), complex(east - headland, y)])
        lines.append(SurveyedLine(f"r{len(lines) + 1}", ends * turn))
    if short:
        notes.append(f"left out: {short} rows in the outline, shorter than {SHORTEST_ROW:g} m")
    if parted:
        notes.append(f"{parted} rows leave the outline and come back: the longest part is taken")
    notes.append(
        f"{len(lines)} rows are laid out in the outline {feature.name}, {spacing:g} m apart, the"
        " first one half of that inside its edge"
    )
    return lines, notes


def _spans(outline: np.ndarray, y: float) -> list[tuple[float, float]]:
    """Return the parts of a line along x that lie inside a polygon: x from and to of each, m.

    `outline`: (n,) complex. `y`: of the line, m.
    """
    crossings = []
    for begin, end in pairwise([*outline.tolist(), complex(outline[0])]):
        crosses_line = (begin.imag <= y) != (end.imag <= y)
        if crosses_line:
            share = (y - begin.imag) / (end.imag - begin.imag)
            crossings.append(begin.real + share * (end.real - begin.real))
    crossings.sort()
    # The line enters the polygon at every second crossing, and leaves it at the next one.
    return list(zip(crossings[::2], crossings[1::2], strict=False))
