"""A scenario from surveyed rows: the lines of a GeoJSON file (RFC 7946), each the centre line of a
row, in any coordinate system.

The lines are put into a projected system that keeps angles: their own, or the zone of UTM. There
one rotation, one shift and the system's scale lead to the frame `map`: metres on the ground, rows
along x, the first one in the north (REP-103). A point is a complex number here: easting + i
northing, or x + i y. Only this module uses pyproj, and only when rows are imported: it is in the
extra `survey`.
"""

import cmath
import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from orchard.field.layout import ROW_WEST, lay_out
from orchard.field.problems import Problem, ScenarioError, key_text, printable, show
from orchard.field.queue import LONGEST_ROW, SHORTEST_ROW
from orchard.field.scenario import Scenario, check
from orchard.field.survey import CLOSEST, FEWEST_ROWS, MOST_ROWS, SurveyedRow, faults_of
from orchard.folders import regular

STRAIGHT = (
    0.2  # m, at most, from a point of a row to its straight line, and to the direction of all rows
)
LARGEST_FILE = 10_000_000  # bytes
LONGITUDE_LATITUDE = "OGC:CRS84"  # of a GeoJSON file that names no system (RFC 7946)
RIGHT_SYSTEM = "name that of the file, geographic or projected: --crs EPSG:2193, for example"
NAMES = ("id", "fid", "name", "row")  # properties that name a feature without an id
STEP = 100.0  # m along each axis, in which the scale of a system is measured
CONFORMAL = 1e-4  # share by which its scales along both axes may differ
DIGITS = 3  # of metres, in the scenario


class SurveyedLine(NamedTuple):
    """A row as surveyed."""

    id: str
    # (n,) complex: in the file's system, then m on the ground about the middle of all, then m in
    # the rows' frame.
    points: np.ndarray


class Plane(NamedTuple):
    """A projected coordinate system at an orchard."""

    crs: str
    middle: complex  # of the orchard, in the system's unit
    scale: float  # of the system's units in a metre on the ground


def import_rows(path: Path, crs: str | None = None) -> Scenario:
    """Return a scenario with the rows of a GeoJSON file.

    `crs`: their coordinate system, such as EPSG:2193; None: the one in the file.

    Raises ScenarioError with all that does not fit, and ModuleNotFoundError if pyproj is not
    installed.
    """
    file = key_text(str(path))
    content = _content(path, file)
    found = list(_lines(content, file))
    lines, problems = (
        [one for one in found if isinstance(one, SurveyedLine)],
        [one for one in found if isinstance(one, Problem)],
    )
    if not FEWEST_ROWS <= len(lines) <= MOST_ROWS:
        wanted = (
            f"must be {FEWEST_ROWS} to {MOST_ROWS} LineStrings; of a larger orchard, a file for"
            " each block"
        )
        problems.append(Problem(file, f"has {len(lines)} rows; {wanted}"))
    if not lines:
        raise ScenarioError(problems)
    try:
        plane, lines = _on_a_plane(lines, _named_system(content) if crs is None else crs)
    except ValueError as error:
        raise ScenarioError([*problems, Problem(file, str(error))]) from None
    yaw = _direction(lines)
    lines = [SurveyedLine(line.id, line.points * cmath.exp(-1j * yaw)) for line in lines]
    lines.sort(key=lambda line: -_middle(line.points.imag))
    problems += [Problem(file, text, f"feature {name}") for name, text in _faults(lines, yaw)]
    if problems:
        raise ScenarioError(problems)
    return _scenario(lines, plane, yaw, file)


# -- file -> lines


def _content(path: Path, file: str) -> dict[str, Any]:
    try:
        with regular(path).open("rb") as opened:
            text = opened.read(LARGEST_FILE + 1)
        content = json.loads(text) if len(text) <= LARGEST_FILE else None
    except OSError as error:
        raise ScenarioError([Problem(file, f"cannot be read: {error.strerror}")]) from None
    except (ValueError, RecursionError) as error:
        raise ScenarioError([Problem(file, f"is not JSON: {printable(str(error))}")]) from None
    if not isinstance(content, dict) or not isinstance(content.get("features"), list):
        raise ScenarioError(
            [Problem(file, f"must be a GeoJSON FeatureCollection of at most {LARGEST_FILE} bytes")]
        )
    return content


def _named_system(content: dict[str, Any]) -> str:
    """The coordinate system that a file names, as GeoJSON of 2008 does, and QGIS and GDAL
    still do.
    """
    crs = content.get("crs")
    properties = crs.get("properties") if isinstance(crs, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    return name if isinstance(name, str) else LONGITUDE_LATITUDE


def _lines(content: dict[str, Any], file: str) -> Iterator[SurveyedLine | Problem]:
    for number, feature in enumerate(content["features"], start=1):
        content_of_line = feature if isinstance(feature, dict) else {}
        name = _name(content_of_line, number)
        try:
            yield SurveyedLine(name, _points(content_of_line.get("geometry")))
        except ValueError as error:
            yield Problem(file, str(error), f"feature {name}")


def _name(feature: dict[str, Any], number: int) -> str:
    properties = feature.get("properties")
    known = [
        feature.get("id"),
        *(properties.get(name) for name in NAMES if isinstance(properties, dict)),
    ]
    return next(
        (printable(str(name), 60) for name in known if isinstance(name, str | int) and str(name)),
        f"number {number}",
    )


def _points(geometry: Any) -> np.ndarray:
    kind, given = (
        (geometry.get("type"), geometry.get("coordinates", ()))
        if isinstance(geometry, dict)
        else (None, ())
    )
    if kind == "MultiLineString" and isinstance(given, list) and len(given) == 1:
        kind, given = "LineString", given[0]
    if kind != "LineString":
        raise ValueError(
            f"is {show(kind)}; each feature must be one LineString, the centre line of a row"
        )
    points = np.array(
        [
            _point(number, one)
            for number, one in enumerate(given if isinstance(given, list) else [], start=1)
        ]
    )
    if len(points) < 2 or np.abs(points - points[0]).max() == 0.0:
        raise ValueError("must have at least two different points")
    return points


def _point(number: int, given: Any) -> complex:
    try:
        x, y, *_ = given
        point = complex(float(x), float(y))
    except (TypeError, ValueError, OverflowError):
        point = complex(math.nan)
    if not cmath.isfinite(point):
        told = printable(json.dumps(given), 60)
        raise ValueError(
            f"its point {number} is {told}; each point must be two finite numbers, such as [176.3,"
            " -37.8]"
        )
    return point


# -- coordinate systems


def _on_a_plane(lines: Sequence[SurveyedLine], name: str) -> tuple[Plane, list[SurveyedLine]]:
    from pyproj import CRS
    from pyproj.exceptions import ProjError

    try:
        given = CRS.from_user_input(name)
        if not (given.is_geographic or given.is_projected):
            raise ValueError(
                f"{_words(name)} has no places on a map: it is {given.type_name}; {RIGHT_SYSTEM}"
            )
        globe = _converted(given, given.geodetic_crs or given, lines)
        crs, scale = given, _scale(given, _middle_of(lines)) if given.is_projected else 0.0
        if not scale:
            middle = _middle_of(globe)
            crs = CRS.from_epsg(
                (32700 if middle.imag < 0 else 32600) + int((middle.real + 180.0) // 6.0) % 60 + 1
            )
            lines = _converted(given, crs, lines)
            scale = _scale(crs, _middle_of(lines))
    except (ProjError, UnicodeError) as error:
        fault = str(error).rpartition("proj_create: ")[2].rstrip(")")
        raise ValueError(
            f"{_words(name)} cannot be used: {printable(fault)}; {RIGHT_SYSTEM}"
        ) from None
    plane = Plane(crs.to_string(), _middle_of(lines), scale)
    return plane, [
        SurveyedLine(line.id, (line.points - plane.middle) / plane.scale) for line in lines
    ]


def _words(name: str) -> str:
    return f"the coordinate system {printable(name, 60)!r}"


def _converted(given: Any, wanted: Any, lines: Sequence[SurveyedLine]) -> list[SurveyedLine]:
    from pyproj import Transformer

    transformer = Transformer.from_crs(given, wanted, always_xy=True)
    most = complex(180.0, 90.0) if given.is_geographic else complex(math.inf, math.inf)
    converted = []
    for line in lines:
        x, y = transformer.transform(line.points.real, line.points.imag)
        points = np.asarray(x) + 1j * np.asarray(y)
        is_there = (
            (np.abs(line.points.real) <= most.real)
            & (np.abs(line.points.imag) <= most.imag)
            & np.isfinite(points)
        )
        if not is_there.all():
            at = complex(line.points[~is_there][0])
            words = (
                f"({at.real:.10g}, {at.imag:.10g}) of feature {line.id} is no place in the"
                f" coordinate system {printable(given.name)}"
            )
            raise ValueError(f"{words}; {RIGHT_SYSTEM}")
        converted.append(SurveyedLine(line.id, points))
    return converted


def _scale(crs: Any, middle: complex) -> float:
    """Return a projected system's units in a metre on the ground; 0 if they differ between its
    axes, or these are not east and north.
    """
    from pyproj import Transformer

    if {axis.direction for axis in crs.axis_info[:2]} != {"east", "north"}:
        return 0.0
    to_globe = Transformer.from_crs(crs, crs.geodetic_crs, always_xy=True)
    units = STEP / crs.axis_info[0].unit_conversion_factor
    ends = [middle + units * side * axis / 2 for axis in (1, 1j) for side in (-1, 1)]
    lon, lat = to_globe.transform([end.real for end in ends], [end.imag for end in ends])
    _, _, metres = crs.get_geod().inv(lon[::2], lat[::2], lon[1::2], lat[1::2])
    east, north = units / metres[0], units / metres[1]
    return float(east) if abs(east / north - 1.0) <= CONFORMAL else 0.0


def _middle_of(lines: Sequence[SurveyedLine]) -> complex:
    points = np.concatenate([line.points for line in lines])
    return complex(_middle(points.real), _middle(points.imag))


def _middle(values: np.ndarray) -> float:
    return float(values.min() + values.max()) / 2


# -- lines -> rows


def _direction(lines: Sequence[SurveyedLine]) -> float:
    """Return the rows' direction, rad, in (-pi / 2, pi / 2]: the median, so that one line that is
    askew does not turn the others.
    """
    ways = [_way(line.points) for line in lines]
    longest = max(ways, key=abs)
    yaw = cmath.phase(longest) + median(cmath.phase((way / longest) ** 2) / 2 for way in ways)
    return yaw - math.pi * math.ceil(yaw / math.pi - 0.5)


def _way(points: np.ndarray) -> complex:
    """Return the way from a line's first point to its last one; to the farthest one, if the line
    comes back to where it began.
    """
    ways = points - points[0]
    return complex(ways[-1] or ways[np.abs(ways).argmax()])


def _faults(lines: Sequence[SurveyedLine], yaw: float) -> Iterator[tuple[str, str]]:
    askew = False
    for line in lines:
        length = float(np.ptp(line.points.real))
        own, off = (
            _bend(line.points * cmath.exp(-1j * cmath.phase(_way(line.points)))),
            _bend(line.points),
        )
        askew |= off > CLOSEST / 2
        if own > STRAIGHT:
            yield (
                line.id,
                f"is bent: {own:.2f} m off a straight line; must be at most {STRAIGHT:g} m",
            )
        elif off > STRAIGHT:
            yield (
                line.id,
                (
                    f"is not parallel: {off:.2f} m off the direction of the rows; must be at most"
                    f" {STRAIGHT:g} m"
                ),
            )
        if not SHORTEST_ROW <= length <= LONGEST_ROW:
            yield line.id, f"is {length:.2f} m long; must be {SHORTEST_ROW:g} to {LONGEST_ROW:g} m"
    if not askew:  # else it is not known which rows are neighbours
        yield from ((row.id, fault) for row, fault in faults_of(_rows(lines)))


def _bend(points: np.ndarray) -> float:
    return float(np.ptp(points.imag)) / 2


def _rows(lines: Sequence[SurveyedLine]) -> list[SurveyedRow]:
    first, west = (
        _middle(lines[0].points.imag),
        min(float(line.points.real.min()) for line in lines),
    )
    rows = []
    for line in lines:
        start, end = (
            round(float(x) - west, DIGITS) for x in (line.points.real.min(), line.points.real.max())
        )
        south = round(first - _middle(line.points.imag), DIGITS)
        rows.append(
            SurveyedRow.model_construct(
                id=line.id, south=south, start=start, length=round(end - start, DIGITS)
            )
        )
    return rows


def _scenario(lines: Sequence[SurveyedLine], plane: Plane, yaw: float, file: str) -> Scenario:
    rows = tuple(_rows(lines))
    survey: dict[str, Any] = {"rows": [row.model_dump() for row in rows]}
    length = round(max(row.start + row.length for row in rows), DIGITS)
    values = {"rows": len(rows), "row_length": length, "survey": survey}
    layout = lay_out(check(values, file))
    here = complex(
        min(float(line.points.real.min()) for line in lines), _middle(lines[0].points.imag)
    )  # the corner from which rows count
    origin = plane.middle + plane.scale * cmath.exp(1j * yaw) * (
        here - complex(ROW_WEST, layout.lane(1).y)
    )
    x, y = round(origin.real, DIGITS), round(origin.imag, DIGITS)
    survey["origin"] = {
        "crs": plane.crs,
        "x": x,
        "y": y,
        "yaw": round(yaw, 8),
        "scale": round(plane.scale, 8),
    }
    return check(values, file)
