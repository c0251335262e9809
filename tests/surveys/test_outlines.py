"""Polygons are rows, or the outline of a block in which rows are laid out.

With --spacing the import lays rows out in an outline. A headland is what they leave at both ends.
`pair` turns a point of the rows' frame (x east, y north, m) into coordinates of a file.
"""

import math

import pytest
from made_surveys import feature, pair, write_features

from orchard.field.problems import ScenarioError
from orchard.surveys.importing import import_survey
from orchard.surveys.options import ImportOptions

pytest.importorskip("pyproj", reason="pyproj is missing: pip install 'orchard-sim[survey,dev]'")

# Clockwise from north, of the rows of `pair`: 90 degrees less 0.3 rad.
BEARING = 72.811


def box(west: float, south: float, east: float, north: float) -> list[list[list[float]]]:
    """Return the coordinates of a rectangle."""
    corners = [
        complex(west, south),
        complex(east, south),
        complex(east, north),
        complex(west, north),
    ]
    return [[pair(corner) for corner in [*corners, corners[0]]]]


def error_of(path, **options) -> str:
    """Return the error of an import."""
    with pytest.raises(ScenarioError) as raised:
        import_survey(path, ImportOptions(**options))
    return str(raised.value)


def test_long_polygons_are_rows_by_their_centre_lines(tmp_path):
    features = []
    for i in range(4):
        south = -6.0 * i
        features.append(feature("Polygon", box(0.0, south - 1, 60.0, south + 1), row=f"r{i + 1}"))
    imported = import_survey(write_features(tmp_path / "a.geojson", features))
    rows = imported.scenario.survey.rows
    assert [row.id for row in rows] == ["r1", "r2", "r3", "r4"]
    assert [row.south for row in rows] == pytest.approx([0.0, 6.0, 12.0, 18.0], abs=0.01)
    assert [row.length for row in rows] == pytest.approx([60.0] * 4, abs=0.01)
    assert any(
        "4 polygons are taken for rows, 2.00 to 2.00 m wide" in note for note in imported.notes
    )
    between = import_survey(tmp_path / "a.geojson", ImportOptions(lines="trees"))
    assert between.scenario.rows == 3


@pytest.fixture
def outline(tmp_path):
    """Return a file with the outline of a block of 120 m by 50 m."""
    block = feature("Polygon", box(0.0, -50.0, 120.0, 0.0), name="Top")
    return write_features(tmp_path / "a.geojson", [block])


def test_rows_are_laid_out_in_an_outline(outline):
    """Ten rows, 5 m apart, in 50 m; they leave 8 m of 120 m at both ends."""
    imported = import_survey(outline, ImportOptions(spacing=5.0, headland=8.0, direction=BEARING))
    rows = imported.scenario.survey.rows
    assert [row.south for row in rows] == pytest.approx([5.0 * i for i in range(10)], abs=0.01)
    assert [row.length for row in rows] == pytest.approx([104.0] * 10, abs=0.05)
    assert imported.direction == pytest.approx(BEARING, abs=0.01)
    assert any(
        note.startswith("10 rows are laid out in the outline Top") for note in imported.notes
    )


def test_what_an_outline_leaves_open_is_said(outline):
    imported = import_survey(outline, ImportOptions(spacing=5.0))
    assert [row.length for row in imported.scenario.survey.rows] == pytest.approx(
        [120.0] * 10, abs=0.05
    )
    notes = "\n".join(imported.notes)
    assert "assumed: rows run along the longest side, 72.8 degrees clockwise from north" in notes
    assert "assumed: rows end at the outline; --headland METRES" in notes


def test_an_outline_alone_is_asked_about(outline):
    words = error_of(outline)
    assert "has 1 polygons, and no rows: Top" in words
    assert f"{outline} --direction 30 --spacing 5 --headland 8" in words
    assert "--spacing: 2: must be 3.65 to 12.5 m" in error_of(outline, spacing=2.0)
    assert "--headland: -1: must be at least 0 m" in error_of(outline, spacing=5.0, headland=-1.0)
    assert "--direction: nan: must be -360 to 360" in error_of(
        outline, spacing=5.0, direction=math.nan
    )
    assert "has 0 rows" in error_of(outline, spacing=5.0, headland=55.0)


def test_short_corners_of_an_outline_are_left_out(tmp_path):
    """In a triangle of 120 m by 60 m rows get shorter; those under 20 m are left out."""
    corners = [0j, 120 + 0j, 60 - 60j]
    triangle = [[pair(corner) for corner in [*corners, corners[0]]]]
    path = write_features(tmp_path / "a.geojson", [feature("Polygon", triangle, name="Top")])
    imported = import_survey(path, ImportOptions(spacing=5.0, direction=BEARING, headland=5.0))
    # Rows lie 2.5, 7.5 ... m south of the long side, and are 10 m shorter than the outline there.
    lengths = [120.0 - 2 * (2.5 + 5.0 * i) - 10.0 for i in range(12)]
    assert [row.length for row in imported.scenario.survey.rows] == pytest.approx(
        [length for length in lengths if length >= 20.0], abs=0.05
    )
    assert "left out: 3 rows in the outline, shorter than 20 m" in imported.notes


def test_two_outlines_are_told_by_name(tmp_path):
    blocks = [
        feature("Polygon", box(0.0, -50.0, 120.0, 0.0), name="Top"),
        feature("Polygon", box(0.0, -150.0, 120.0, -90.0), name="Low", block="2"),
    ]
    path = write_features(tmp_path / "a.geojson", blocks)
    assert "has several outlines, Top and Low; leave out all but one" in error_of(path, spacing=5.0)
    imported = import_survey(path, ImportOptions(spacing=5.0, without=("Low",)))
    assert imported.scenario.rows == 10
    assert import_survey(path, ImportOptions(spacing=5.0, block="2")).scenario.rows == 12


HOLE = [pair(corner) for corner in (30 - 20j, 40 - 20j, 40 - 30j, 30 - 30j, 30 - 20j)]


def test_an_outline_with_a_hole_is_refused(tmp_path):
    """The rows would lead through the hole. Beside lines of rows, such an area is no outline, and
    is left out.
    """
    outline = [*box(0.0, -50.0, 120.0, 0.0), HOLE]
    several = [[*box(0.0, -50.0, 120.0, 0.0), HOLE, HOLE]]
    for kind, rings, holes in (("Polygon", outline, "a hole"), ("MultiPolygon", several, "2 hole")):
        path = write_features(tmp_path / "a.geojson", [feature(kind, rings, name="Top")])
        assert f"feature Top: has {holes}" in error_of(path, spacing=5.0)
    lines = [feature("LineString", [pair(-6j * i), pair(60 - 6j * i)]) for i in range(4)]
    path = write_features(tmp_path / "b.geojson", [*lines, feature("Polygon", outline)])
    assert import_survey(path).scenario.rows == 4
