"""Lines of trees and lanes: how a file is understood is told, and the user can say otherwise.

A picker drives in a lane, between two lines of trees. The lines of a file may be either. Of 6 lines
of trees there are 5 lanes, which are the rows of a scenario.
"""

import pytest
from made_surveys import feature, pair, straight_rows, write_features

from orchard.field.problems import ScenarioError
from orchard.surveys.importing import import_survey
from orchard.surveys.options import LANES, TREES, ImportOptions

pytest.importorskip("pyproj", reason="pyproj is missing: pip install 'orchard-sim[survey,dev]'")


def test_lines_are_lanes_and_the_other_command_is_told(tmp_path):
    path = write_features(tmp_path / "a.geojson", straight_rows(6))
    imported = import_survey(path)
    assert imported.scenario.rows == 6
    other = f"there are at most 5 rows: orchard layout import {path} --lines trees"
    assert any(note.endswith(other) for note in imported.notes)
    assert import_survey(path, ImportOptions(lines=LANES)).notes == []


def test_lanes_lie_midway_between_lines_of_trees(tmp_path):
    features = straight_rows(6)
    # The last line of trees is shorter by 10 m at its west end.
    features[5]["geometry"]["coordinates"][0] = pair(10 - 30j)
    path = write_features(tmp_path / "a.geojson", features)
    imported = import_survey(path, ImportOptions(lines=TREES))
    rows = imported.scenario.survey.rows
    assert [row.id for row in rows] == ["r1-r2", "r2-r3", "r3-r4", "r4-r5", "r5-r6"]
    assert [row.south for row in rows] == pytest.approx([0.0, 6.0, 12.0, 18.0, 24.0], abs=0.01)
    # The last lane begins midway between the ends of its lines of trees, 0 m and 10 m.
    assert (rows[-1].start, rows[-1].length) == pytest.approx((5.0, 55.0), abs=0.01)
    assert complex(*imported.scenario.survey.origin.place(0.0, 0.0)) != 0.0, "a place on the map"
    taken = "6 lines of trees: the 5 rows are the lanes midway between them"
    assert any(note.startswith(taken) for note in imported.notes)


def test_no_lane_lies_where_lines_of_trees_are_missing(tmp_path):
    """Line r4 is missing, so r3 and r5 are 12 m apart: twice as far as a lane is wide."""
    features = straight_rows(8)
    del features[3]
    path = write_features(tmp_path / "a.geojson", features)
    imported = import_survey(path, ImportOptions(lines=TREES))
    assert [row.id for row in imported.scenario.survey.rows] == [
        "r1-r2",
        "r2-r3",
        "r5-r6",
        "r6-r7",
        "r7-r8",
    ]
    assert any("r3-r5 (12.00 m)" in note for note in imported.notes)


@pytest.mark.parametrize("where", ["file", "property", "name"])
def test_a_file_that_speaks_of_trees_is_asked_about(tmp_path, where: str):
    features = straight_rows(6)
    path = tmp_path / "a.geojson"
    if where == "file":
        path = tmp_path / "vine_rows.geojson"
    elif where == "property":
        features[0]["properties"]["kind"] = "line of trees"
    else:
        features[0]["properties"]["row"] = "Tree 1"
    write_features(path, features)
    with pytest.raises(ScenarioError) as raised:
        import_survey(path)
    for lines in (TREES, LANES):
        assert f"orchard layout import {path} --lines {lines}" in str(raised.value)
        count = {TREES: 5, LANES: 6}[lines]
        assert import_survey(path, ImportOptions(lines=lines)).scenario.rows == count


def test_lines_of_trees_that_do_not_fit_are_told_as_such(tmp_path):
    features = straight_rows(5)
    features.append(feature("LineString", [pair(-25j), pair(60 - 25j)], row="near"))
    path = write_features(tmp_path / "a.geojson", features)
    with pytest.raises(ScenarioError, match=r"line of trees near: lies 1\.00 m south of row r5"):
        import_survey(path, ImportOptions(lines=TREES))
