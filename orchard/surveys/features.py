"""What every file of a survey is read into: features with their points."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from orchard.field.problems import Problem, printable

# The system of a file that names none: of GeoJSON (RFC 7946), of KML, of latitude and longitude.
LONGITUDE_LATITUDE = "OGC:CRS84"
LINE = "line"
POLYGON = "polygon"
POINT = "point"
# Properties that name a feature without an id.
NAMES = ("id", "fid", "name", "row")
# Characters of a name.
LONGEST_NAME = 60


class Feature(NamedTuple):
    """A thing on the map: a row, a tree, an outline, a shed."""

    name: str
    #: LINE, POLYGON or POINT; "" for what is none of them.
    kind: str
    #: What the file calls its kind: "'MultiLineString'".
    kind_in_file: str
    #: (n,) complex each: easting + i northing, in the file's system, or m about the middle of all.
    #: The lines of a line, the outlines of polygons, the points.
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
    """Return what names a feature: the first candidate that can, else its number in the file."""
    for candidate in candidates:
        if isinstance(candidate, str | int) and str(candidate):
            return str(candidate)
    return f"number {number}"


def short_names(names: Iterable[str]) -> dict[str, str]:
    """Return a name for each one, printable and of at most LONGEST_NAME characters.

    Different names have different ones: those that would be alike get a number.
    """
    short: dict[str, str] = {}
    taken = set[str]()
    # Of each name that several would have, how many do.
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
    """Return what is wrong with a polygon that has so many holes; "" if it has none."""
    if not count:
        return ""
    holes = f"{count} holes"
    if count == 1:
        holes = "a hole"
    return (
        f"has {holes}, and rows would go through; draw it without, or as polygons beside the hole,"
        " each imported by itself"
    )
