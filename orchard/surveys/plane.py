"""Coordinate systems: from that of a file to metres on the ground.

Features are put into a projected system that keeps angles: their own if it does, else the zone of
UTM in which they lie. A point is a complex number here: easting + i northing, or longitude + i
latitude in a geographic system. Only this module and swapped.py use pyproj. It is in the extra
`survey`, and so it is imported where it is used.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from orchard.field.problems import printable
from orchard.surveys.features import LONGITUDE_LATITUDE, Feature, all_points

RIGHT_SYSTEM = "name that of the file, geographic or projected: --crs EPSG:2193, for example"
# m along each axis, over which scale and north of a system are measured.
STEP = 100.0
# The share by which the scales along both axes may differ in a system that keeps angles.
CONFORMAL = 1e-4
# EPSG numbers of UTM, to which the number of a zone is added.
UTM_NORTH = 32600
UTM_SOUTH = 32700


class Plane(NamedTuple):
    """A projected coordinate system at an orchard."""

    crs: str
    #: The middle of the orchard, in the system's unit.
    middle: complex
    #: The system's units in a metre on the ground.
    scale: float
    #: The direction of north at the middle, rad from the system's east.
    north: float


def on_a_plane(features: Sequence[Feature], name: str) -> tuple[Plane, list[Feature]]:
    """Return a projected system that keeps angles, and the features in it, m about their middle.

    `name`: of the features' own system. Raises ValueError if it cannot be used.
    """
    from pyproj import CRS
    from pyproj.exceptions import ProjError

    try:
        own = CRS.from_user_input(name)
        if not (own.is_geographic or own.is_projected):
            raise ValueError(
                f"{_words(name)} has no places on a map: it is {own.type_name}; {RIGHT_SYSTEM}"
            )
        # In longitude and latitude. This also finds points that lie outside a projected system.
        on_globe = _converted(own, own.geodetic_crs or own, features)
        crs = own
        scale = 0.0
        if own.is_projected:
            scale = _scale(own, _middle_of(features))
        # A geographic system, or a projected one that does not keep angles.
        if not scale:
            crs = CRS.from_epsg(_utm_zone(_middle_of(on_globe)))
            features = _converted(own, crs, features)
            scale = _scale(crs, _middle_of(features))
    except (ProjError, UnicodeError) as error:
        fault = str(error).rpartition("proj_create: ")[2].rstrip(")")
        raise ValueError(
            f"{_words(name)} cannot be used: {printable(fault)}; {RIGHT_SYSTEM}"
        ) from None
    middle_of_all = _middle_of(features)
    plane = Plane(crs.to_string(), middle_of_all, scale, _north(crs, middle_of_all, scale))
    in_metres = []
    for feature in features:
        parts = tuple((points - plane.middle) / plane.scale for points in feature.parts)
        in_metres.append(feature._replace(parts=parts))
    return plane, in_metres


def _utm_zone(place: complex) -> int:
    """Return the EPSG number of the zone of UTM at a place.

    `place`: longitude + i latitude, degrees. A zone is 6 degrees wide; the first of 60 begins at
    longitude -180.
    """
    zone = int((place.real + 180.0) // 6.0) % 60 + 1
    if place.imag < 0:
        return UTM_SOUTH + zone
    return UTM_NORTH + zone


def _words(name: str) -> str:
    """Return a coordinate system in words."""
    return f"the coordinate system {printable(name, 60)!r}"


def _converted(source: Any, target: Any, features: Sequence[Feature]) -> list[Feature]:
    """Return features of the coordinate system `source` in the system `target`, both of pyproj.

    Raises ValueError for a point that is no place in `source`.
    """
    from pyproj import Transformer

    transformer = Transformer.from_crs(source, target, always_xy=True)
    most_x = math.inf
    most_y = math.inf
    if source.is_geographic:
        most_x = 180.0
        most_y = 90.0
    converted = []
    for feature in features:
        parts = []
        for part in feature.parts:
            x, y = transformer.transform(part.real, part.imag)
            # pyproj returns infinity for a point that is no place; it is refused below.
            with np.errstate(invalid="ignore"):
                points = np.asarray(x) + 1j * np.asarray(y)
            is_within = np.abs(part.real) <= most_x
            is_within &= np.abs(part.imag) <= most_y
            is_place = is_within & np.isfinite(points)
            if not is_place.all():
                point = complex(part[~is_place][0])
                raise ValueError(
                    f"({point.real:.10g}, {point.imag:.10g}) of feature {feature.name} is no place"
                    f" in the coordinate system {printable(source.name)}; {RIGHT_SYSTEM}"
                )
            parts.append(points)
        converted.append(feature._replace(parts=tuple(parts)))
    return converted


def _scale(crs: Any, middle: complex) -> float:
    """Return a projected system's units in a metre on the ground; 0 if it does not keep angles.

    It does not if these units differ between its axes. It is 0 too if its axes are not east and
    north. `middle`: where they are measured.
    """
    from pyproj import Transformer

    if {axis.direction for axis in crs.axis_info[:2]} != {"east", "north"}:
        return 0.0
    to_globe = Transformer.from_crs(crs, crs.geodetic_crs, always_xy=True)
    # STEP in the system's unit.
    units = STEP / crs.axis_info[0].unit_conversion_factor
    scales = []
    # A unit to the east, and a unit to the north.
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


def _north(crs: Any, middle: complex, scale: float) -> float:
    """Return the direction of true north at a place of a projected system, rad from its east.

    `middle`: the place. `scale`: the system's units in a metre.
    """
    from pyproj import Transformer

    to_globe = Transformer.from_crs(crs, crs.geodetic_crs, always_xy=True)
    end = middle + STEP * scale * 1j
    lon, lat = to_globe.transform([middle.real, end.real], [middle.imag, end.imag])
    # Of the system's own north, degrees clockwise from true north.
    azimuth, _, _ = crs.get_geod().inv(lon[0], lat[0], lon[1], lat[1])
    return math.pi / 2 + math.radians(azimuth)


def _middle_of(features: Sequence[Feature]) -> complex:
    """Return the middle of the box around all points."""
    points = all_points(features)
    return complex(middle(points.real), middle(points.imag))


def middle(values: np.ndarray) -> float:
    """Return the middle between the least and the greatest value."""
    return float(values.min() + values.max()) / 2


def place_on_globe(plane: Plane) -> tuple[float, float]:
    """Return latitude and longitude of the middle of an orchard, degrees."""
    from pyproj import Transformer

    to_globe = Transformer.from_crs(plane.crs, LONGITUDE_LATITUDE, always_xy=True)
    longitude, latitude = to_globe.transform(plane.middle.real, plane.middle.imag)
    return latitude, longitude
