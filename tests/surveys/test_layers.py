"""GeoPackage and Shapefile: the same rows as from GeoJSON, and what is missing is told.

A GeoPackage is one file with layers. A Shapefile is several files: .shp has the lines, .shx their
index, .dbf their names, and .prj the coordinate system.
"""

import json
import sys
from zipfile import ZipFile

import numpy as np
import pytest
from made_surveys import CIRCUIT, feature, pair, straight_rows, write_features

from orchard.field.problems import ScenarioError
from orchard.surveys.importing import import_survey
from orchard.surveys.options import ImportOptions

pyogrio = pytest.importorskip(
    "pyogrio", reason="pyogrio is missing: pip install 'orchard-sim[gis,dev]'"
)
shapely = pytest.importorskip("shapely")


def write(path, features: list[dict], crs: str | None = CIRCUIT, **options) -> None:
    """Write features as a GeoPackage or a Shapefile."""
    shapes = [shapely.from_geojson(json.dumps(row["geometry"])) for row in features]
    names = np.array([row["properties"].get("row", "") for row in features], dtype=object)
    pyogrio.raw.write(
        path,
        geometry=shapely.to_wkb(np.array(shapes)),
        field_data=[names],
        fields=["row"],
        geometry_type=features[0]["geometry"]["type"],
        crs=crs,
        **options,
    )


def error_of(path, **options) -> str:
    """Return the error of an import."""
    with pytest.raises(ScenarioError) as raised:
        import_survey(path, ImportOptions(**options))
    return str(raised.value)


@pytest.mark.parametrize("ending", ["gpkg", "shp"])
def test_layers_give_the_rows_of_geojson(tmp_path, ending: str):
    path = tmp_path / f"rows.{ending}"
    write(path, straight_rows())
    same = import_survey(write_features(tmp_path / "rows.geojson", straight_rows()))
    assert import_survey(path).scenario.survey.rows == same.scenario.survey.rows


def test_a_packed_shapefile_is_read_with_what_belongs_to_it(tmp_path):
    """The archive has all files of the Shapefile, in a folder."""
    write(tmp_path / "rows.shp", straight_rows())
    archive = tmp_path / "rows.zip"
    with ZipFile(archive, "w") as packed:
        for path in sorted(tmp_path.glob("rows.*")):
            if path != archive:
                packed.write(path, f"export/{path.name}")
    packed_rows = import_survey(archive).scenario.survey
    assert packed_rows == import_survey(tmp_path / "rows.shp").scenario.survey


def test_the_layer_of_the_rows_is_asked_for(tmp_path):
    path = tmp_path / "farm.gpkg"
    write(path, straight_rows(4), layer="rows")
    write(path, straight_rows(6), layer="old rows")
    words = error_of(path)
    assert f"orchard layout import {path} --layer rows" in words
    assert f"orchard layout import {path} --layer 'old rows'" in words
    assert import_survey(path, ImportOptions(layer="rows")).scenario.rows == 4
    assert "has no layer new; it has rows and old rows" in error_of(path, layer="new")
    other = write_features(tmp_path / "a.geojson", straight_rows())
    assert "has no layers, which a GeoPackage has" in error_of(other, layer="rows")


def test_a_shapefile_without_its_system_is_asked_about(tmp_path):
    path = tmp_path / "rows.shp"
    write(path, straight_rows())
    path.with_suffix(".prj").unlink()
    assert "does not say its coordinate system" in error_of(path)
    assert import_survey(path, ImportOptions(crs=CIRCUIT)).scenario.rows == 5
    assert "belongs to a Shapefile; give its file rows.shp" in error_of(path.with_suffix(".dbf"))


def test_a_torn_file_is_told(tmp_path):
    path = tmp_path / "rows.gpkg"
    write(path, straight_rows())
    path.write_bytes(path.read_bytes()[:2000])
    assert f"{path}: cannot be read: " in error_of(path)
    shape = tmp_path / "rows.shp"
    write(shape, straight_rows())
    shape.with_suffix(".shx").unlink()
    assert "a Shapefile needs its .shx and .dbf beside it" in error_of(shape)


@pytest.mark.parametrize("package", ["pyogrio", "shapely"])
def test_the_extra_is_told_where_it_is_missing(tmp_path, monkeypatch, package: str):
    path = tmp_path / "rows.gpkg"
    write(path, straight_rows())
    monkeypatch.setitem(sys.modules, package, None)
    assert f"{path}: needs the package {package}: pip install 'orchard-sim[gis]'" in error_of(path)


@pytest.mark.parametrize("ending", ["gpkg", "shp"])
def test_an_outline_with_a_hole_is_refused(tmp_path, ending: str):
    """The rows would lead through the hole."""
    corners = (0j, 120 + 0j, 120 - 50j, -50j, 0j)
    hole = (30 - 20j, 40 - 20j, 40 - 30j, 30 - 20j)
    rings = [[pair(corner) for corner in ring] for ring in (corners, hole)]
    path = tmp_path / f"top.{ending}"
    write(path, [feature("Polygon", rings, row="Top")])
    assert "feature Top: has a hole, and rows would go through" in error_of(path, spacing=5.0)
