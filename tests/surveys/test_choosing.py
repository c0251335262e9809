"""Which features of a file are rows: the others are named and left out; blocks are told.

A feature is a line, an area or a point in a file of a surveyor. `pair` turns a point in the frame
of the rows, a complex number (x east, y north, m), into coordinates of a file.
`straight_rows` are 5 rows of 60 m, 6 m apart, named r1 to r5 from the north.
"""

import re

import pytest
from made_surveys import feature, pair, straight_rows, write_features

from orchard.field.problems import ScenarioError
from orchard.surveys.importing import import_survey
from orchard.surveys.options import ImportOptions

pytest.importorskip("pyproj", reason="pyproj is missing: pip install 'orchard-sim[survey,dev]'")

# The outline of the block of `straight_rows`.
CORNERS = [0j, 60 + 0j, 60 - 24j, -24j, 0j]
RING = [pair(corner) for corner in CORNERS]


def error_of(path, **options) -> str:
    """Return the error of an import."""
    with pytest.raises(ScenarioError) as raised:
        import_survey(path, ImportOptions(**options))
    return str(raised.value)


def test_an_outline_and_a_shed_are_named_and_left_out(tmp_path):
    others = [
        feature("Polygon", [RING], type="block"),
        feature("Point", pair(-20 + 0j), name="shed"),
        {"type": "Feature", "properties": {"name": "note"}, "geometry": None},
    ]
    path = write_features(tmp_path / "a.geojson", [*straight_rows(), *others])
    imported = import_survey(path)
    assert imported.scenario.rows == 5
    left = "left out, as each is no line of a row: number 6 (Polygon, block), shed (Point)"
    assert f"{left} and note (null)" in imported.notes


def test_a_closed_line_around_the_rows_is_an_outline(tmp_path):
    path = write_features(
        tmp_path / "a.geojson", [*straight_rows(), feature("LineString", RING, name="edge")]
    )
    imported = import_survey(path)
    assert imported.scenario.rows == 5
    assert "left out, as it is no line of a row: edge (LineString)" in imported.notes


def test_a_road_among_the_rows_can_be_left_out_by_its_name(tmp_path):
    road = feature("LineString", [pair(-9 + 9j), pair(-9 - 40j)], name="road")
    path = write_features(tmp_path / "a.geojson", [*straight_rows(), road])
    assert "feature road: is not parallel" in error_of(path)
    assert "is left out by --without NAME" in error_of(path)
    imported = import_survey(path, ImportOptions(without=("road",)))
    assert imported.scenario.rows == 5
    assert "left out, as --without says: road (LineString)" in imported.notes
    assert "has no feature street; it has r1, r2, r3" in error_of(path, without=("street",))


def blocks(shift: complex, key: str = "block") -> list[dict]:
    """Return two blocks of four rows, A and B, the second one shifted by so many m.

    `key`: the property of a feature that names its block.
    """
    features = []
    for name, offset in (("A", 0j), ("B", shift)):
        for i in range(4):
            ends = [pair(offset - 6j * i), pair(offset + 60 - 6j * i)]
            features.append(feature("LineString", ends, row=f"{name}{i}", **{key: name}))
    return features


def test_blocks_that_fit_are_one_orchard_and_each_can_be_taken(tmp_path):
    path = write_features(tmp_path / "a.geojson", blocks(-41j))
    imported = import_survey(path)
    assert imported.scenario.rows == 8
    assert any(note.startswith("blocks A and B are one orchard") for note in imported.notes)
    alone = import_survey(path, ImportOptions(block="B"))
    assert [row.id for row in alone.scenario.survey.rows] == ["B0", "B1", "B2", "B3"]


@pytest.mark.parametrize("key", ["block", "Paddock"])
def test_blocks_too_far_apart_are_refused_with_a_command_each(tmp_path, key: str):
    path = write_features(tmp_path / "a.geojson", blocks(-200j, key))
    words = error_of(path)
    for name in ("A", "B"):
        assert f"orchard layout import {path} --block {name}" in words
        assert import_survey(path, ImportOptions(block=name)).scenario.rows == 4
    assert "has no block C; it has A and B" in error_of(path, block="C")


def test_curved_rows_are_refused_with_equal_rows_to_ask_about(tmp_path):
    features = []
    for i in range(4):
        bend = [pair(-6j * i), pair(30 + 3j - 6j * i), pair(60 - 6j * i)]
        features.append(feature("LineString", bend, row=f"r{i}"))
    words = error_of(write_features(tmp_path / "a.geojson", features))
    assert "feature r0: is bent: 1.50 m off a straight line" in words
    answer = "an answer anyway: equal rows, by a scenario with `rows: 4`, `row_length: 60.0`,"
    assert f"{answer} `row_width: 5.50`" in words


def test_equal_rows_that_cannot_be_are_not_offered(tmp_path):
    """Instead of rows that do not fit, equal rows are offered, if they are long enough for rows.

    Lines that end where they begin are as long as they reach. One of them is askew. Rows of 3 m are
    too short.
    """
    there_and_back = [[pair(-6j * i), pair(60 - 6j * i), pair(-6j * i)] for i in range(4)]
    there_and_back[3][1] = pair(60 - 15j)
    features = [feature("LineString", line, row=f"r{i}") for i, line in enumerate(there_and_back)]
    words = error_of(write_features(tmp_path / "a.geojson", features))
    assert "`row_length: 60.0`" in words
    short = []
    for i in range(4):
        short.append(feature("LineString", [pair(-6j * i), pair(3 - 6j * i)], row=f"r{i}"))
    words = error_of(write_features(tmp_path / "b.geojson", short))
    assert "row_length" not in words
    assert "a line that is no row is left out by --without NAME" in words


def test_rows_beyond_the_limits_get_the_nearest_that_can_be(tmp_path):
    """Here four rows of 450 m, 2.44 m apart, as vines are."""
    features = []
    for i in range(4):
        ends = [pair(-2.44j * i), pair(450 - 2.44j * i)]
        features.append(feature("LineString", ends, row=f"r{i}"))
    words = error_of(write_features(tmp_path / "a.geojson", features))
    answer = "by a scenario with `rows: 4`, `row_length: 400.0`, `row_width: 3.15`, the nearest"
    assert answer in words


def test_rows_of_two_zones_in_one_file_are_told_apart(tmp_path):
    """Rows of one block, of which two have the coordinates of another zone: 456 km off."""
    features = straight_rows()
    for row in features[3:]:
        row["geometry"]["coordinates"] = [
            [x + 456_000.0, y] for x, y in row["geometry"]["coordinates"]
        ]
    words = error_of(write_features(tmp_path / "a.geojson", features))
    assert re.search(r"feature r\d: lies 456 km from r\d\. If they are in two coordinate", words)
    assert "not parallel" not in words


def test_rows_with_names_alike_at_first_are_told_apart(tmp_path):
    """A name has at most 60 characters, so longer ones that begin alike get a number."""
    features = []
    for i in range(4):
        name = f"{'block of kiwifruit at the river, ' * 3}row {i + 1}"
        features.append(feature("LineString", [pair(-6j * i), pair(60 - 6j * i)], row=name))
    path = write_features(tmp_path / "a.geojson", features)
    for lines in ("lanes", "trees"):
        rows = import_survey(path, ImportOptions(lines=lines)).scenario.survey.rows
        names = [row.id for row in rows]
        assert len(set(names)) == len(names)
        assert max(map(len, names)) <= 60


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"direction": 30.0}, "--direction: is for the outline of a block; give --spacing too"),
        ({"headland": 8.0}, "--headland: is for the outline of a block; give --spacing too"),
        ({"spacing": 5.0, "lines": "trees"}, "--lines: an outline has no lines"),
        ({"spacing": 5.0}, "has no polygon; --spacing is for the outline of a block"),
    ],
)
def test_an_option_without_effect_is_refused(tmp_path, options, words: str):
    assert words in error_of(write_features(tmp_path / "a.geojson", straight_rows()), **options)
