"""What every file of a survey is read into: features with their points.

A feature is a thing on a map, as GeoJSON names it. Its points are complex numbers: easting + i
northing, or longitude + i latitude.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from orchard.field.problems import Problem, printable

# The coordinate system of longitude and latitude, in this order, in degrees: that of GeoJSON (RFC
# 7946) and of KML, and of a table with columns of these names.
LONGITUDE_LATITUDE = "OGC:CRS84"
# Kinds of features.
LINE = "line"
POLYGON = "polygon"
POINT = "point"
# Properties that name a feature, the first before the others.
NAMES = ("id", "fid", "name", "row")
# Characters of a name, at most.
LONGEST_NAME = 60


class Feature(NamedTuple):
    """A thing on the map: a row, a tree, an outline, a shed."""

    name: str
    #: LINE, POLYGON or POINT; "" for a feature that is none of them.
    kind: str
    #: What the file calls its kind: "'MultiLineString'".
    kind_in_file: str
    #: (n,) complex each, in the file's system, or after `on_a_plane` in m about the middle of all
    #: features. A part is a line, the outline of a polygon, or one or more points.
    parts: tuple[np.ndarray, ...]
    properties: Mapping[str, Any]
    #: What is wrong with its points; "": nothing.
    fault: str = ""


class SurveyFile(NamedTuple):
    """What a file holds."""

    features: list[Feature]
    #: The name of the file's coordinate system; "" if it is not known.
    crs: str
    #: What is wrong with parts of the file that are no features.
    problems: list[Problem]
    #: What was assumed of the file, a sentence each.
    notes: tuple[str, ...] = ()


def name_of(candidates: list[Any], number: int) -> str:
    """Return the name of a feature: the first candidate that is a text or a number, not empty.

    Without such a candidate it is "number 3" for the third one in the file. `number`: from 1.
    """
    for candidate in candidates:
        if isinstance(candidate, str | int) and str(candidate):
            return str(candidate)
    return f"number {number}"


def short_names(names: Iterable[str]) -> dict[str, str]:
    """Return name -> short name, printable and of at most LONGEST_NAME characters.

    Different names have different short names: those that would be alike get a number.
    """
    short: dict[str, str] = {}
    taken = set[str]()
    # Short name that several names would have -> how many more of these there were so far.
    alike = Counter[str]()
    for name in dict.fromkeys(names):
        first = printable(name, LONGEST_NAME)
        candidate = first
        while candidate in taken:
            alike[first] += 1
            ending = f" ({alike[first] + 1})"
            candidate = printable(name, LONGEST_NAME - len(ending)) + ending
        taken.add(candidate)
        short[name] = candidate
    return short


def with_short_names(features: list[Feature]) -> list[Feature]:
    """Return features with names that can be shown, and that a scenario can have."""
    short = short_names(feature.name for feature in features)
    return [feature._replace(name=short[feature.name]) for feature in features]


def all_points(features: Sequence[Feature]) -> np.ndarray:
    """Return the points of all parts of features, (n,) complex."""
    parts: list[np.ndarray] = []
    for feature in features:
        parts += feature.parts
    return np.concatenate(parts)


def fault_of_holes(count: int) -> str:
    """Return the fault of a polygon with so many holes, for `Feature.fault`; "" if it has none."""
    if not count:
        return ""
    holes = f"{count} holes"
    if count == 1:
        holes = "a hole"
    return (
        f"has {holes}, and rows would go through; draw it without, or as polygons beside the hole,"
        " each imported by itself"
    )
