"""Finds coordinates that seem swapped: latitude before longitude, or northing before easting.

A point is easting + i northing, or longitude + i latitude. Degrees of longitude have no begin: an
area may reach over 180 degrees, so differences are taken in a circle of 360.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from orchard.surveys.features import Feature, all_points

# A place may lie so far outside the area for which a system is meant, degrees.
NEAR = 2.0
# EPSG lists areas with names, among them all countries. A place lies on land if an area of at most
# so many square degrees holds it. Areas that hold an ocean are larger.
LARGEST_COUNTRY = 8000.0


def with_swapped(features: Sequence[Feature]) -> list[Feature]:
    """Return features whose first coordinate was the northing, with the easting first."""
    result = []
    for feature in features:
        parts = tuple(part.imag + 1j * part.real for part in feature.parts)
        result.append(feature._replace(parts=parts))
    return result


def reason_to_swap(features: Sequence[Feature], name: str) -> str:
    """Return why the coordinates of features seem swapped; "" if they do not.

    `name`: of their coordinate system.
    """
    from pyproj import CRS
    from pyproj.exceptions import ProjError

    try:
        own = CRS.from_user_input(name)
    except (ProjError, UnicodeError):
        # It is reported where it is used.
        return ""
    points = all_points(features)
    middle = complex(np.median(points.real), np.median(points.imag))
    swapped = complex(middle.imag, middle.real)
    if own.is_geographic:
        return _of_degrees(middle, swapped)
    if not own.is_projected or own.area_of_use is None:
        return ""
    if _is_near(own, middle) or not _is_near(own, swapped):
        return ""
    return f"the place lies outside {own.area_of_use.name.rstrip('.')}, for which {own.name} is"


def _of_degrees(middle: complex, swapped: complex) -> str:
    """Return why degrees seem swapped; "" if they do not.

    `middle`, `swapped`: the place as it stands in the file, and with its coordinates swapped.
    """
    if not _is_place(swapped):
        return ""
    if not _is_place(middle):
        return f"a latitude of {middle.imag:.2f} degrees cannot be"
    if not _is_land(middle) and _is_land(swapped):
        return "the place lies in the sea"
    return ""


def _is_place(at: complex) -> bool:
    """Whether longitude + i latitude is on the earth."""
    return abs(at.real) <= 180.0 and abs(at.imag) <= 90.0


def _is_near(own: Any, at: complex) -> bool:
    """Whether a place of a projected system lies near the area for which it is meant."""
    from pyproj import Transformer

    area = own.area_of_use
    to_globe = Transformer.from_crs(own, own.geodetic_crs, always_xy=True)
    longitude, latitude = to_globe.transform(at.real, at.imag)
    if not _is_place(complex(longitude, latitude)):
        return False
    # Degrees. 0 is all around the earth.
    width = (area.east - area.west) % 360.0 or 360.0
    # Degrees east of a point that lies NEAR west of the area.
    east_of_area = (longitude - area.west + NEAR) % 360.0
    is_between = area.south - NEAR <= latitude <= area.north + NEAR
    return bool(is_between and east_of_area <= width + 2 * NEAR)


def _is_land(at: complex) -> bool:
    """Whether longitude + i latitude lies in the area of a country, by the list of EPSG."""
    from pyproj.aoi import AreaOfInterest
    from pyproj.database import query_crs_info
    from pyproj.enums import PJType

    place = AreaOfInterest(at.real, at.imag, at.real, at.imag)
    systems = query_crs_info(
        auth_name="EPSG",
        pj_types=[PJType.GEOGRAPHIC_2D_CRS],
        area_of_interest=place,
        contains=True,
    )
    for system in systems:
        area = system.area_of_use
        if area is None:
            continue
        width = (area.east - area.west) % 360.0 or 360.0
        if width * (area.north - area.south) <= LARGEST_COUNTRY:
            return True
    return False
