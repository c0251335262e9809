"""KML: rows, folders and outlines as Google Earth writes them; what is unsafe is refused.

A placemark of KML is a feature: a name and a line, an area or a point, in degrees.
"""

import pytest

from orchard.field.problems import ScenarioError
from orchard.surveys.importing import import_survey
from orchard.surveys.options import ImportOptions

pytest.importorskip("pyproj", reason="pyproj is missing: pip install 'orchard-sim[survey,dev]'")

HEAD = '<?xml version="1.0" encoding="UTF-8"?>'


def line(number: int, east: float = 0.0) -> str:
    """Return the line of a row of 97 m, 6 m south of the one with the number before.

    `east`: how much further east it begins, degrees of longitude. Its third coordinate, 12 m, is a
    height.
    """
    north = -37.79 - 0.000054 * number
    begin = f"{176.325 + east},{north},12"
    points = f" {begin} {176.3261 + east},{north},12 "
    return f"<LineString><coordinates>{points}</coordinates></LineString>"


def placemark(name: str, geometry: str) -> str:
    return f"<Placemark><name>{name}</name>{geometry}</Placemark>"


def kml(*parts: str) -> str:
    body = "".join(parts)
    return f'{HEAD}<kml xmlns="http://www.opengis.net/kml/2.2"><Document>{body}</Document></kml>'


def folder(name: str, *parts: str) -> str:
    return f"<Folder><name>{name}</name>{''.join(parts)}</Folder>"


ROWS = [placemark(f"r{number}", line(number)) for number in range(4)]


def imported(path, text: str, **options):
    path.write_text(text)
    return import_survey(path, ImportOptions(**options))


def error_of(path, text: str) -> str:
    """Return the error of an import."""
    with pytest.raises(ScenarioError) as raised:
        imported(path, text)
    return str(raised.value)


@pytest.mark.parametrize("prefix", ["", "kml:"])
def test_placemarks_are_rows_and_the_others_are_left_out(tmp_path, prefix: str):
    shed = placemark("Shed", "<Point><coordinates>176.325,-37.791</coordinates></Point>")
    text = kml(*ROWS, shed, placemark("Note", ""))
    # As some programs write it: each tag has a prefix.
    if prefix:
        text = text.replace("</", "~").replace("<", "<kml:").replace("~", "</kml:")
        text = text.replace("<kml:?xml", "<?xml").replace("xmlns=", "xmlns:kml=")
    result = imported(tmp_path / "rows.kml", text)
    assert [row.id for row in result.scenario.survey.rows] == ["r0", "r1", "r2", "r3"]
    assert result.scenario.row_length == pytest.approx(96.9, abs=0.2)
    left = "left out, as each is no line of a row: Shed (Point) and Note (no place)"
    assert left in result.notes


def test_folders_are_blocks(tmp_path):
    text = kml(
        folder("Top", *ROWS),
        folder("Low", *(placemark(f"s{number}", line(number + 40)) for number in range(3))),
    )
    words = error_of(tmp_path / "rows.kml", text)
    assert f"{tmp_path / 'rows.kml'} --block Low" in words
    assert imported(tmp_path / "rows.kml", text, block="Low").scenario.rows == 3


def test_pieces_of_a_placemark_are_one_row(tmp_path):
    pieces = f"<MultiGeometry>{line(1)}{line(1, 0.00115)}</MultiGeometry>"
    rows = [ROWS[0], placemark("r1", pieces), *ROWS[2:]]
    result = imported(tmp_path / "rows.kml", kml(*rows))
    assert result.scenario.rows == 4
    assert "joined from pieces in one line: r1 (2 pieces)" in result.notes


# Entities that contain each other many times, by which a small file would fill the memory.
BOMB = '<!DOCTYPE kml [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]>'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (kml(*ROWS)[:-20], "is not XML: unclosed token"),
        ("<html><body/></html>", "is XML, but no KML: it is <html>; export its rows as KML"),
        (kml(*ROWS).replace(HEAD, HEAD + BOMB), "declares a document type, which is not read"),
        (kml("<Folder>" * 200 + "</Folder>" * 200), "has more than 100 elements within each other"),
        (kml(*ROWS).replace('"UTF-8"', '"nonsense"'), "is not XML: unknown encoding"),
        (kml(placemark("r1", line(0).replace("176.325,", "176.325 "))), "feature r1: its point 1"),
        (kml(), "has 0 rows; must be 3 to 100"),
    ],
)
def test_what_is_no_kml_of_rows_is_told(tmp_path, text: str, words: str):
    assert words in error_of(tmp_path / "rows.kml", text)


def test_an_outline_with_a_hole_is_refused(tmp_path):
    """The rows would lead through the hole."""
    ring = "<LinearRing><coordinates>{}</coordinates></LinearRing>"
    outer = ring.format("176.32,-37.79 176.33,-37.79 176.33,-37.8 176.32,-37.8 176.32,-37.79")
    inner = ring.format("176.324,-37.794 176.326,-37.794 176.326,-37.796 176.324,-37.794")
    outline = f"<outerBoundaryIs>{outer}</outerBoundaryIs>"
    hole = f"<innerBoundaryIs>{inner}</innerBoundaryIs>"
    text = kml(placemark("Top", f"<Polygon>{outline}{hole}{hole}</Polygon>"))
    words = error_of(tmp_path / "top.kml", text)
    assert "feature Top: has 2 holes, and rows would go through; draw it without" in words
