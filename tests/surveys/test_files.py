"""A file of another kind is told in words."""

import pytest

from orchard.field.problems import ScenarioError
from orchard.surveys.importing import import_survey

OTHERS = [
    (b"", "is empty"),
    (b" \n\n", "is empty"),
    (b"\x89PNG\r\n\x1a\n\0\0", "is a picture (PNG)"),
    (b"%PDF-1.7", "is a PDF"),
    (b"PK\x03\x04\x14\0", "is a zip archive, such as KMZ or a packed shapefile; unpack it"),
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
