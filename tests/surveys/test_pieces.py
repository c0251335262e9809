"""Pieces of one row are joined, and a gap between them is told.

The second of five rows is drawn in two pieces. A row is 60 m long.
"""

import pytest
from made_surveys import feature, pair, straight_rows, write_features

from orchard.field.problems import ScenarioError
from orchard.surveys.importing import import_survey
from orchard.surveys.options import ImportOptions

pytest.importorskip("pyproj", reason="pyproj is missing: pip install 'orchard-sim[survey,dev]'")


def line(south: float, west: float, east: float) -> list[list[float]]:
    """Return the coordinates of a line `south` m south of the first row, from x to x, m."""
    return [pair(complex(west, -south)), pair(complex(east, -south))]


def test_the_parts_of_a_line_are_one_row_and_its_gap_is_told(tmp_path):
    features = straight_rows()
    features[1] = feature(
        "MultiLineString", [line(6.0, 60.0, 40.0), line(6.0, 0.0, 20.0)], row="r2"
    )
    imported = import_survey(write_features(tmp_path / "a.geojson", features))
    second = imported.scenario.survey.rows[1]
    assert second.id == "r2"
    assert second.start == 0.0
    assert second.length == pytest.approx(60.0, abs=0.01)
    assert "joined from pieces in one line: r2 (2 pieces)" in imported.notes
    gap = "1 row has a gap wider than 6 m, up to 20.00 m (row r2). Here rows have no gaps: 20 of"
    assert any(note.startswith(f"{gap} 300 m (7 %)") for note in imported.notes)


def test_lines_with_one_name_in_one_line_are_one_row(tmp_path):
    pieces = [
        feature("LineString", line(6.0, 0.0, 30.0), row="r2"),
        feature("LineString", line(6.0, 34.0, 60.0), row="r2"),
    ]
    features = straight_rows()
    features[1:2] = pieces
    imported = import_survey(write_features(tmp_path / "a.geojson", features))
    assert [row.id for row in imported.scenario.survey.rows] == ["r1", "r2", "r3", "r4", "r5"]
    assert "joined from pieces in one line: r2 (2 pieces)" in imported.notes
    assert not any("wider than" in note for note in imported.notes)


def test_pieces_with_names_of_their_own_are_joined_if_they_meet(tmp_path):
    features = straight_rows()
    features[1:2] = [
        feature("LineString", line(6.0, 0.0, 30.0), row="r2a"),
        feature("LineString", line(6.0, 31.0, 60.0), row="r2b"),
    ]
    imported = import_survey(write_features(tmp_path / "a.geojson", features))
    assert [row.id for row in imported.scenario.survey.rows] == ["r1", "r2a", "r3", "r4", "r5"]
    assert "joined from pieces in one line: r2a (with r2b)" in imported.notes


def test_two_rows_with_one_name_are_not_joined(tmp_path):
    features = straight_rows()
    features[1]["properties"]["row"] = "r1"
    with pytest.raises(ScenarioError, match="feature r1: the name of two rows"):
        import_survey(write_features(tmp_path / "a.geojson", features))


def test_a_row_that_is_drawn_twice_is_refused(tmp_path):
    features = straight_rows()
    features.append(feature("LineString", line(6.0, 60.0, 0.1), row="again"))
    path = write_features(tmp_path / "a.geojson", features)
    with pytest.raises(ScenarioError) as raised:
        import_survey(path)
    assert f"{path}: feature again: is drawn where r2 is" in str(raised.value)
    assert f"one of each: orchard layout import {path} --without again" in str(raised.value)
    assert import_survey(path, ImportOptions(without=("again",))).scenario.rows == 5


def test_rows_of_which_all_have_one_name_are_numbered(tmp_path):
    """The name is that of the variety. So is that of the one feature that has all rows as parts."""
    apart = straight_rows()
    for row in apart:
        row["properties"]["row"] = "Hayward"
    lines = [line(6.0 * number, 0.0, 60.0) for number in range(5)]
    together = [feature("MultiLineString", lines, row="Hayward")]
    for name, features in (("a.geojson", apart), ("b.geojson", together)):
        imported = import_survey(write_features(tmp_path / name, features))
        names = [row.id for row in imported.scenario.survey.rows]
        assert names == ["row 1", "row 2", "row 3", "row 4", "row 5"]
        said = "all 5 rows are named Hayward: here they are row 1, row 2 and so on"
        assert said in imported.notes
