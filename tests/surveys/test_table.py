"""CSV: ends of rows or trees, with the separators, decimal signs and encodings of offices.

A table has a line for each end of a row, or a line for both ends, or one for each tree.
"""

import codecs

import pytest

from orchard.field.problems import ScenarioError
from orchard.surveys.importing import import_survey
from orchard.surveys.options import ImportOptions

pytest.importorskip("pyproj", reason="pyproj is missing: pip install 'orchard-sim[survey,dev]'")


def ends(count: int = 4) -> list[tuple[str, float, float]]:
    """Return both ends of rows that run north, 6 m apart and 60 m long: name, easting, northing."""
    result = []
    for i in range(count):
        result += [
            (f"r{i + 1}", 1_892_800.0 + 6.0 * i, 5_812_200.0),
            (f"r{i + 1}", 1_892_800.0 + 6.0 * i, 5_812_260.0),
        ]
    return result


def imported(path, text: str | bytes, **options):
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return import_survey(path, ImportOptions(**options))


def error_of(path, text: str | bytes, **options) -> str:
    """Return the error of an import."""
    with pytest.raises(ScenarioError) as raised:
        imported(path, text, **options)
    return str(raised.value)


def lengths(result) -> list[float]:
    return [row.length for row in result.scenario.survey.rows]


# Three rows of 99.9 m, 6 m apart: a line for each end, and then with both ends in a line, with
# decimal commas.
DEGREES = """Latitude,Longitude,Row
-37.7900010,176.3250238,r1
-37.7897045,176.3260951,r1
-37.7900520,176.3250463,r2
-37.7897555,176.3261175,r2
-37.7901030,176.3250687,r3
-37.7898065,176.3261399,r3
"""
BOTH_ENDS = """row;start_lat;start_lon;end_lat;end_lon
r1;-37,7900010;176,3250238;-37,7897045;176,3260951
r2;-37,7900520;176,3250463;-37,7897555;176,3261175
r3;-37,7901030;176,3250687;-37,7898065;176,3261399
"""


@pytest.mark.parametrize(
    "text",
    [
        DEGREES,
        DEGREES.replace("\n", "\r\n"),
        DEGREES.replace(",", "\t"),
        DEGREES.replace(",", ";").replace(".", ","),
        BOTH_ENDS,
        DEGREES.encode("utf-16"),
        codecs.BOM_UTF8 + DEGREES.encode(),
        DEGREES.replace("r1", '"Reihe, 1"').replace("r2", "Süd").encode("latin-1"),
    ],
    ids=[
        "commas",
        "lines of Windows",
        "tabs",
        "semicolons and decimal commas",
        "both ends in a line",
        "UTF-16",
        "UTF-8 with a mark",
        "Latin-1",
    ],
)
def test_ends_of_rows_are_read_in_any_form_of_csv(tmp_path, text):
    result = imported(tmp_path / "rows.csv", text)
    assert lengths(result) == pytest.approx([99.93] * 3, abs=0.05)
    assert [row.south for row in result.scenario.survey.rows] == pytest.approx(
        [0.0, 6.0, 12.0], abs=0.05
    )


def test_latin_1_is_read_and_said(tmp_path):
    text = DEGREES.replace("r2", "Süd").encode("latin-1")
    result = imported(tmp_path / "rows.csv", text)
    assert [row.id for row in result.scenario.survey.rows] == ["r1", "Süd", "r3"]
    assert "read as Latin-1 text, as it is no UTF-8" in result.notes


def test_eastings_need_a_system(tmp_path):
    lines = [f"{name},{x},{y}" for name, x, y in ends()]
    text = "\n".join(["Row,Easting,Northing", *lines])
    path = tmp_path / "rows.csv"
    words = error_of(path, text)
    assert f"does not say its coordinate system: orchard layout import {path} --crs" in words
    assert lengths(imported(path, text, crs="EPSG:2193")) == pytest.approx([60.0] * 4, abs=0.1)


@pytest.mark.parametrize("head", ["tree,row,x,y", "plant,block,x,y"])
def test_trees_in_a_table_are_lines_of_trees(tmp_path, head: str):
    """Five lines of 11 trees, 3 m apart: 30 m long, with four lanes between them."""
    lines = [head]
    for i in range(5):
        for j in range(11):
            lines.append(f"{j},L{i},{1_892_800.0 + 5.0 * i},{5_812_200.0 + 3.0 * j}")
    result = imported(tmp_path / "trees.csv", "\n".join(lines), crs="EPSG:2193")
    assert lengths(result) == pytest.approx([30.0] * 4, abs=0.1)
    assert any("55 trees stand in 5 lines, 3.00 m apart" in note for note in result.notes)
    assert any("--crs EPSG:2193 --lines lanes" in note for note in result.notes)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("hello, this is a letter\n", "as CSV its first line names no places: hello, this is"),
        ("1,2,3\n4,5,6\n", "It must name columns such as row,latitude,longitude"),
        ("row,lat,lon\n", "has 0 rows; must be 3 to 100"),
        (DEGREES.replace("Row", "Fila"), "no column names rows or trees, so the points are taken"),
        (DEGREES + "here,there,r4\n", "line 8: Longitude is 'there'; must be a decimal number"),
        (DEGREES + "-37.79,17_6.325,r4\n", "line 8: Longitude is '17_6.325'; must be a decimal"),
        (DEGREES + "-37.8\n", "line 8: Longitude is ''; must be a decimal number"),
        (DEGREES + "37°47'S,176.3,r4\n", 'line 8: Latitude is "37°47\'S"; must be a decimal'),
        (DEGREES + "-37.79,176.325,r4\n", "feature r4: has one end, on line 8; must have two"),
        (b"\x00\x01\x02\xff" * 20, "is no text"),
    ],
)
def test_a_table_that_cannot_be_used_is_told_in_words(tmp_path, text, words: str):
    assert words in error_of(tmp_path / "rows.csv", text)


def test_swapped_columns_are_found(tmp_path):
    words = error_of(
        tmp_path / "rows.csv", DEGREES.replace("Latitude,Longitude", "Longitude,Latitude")
    )
    assert "--swap-coordinates" in words
