"""Reads GeoPackage and Shapefile by GDAL.

Only this module uses pyogrio and shapely, which are in the extra `gis`. So they are imported where
they are used: without the extra all other formats can still be read.
"""

from typing import Any

import numpy as np

from orchard.field.problems import Problem, ScenarioError, printable
from orchard.surveys.choosing import listed
from orchard.surveys.features import (
    LINE,
    NAMES,
    POINT,
    POLYGON,
    Feature,
    SurveyFile,
    fault_of_holes,
    name_of,
)
from orchard.surveys.options import MOST_COMMANDS, Source

# Type of a geometry of shapely -> the kind of feature.
_KINDS = {"LineString": LINE, "LinearRing": LINE, "Polygon": POLYGON, "Point": POINT}
# How these files begin. A GeoPackage is a database of SQLite.
GEOPACKAGE = b"SQLite format 3\0"
SHAPEFILE = b"\x00\x00\x27\x0a"


def read_layers(source: Source) -> SurveyFile:
    """Return what a layer of a GeoPackage, or a Shapefile, holds.

    Raises ScenarioError, also if pyogrio or shapely is not installed.
    """
    try:
        import pyogrio
        import shapely
    except ModuleNotFoundError as missing:
        text = f"needs the package {missing.name}: pip install 'orchard-sim[gis]'"
        raise ScenarioError([Problem(source.file, text)]) from None
    try:
        layer = _layer(pyogrio.list_layers(source.path), source)
        # `columns`: an array of the values of all features for each field.
        about, _, geometries, columns = pyogrio.raw.read(source.path, layer=layer)
        shapes = shapely.from_wkb(geometries)
    except (pyogrio.errors.DataSourceError, pyogrio.errors.DataLayerError) as error:
        fault = printable(str(error))
        text = f"cannot be read: {fault}; a Shapefile needs its .shx and .dbf beside it"
        raise ScenarioError([Problem(source.file, text)]) from None
    except shapely.errors.ShapelyError as error:
        text = f"has a geometry that is not read: {printable(str(error))}"
        raise ScenarioError([Problem(source.file, text)]) from None
    features = []
    for number, shape in enumerate(shapes, start=1):
        properties = {}
        for key, values in zip(about["fields"], columns, strict=True):
            value = values[number - 1]
            # Numbers of numpy become numbers of Python, as other readers give them.
            if isinstance(value, np.generic):
                value = value.item()
            properties[str(key)] = value
        features.append(_feature(shape, properties, number))
    return SurveyFile(features, about["crs"] or "", [])


def _layer(layers: np.ndarray, source: Source) -> str:
    """Return the name of the layer that is read. Raises ScenarioError if the user must say it.

    `layers`: (n, 2), names and types of geometry.
    """
    names = [str(name) for name, geometry in layers if geometry is not None]
    wanted = source.options.layer
    if wanted is not None and wanted not in names:
        text = f"has no layer {printable(wanted)}; it has {listed(names)}"
        raise ScenarioError([Problem(source.file, text)])
    if wanted is None and len(names) != 1:
        text = "has no layer with places"
        if names:
            commands = [source.command(layer=name) for name in names]
            shown = listed(commands, MOST_COMMANDS)
            text = f"has {len(names)} layers. Say which has the rows: {shown}"
        raise ScenarioError([Problem(source.file, text)])
    return wanted or names[0]


def _feature(shape: Any, properties: dict[str, Any], number: int) -> Feature:
    """Return a geometry of shapely as a feature. `number`: its place in the layer, from 1."""
    import shapely

    in_small_letters = {key.lower(): value for key, value in properties.items()}
    name = name_of([in_small_letters.get(key) for key in NAMES], number)
    if shape is None or shape.is_empty:
        return Feature(name, "", "null", (), properties)
    parts = []
    kinds = set()
    holes = 0
    for part in shapely.get_parts(shape):
        kinds.add(_KINDS.get(part.geom_type, ""))
        holes += max(0, int(shapely.get_num_interior_rings(part)))
        parts.append(_outline(part))
    kind = ""
    if len(kinds) == 1:
        (kind,) = kinds
    feature = Feature(name, kind, shape.geom_type, tuple(parts), properties)
    if not np.isfinite(np.concatenate(parts)).all():
        return feature._replace(fault="has a point that is not finite")
    if kind == LINE and min(len(set(part.tolist())) for part in parts) < 2:
        return feature._replace(fault="must have at least two different points")
    return feature._replace(fault=fault_of_holes(holes))


def _outline(part: Any) -> np.ndarray:
    """Return the points of a geometry, (n,) complex; of a polygon those of its outline."""
    import shapely

    if part.geom_type == "Polygon":
        part = shapely.get_exterior_ring(part)
    x, y = shapely.get_coordinates(part).T
    points: np.ndarray = x + 1j * y
    return points
