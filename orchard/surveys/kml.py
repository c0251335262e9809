"""Reads KML: placemarks with lines, outlines or points, in longitude and latitude.

The standard library's parser expat reads it. A file that declares a document type is refused, so
that it can define no entities; without them a file takes no more memory than its size tells.
"""

import cmath
from collections.abc import Iterator
from typing import Any
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

import numpy as np

from orchard.field.problems import Problem, ScenarioError, printable
from orchard.surveys.features import (
    LINE,
    LONGITUDE_LATITUDE,
    POINT,
    POLYGON,
    Feature,
    SurveyFile,
    fault_of_holes,
    name_of,
)

# Element of KML -> the kind of feature.
_KINDS = {"LineString": LINE, "Polygon": POLYGON, "Point": POINT}
# Elements within each other. A file of folders in folders needs about ten.
_DEEPEST = 100


class _NotAllowed(Exception):
    """The file has a part that is not read: the text says which, and what to do."""


def read_kml(content: bytes, file: str) -> SurveyFile:
    """Return what a KML text holds. Raises ScenarioError if it is none."""
    try:
        root = _parsed(content)
    except _NotAllowed as fault:
        raise ScenarioError([Problem(file, str(fault))]) from None
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise ScenarioError([Problem(file, f"is not XML: {printable(str(error))}")]) from None
    if root.tag != "kml":
        text = f"is XML, but no KML: it is <{printable(root.tag, 60)}>; export its rows as KML"
        raise ScenarioError([Problem(file, text)])
    features: list[Feature] = []
    for folder, placemark in _placemarks(root, ""):
        features.append(_feature(placemark, folder, len(features) + 1))
    return SurveyFile(features, LONGITUDE_LATITUDE, [])


def _parsed(content: bytes) -> Element:
    """Return the root of an XML text. Namespaces are taken off its tags.

    Raises ExpatError for a text that is no XML, and _NotAllowed for a document type or for elements
    too deep.
    """
    builder = TreeBuilder()
    parser = expat.ParserCreate()
    depth = 0

    def refuse(*_: Any) -> None:
        raise _NotAllowed("declares a document type, which is not read; delete its <!DOCTYPE ...>")

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > _DEEPEST:
            raise _NotAllowed(f"has more than {_DEEPEST} elements within each other")
        builder.start(tag.rpartition(":")[2], attributes)

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag.rpartition(":")[2])

    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = builder.data
    parser.Parse(content, True)
    return builder.close()


def _placemarks(element: Element, folder: str) -> Iterator[tuple[str, Element]]:
    """Yield each placemark below an element, with the name of the folder that it is in."""
    for child in element:
        if child.tag == "Placemark":
            yield folder, child
        elif child.tag == "Folder":
            yield from _placemarks(child, _text(child, "name") or folder)
        else:
            yield from _placemarks(child, folder)


def _text(element: Element, tag: str) -> str:
    """Return the text of the first child with a tag; "" if there is none."""
    return (element.findtext(tag) or "").strip()


def _feature(placemark: Element, folder: str, number: int) -> Feature:
    """Return a placemark as a feature. `number`: its place in the file, from 1.

    `folder`: the name of the folder that it is in, which counts as a property: many draw a block's
    rows into a folder. A placemark without a geometry, or with several kinds of geometries, is of
    no kind.
    """
    properties: dict[str, Any] = {"folder": folder, "description": _text(placemark, "description")}
    for data in placemark.iter("SimpleData"):
        properties[data.get("name", "")] = (data.text or "").strip()
    for data in placemark.iter("Data"):
        properties[data.get("name", "")] = _text(data, "value")
    name = name_of([_text(placemark, "name"), placemark.get("id")], number)
    geometries = [element for element in placemark.iter() if element.tag in _KINDS]
    kinds = sorted({element.tag for element in geometries})
    if len(kinds) != 1:
        return Feature(name, "", " and ".join(kinds) or "no place", (), properties)
    kind = _KINDS[kinds[0]]
    feature = Feature(name, kind, kinds[0], (), properties)
    try:
        parts = []
        for geometry in geometries:
            # Of a polygon the first one is the outline.
            parts.append(_points(next(geometry.iter("coordinates"), None), kind))
    except ValueError as error:
        return feature._replace(fault=str(error))
    holes = sum(len(geometry.findall("innerBoundaryIs")) for geometry in geometries)
    return feature._replace(parts=tuple(parts), fault=fault_of_holes(holes))


def _points(element: Element | None, kind: str) -> np.ndarray:
    """Return the points of an element `coordinates`, (n,) complex. Heights are left out.

    Raises ValueError for coordinates that are no points, or too few for the kind.
    """
    text = ""
    if element is not None:
        text = element.text or ""
    points = []
    for number, word in enumerate(text.split(), start=1):
        try:
            x, y, *_ = map(float, word.split(","))
            point = complex(x, y)
        except ValueError:
            point = complex(cmath.nan)
        if not cmath.isfinite(point):
            raise ValueError(
                f"its point {number} is {printable(word, 60)}; each point must be longitude and"
                " latitude with a comma between, such as 176.3,-37.8"
            )
        points.append(point)
    fewest = 2
    if kind == POINT:
        fewest = 1
    if len(set(points)) < fewest:
        raise ValueError("must have at least two different points")
    return np.array(points)
