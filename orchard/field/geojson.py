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

# m, at most, from a point of a row to its straight line, and to the direction of all rows.
STRAIGHT = 0.2
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
    lines, problems = _lines(content, file)
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
    lines = [_turned(line, -yaw) for line in lines]
    lines.sort(key=_middle_y, reverse=True)
    problems += [Problem(file, text, f"feature {name}") for name, text in _faults(lines)]
    if problems:
        raise ScenarioError(problems)
    return _scenario(lines, plane, yaw, file)


def _turned(line: SurveyedLine, angle: float) -> SurveyedLine:
    """Return a line after a turn about the middle of all, rad counter-clockwise."""
    return SurveyedLine(line.id, line.points * cmath.exp(1j * angle))


def _middle_y(line: SurveyedLine) -> float:
    """Return the y of a line in the rows' frame, m."""
    return _middle(line.points.imag)


# -- file -> lines


def _content(path: Path, file: str) -> dict[str, Any]:
    """Return what a file holds, with a list of features. Raises ScenarioError."""
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


def _lines(content: dict[str, Any], file: str) -> tuple[list[SurveyedLine], list[Problem]]:
    """Return the lines of all features in the file's system, and what is wrong with the others."""
    lines = []
    problems = []
    for number, feature in enumerate(content["features"], start=1):
        members = feature if isinstance(feature, dict) else {}
        name = _name(members, number)
        try:
            lines.append(SurveyedLine(name, _points(members.get("geometry"))))
        except ValueError as error:
            problems.append(Problem(file, str(error), f"feature {name}"))
    return lines, problems


def _name(feature: dict[str, Any], number: int) -> str:
    """Return what names a feature: its id, a property, or else its number in the file."""
    candidates = [feature.get("id")]
    properties = feature.get("properties")
    if isinstance(properties, dict):
        candidates += [properties.get(name) for name in NAMES]
    for candidate in candidates:
        if isinstance(candidate, str | int) and str(candidate):
            return printable(str(candidate), 60)
    return f"number {number}"


def _points(geometry: Any) -> np.ndarray:
    """Return the points of a geometry, (n,) complex.

    Raises ValueError for what is no line. A MultiLineString of one line is one.
    """
    members = geometry if isinstance(geometry, dict) else {}
    kind = members.get("type")
    coordinates = members.get("coordinates")
    if kind == "MultiLineString" and isinstance(coordinates, list) and len(coordinates) == 1:
        kind = "LineString"
        coordinates = coordinates[0]
    if kind != "LineString":
        raise ValueError(
            f"is {show(kind)}; each feature must be one LineString, the centre line of a row"
        )
    if not isinstance(coordinates, list):
        coordinates = []
    points = np.array([_point(number, pair) for number, pair in enumerate(coordinates, start=1)])
    if len(points) < 2 or np.abs(points - points[0]).max() == 0.0:
        raise ValueError("must have at least two different points")
    return points


def _point(number: int, coordinates: Any) -> complex:
    """Return a point. Raises ValueError, with its number in the line, for what is none."""
    try:
        x, y, *_ = coordinates
        # "176.3" and true are no numbers of JSON.
        are_numbers = type(x) in (int, float) and type(y) in (int, float)
        point = complex(math.nan)
        if are_numbers:
            point = complex(float(x), float(y))
    except (TypeError, ValueError, OverflowError):
        point = complex(math.nan)
    if not cmath.isfinite(point):
        text = printable(json.dumps(coordinates), 60)
        raise ValueError(
            f"its point {number} is {text}; each point must be two finite numbers, such as [176.3,"
            " -37.8]"
        )
    return point


# -- coordinate systems


def _on_a_plane(lines: Sequence[SurveyedLine], name: str) -> tuple[Plane, list[SurveyedLine]]:
    """Return a projected system that keeps angles, and the lines in it, m about their middle.

    `name`: of the lines' own system. Raises ValueError if it cannot be used.
    """
    from pyproj import CRS
    from pyproj.exceptions import ProjError

    try:
        own = CRS.from_user_input(name)
        if not (own.is_geographic or own.is_projected):
            raise ValueError(
                f"{_words(name)} has no places on a map: it is {own.type_name}; {RIGHT_SYSTEM}"
            )
        # This also finds points outside a projected system.
        on_globe = _converted(own, own.geodetic_crs or own, lines)
        crs = own
        scale = _scale(own, _middle_of(lines)) if own.is_projected else 0.0
        if not scale:
            crs = CRS.from_epsg(_utm_zone(_middle_of(on_globe)))
            lines = _converted(own, crs, lines)
            scale = _scale(crs, _middle_of(lines))
    except (ProjError, UnicodeError) as error:
        fault = str(error).rpartition("proj_create: ")[2].rstrip(")")
        raise ValueError(
            f"{_words(name)} cannot be used: {printable(fault)}; {RIGHT_SYSTEM}"
        ) from None
    plane = Plane(crs.to_string(), _middle_of(lines), scale)
    in_metres = [
        SurveyedLine(line.id, (line.points - plane.middle) / plane.scale) for line in lines
    ]
    return plane, in_metres


def _utm_zone(place: complex) -> int:
    """Return the EPSG number of the zone of UTM at a longitude and latitude, degrees."""
    zone = int((place.real + 180.0) // 6.0) % 60 + 1
    is_south = place.imag < 0
    return (32700 if is_south else 32600) + zone


def _words(name: str) -> str:
    """Return a coordinate system in words."""
    return f"the coordinate system {printable(name, 60)!r}"


def _converted(source: Any, target: Any, lines: Sequence[SurveyedLine]) -> list[SurveyedLine]:
    """Return lines of one coordinate system in another one.

    Raises ValueError for a point that is no place in the first one.
    """
    from pyproj import Transformer

    transformer = Transformer.from_crs(source, target, always_xy=True)
    most_x = 180.0 if source.is_geographic else math.inf
    most_y = 90.0 if source.is_geographic else math.inf
    converted = []
    for line in lines:
        x, y = transformer.transform(line.points.real, line.points.imag)
        # A place that is none is infinite, and refused below.
        with np.errstate(invalid="ignore"):
            points = np.asarray(x) + 1j * np.asarray(y)
        is_within = np.abs(line.points.real) <= most_x
        is_within &= np.abs(line.points.imag) <= most_y
        is_place = is_within & np.isfinite(points)
        if not is_place.all():
            point = complex(line.points[~is_place][0])
            raise ValueError(
                f"({point.real:.10g}, {point.imag:.10g}) of feature {line.id} is no place in the"
                f" coordinate system {printable(source.name)}; {RIGHT_SYSTEM}"
            )
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
    scales = []
    for axis in (1, 1j):
        begin = middle - units * axis / 2
        end = middle + units * axis / 2
        lon, lat = to_globe.transform([begin.real, end.real], [begin.imag, end.imag])
        _, _, metres = crs.get_geod().inv(lon[0], lat[0], lon[1], lat[1])
        scales.append(units / metres)
    scale_east, scale_north = scales
    if abs(scale_east / scale_north - 1.0) > CONFORMAL:
        return 0.0
    return float(scale_east)


def _middle_of(lines: Sequence[SurveyedLine]) -> complex:
    """Return the middle of all points."""
    points = np.concatenate([line.points for line in lines])
    return complex(_middle(points.real), _middle(points.imag))


def _middle(values: np.ndarray) -> float:
    """Return the middle between the least and the greatest value."""
    return float(values.min() + values.max()) / 2


# -- lines -> rows


def _direction(lines: Sequence[SurveyedLine]) -> float:
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


def _faults(lines: Sequence[SurveyedLine]) -> Iterator[tuple[str, str]]:
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


def _scenario(lines: Sequence[SurveyedLine], plane: Plane, yaw: float, file: str) -> Scenario:
    """Return the scenario of lines in the rows' frame, with the origin of its frame `map`.

    `yaw`: of the rows in the plane, rad. Raises ScenarioError.
    """
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
