"""Reads GeoJSON (RFC 7946), in any coordinate system."""

import cmath
import json
import math
from typing import Any

import numpy as np

from orchard.field.problems import Problem, ScenarioError, printable, show
from orchard.surveys.features import (
    LINE,
    LONGITUDE_LATITUDE,
    NAMES,
    POINT,
    POLYGON,
    Feature,
    SurveyFile,
    fault_of_holes,
    name_of,
)

# Type of a geometry -> the kind of feature, and whether its coordinates are a list of parts. Points
# are one part, also if there are several.
_KINDS = {
    "Point": (POINT, False),
    "MultiPoint": (POINT, False),
    "LineString": (LINE, False),
    "MultiLineString": (LINE, True),
    "Polygon": (POLYGON, False),
    "MultiPolygon": (POLYGON, True),
}


def read_geojson(text: bytes, file: str) -> SurveyFile:
    """Return what a GeoJSON text holds. Raises ScenarioError if it is none."""
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ScenarioError([Problem(file, f"is not JSON: {printable(str(error))}")]) from None
    if not isinstance(content, dict) or not isinstance(content.get("features"), list):
        raise ScenarioError([Problem(file, "must be a GeoJSON FeatureCollection")])
    features = []
    problems = []
    for number, members in enumerate(content["features"], start=1):
        if isinstance(members, dict):
            features.append(_feature(members, number))
        else:
            wanted = "must be a Feature, a map with a geometry"
            problem = Problem(file, f"is {show(members)}; {wanted}", f"feature number {number}")
            problems.append(problem)
    return SurveyFile(features, _named_system(content), problems)


def _named_system(content: dict[str, Any]) -> str:
    """Return the coordinate system that a file names; LONGITUDE_LATITUDE if it names none.

    GeoJSON of 2008 can name one, and QGIS and GDAL still write it.
    """
    match content.get("crs"):
        case {"properties": {"name": str(name)}}:
            return name
    return LONGITUDE_LATITUDE


def _feature(members: dict[str, Any], number: int) -> Feature:
    """Return a feature of the file. `members`: of its JSON. `number`: its place, from 1."""
    properties = members.get("properties")
    if not isinstance(properties, dict):
        properties = {}
    name = name_of([members.get("id"), *(properties.get(key) for key in NAMES)], number)
    geometry = members.get("geometry")
    if not isinstance(geometry, dict):
        geometry = {}
    kind_in_file = geometry.get("type")
    kind = ""
    has_several = False
    if isinstance(kind_in_file, str):
        kind, has_several = _KINDS.get(kind_in_file, ("", False))
    feature = Feature(name, kind, show(kind_in_file), (), properties)
    if not kind:
        return feature
    coordinates_of_parts: Any = geometry.get("coordinates")
    if not has_several:
        coordinates_of_parts = [coordinates_of_parts]
    try:
        parts = _parts(coordinates_of_parts, kind, kind_in_file == "Point")
    except ValueError as error:
        return feature._replace(fault=str(error))
    holes = 0
    if kind == POLYGON:
        # The first ring of a polygon is its outline, each further one a hole.
        holes = sum(len(rings) - 1 for rings in coordinates_of_parts)
    return feature._replace(parts=tuple(parts), fault=fault_of_holes(holes))


def _parts(coordinates_of_parts: Any, kind: str, is_single: bool) -> list[np.ndarray]:
    """Return the points of each part of a feature. Raises ValueError if there are none.

    `is_single`: whether a part is one point, and no list of points.
    """
    if not isinstance(coordinates_of_parts, list):
        raise ValueError("must have at least two different points")
    if not coordinates_of_parts:
        raise ValueError("has no points")
    return [_part(coordinates, kind, is_single) for coordinates in coordinates_of_parts]


def _part(coordinates: Any, kind: str, is_single: bool) -> np.ndarray:
    """Return the points of a line, of a polygon's outline, or of points, (n,) complex.

    Raises ValueError for coordinates that are none of them. `is_single`: see `_parts`.
    """
    if is_single:
        coordinates = [coordinates]
    if not isinstance(coordinates, list):
        coordinates = []
    if kind == POLYGON and coordinates:
        # The first ring is the outline; the others are holes, which `_feature` refuses.
        coordinates = coordinates[0]
        if not isinstance(coordinates, list):
            coordinates = []
    points = np.array([_point(number, pair) for number, pair in enumerate(coordinates, start=1)])
    if kind != POINT and (len(points) < 2 or np.abs(points - points[0]).max() == 0.0):
        raise ValueError("must have at least two different points")
    return points


def _point(number: int, coordinates: Any) -> complex:
    """Return a point, and leave out its height. Raises ValueError for coordinates of no point.

    `number`: of the point in its part, from 1, for the error.
    """
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
