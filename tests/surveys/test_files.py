"""A file of another kind is told in words, and packed files are read."""

from io import BytesIO
from zipfile import ZIP_DEFLATED, ZipFile

import pytest

from orchard.field.problems import ScenarioError
from orchard.surveys.importing import import_survey


def packed(files: dict[str, bytes]) -> bytes:
    """Return the bytes of a zip archive with these files."""
    content = BytesIO()
    with ZipFile(content, "w", ZIP_DEFLATED) as archive:
        for name, inner in files.items():
            archive.writestr(name, inner)
    return content.getvalue()


# The content of a file that has no rows, and what is said of it.
OTHERS = [
    (b"", "is empty"),
    (b" \n\n", "is empty"),
    (b"\x89PNG\r\n\x1a\n\0\0", "is a picture (PNG)"),
    (b"%PDF-1.7", "is a PDF"),
    (b"PK\x03\x04\x14\0", "is a zip archive that is damaged"),
    (packed({"a.txt": b"x"}), "is a zip archive without a file of rows; expected one of .shp"),
    (packed({"[Content_Types].xml": b"x", "xl/a.xml": b"x"}), "is a file of an office program"),
    (packed({"in.zip": packed({"a.kml": b"x"})}), "is a zip archive without a file of rows"),
    (packed({"a.kml": b"x", "b/c.csv": b"x"}), "is a zip archive with a.kml and b/c.csv; unpack"),
    (packed({"a.csv": b" \n"}), "is empty"),
    (packed({"a.kml": packed({"b.kml": b"x"})}), "is not XML"),
    (packed({"a.csv": packed({"b.csv": b"x"})}), "is no text"),
    (packed({"a.csv": bytes(60_000_000)}), "is too large unpacked; at most 50,000,000 bytes"),
    (b"\x1f\x8b\x08\0", "is packed by gzip; unpack it"),
    (b'{"type": "FeatureCollection", "features": [{"ty', "is not JSON"),
    (b'{"type": "Feature", "geometry": null}', "must be a GeoJSON FeatureCollection"),
]


@pytest.mark.parametrize("name", ["rows.geojson", "rows.csv", "rows"])
@pytest.mark.parametrize(("content", "words"), OTHERS)
def test_another_kind_of_file_is_told(tmp_path, content: bytes, words: str, name: str):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(ScenarioError) as raised:
        import_survey(path)
    assert f"{path}: {words}" in str(raised.value)


def test_a_packed_file_has_the_rows_of_the_file(tmp_path):
    """A file in a KMZ may lie in a folder, beside pictures and the hidden twins that macOS adds.

    The rows are 88 m long and 5.6 m apart (0.001 degrees of longitude, 5e-5 of latitude).
    """
    lines = "".join(
        f"<Placemark><name>{number}</name><LineString><coordinates>176.32,{-37.79 - 5e-5 * number}"
        f" 176.321,{-37.79 - 5e-5 * number}</coordinates></LineString></Placemark>"
        for number in range(4)
    )
    kml = f"<kml><Document>{lines}</Document></kml>".encode()
    plain = tmp_path / "rows.kml"
    plain.write_bytes(kml)
    archive = tmp_path / "rows.kmz"
    files = {"block/doc.kml": kml, "__MACOSX/block/._doc.kml": b"x", "icon.png": b"x"}
    archive.write_bytes(packed(files))
    assert import_survey(archive).scenario == import_survey(plain).scenario
