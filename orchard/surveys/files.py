"""Reads a file of rows by what it holds, whatever its name is; says what another file is."""

from pathlib import Path

from orchard.field.problems import Problem, ScenarioError
from orchard.folders import regular
from orchard.surveys.features import SurveyFile
from orchard.surveys.geojson import read_geojson

LARGEST_FILE = 10_000_000  # bytes
READABLE = "a file of rows is GeoJSON"
# How files begin that people take for a file of rows.
_OTHERS = {
    b"\x89PNG": "a picture (PNG)",
    b"\xff\xd8\xff": "a picture (JPEG)",
    b"II*\0": "a picture (TIFF)",
    b"MM\0*": "a picture (TIFF)",
    b"%PDF": "a PDF",
    b"PK\x03\x04": "a zip archive, such as KMZ or a packed shapefile; unpack it",
    b"\x1f\x8b": "packed by gzip; unpack it",
    b"AC10": "a drawing (DWG)",
}


def read_survey(path: Path, file: str) -> SurveyFile:
    """Return what a file holds. Raises ScenarioError."""
    content = _content(path, file)
    for beginning, words in _OTHERS.items():
        if content.startswith(beginning):
            raise ScenarioError([Problem(file, f"is {words}; {READABLE}")])
    if not content.strip():
        raise ScenarioError([Problem(file, f"is empty; {READABLE}")])
    return read_geojson(content, file)


def _content(path: Path, file: str) -> bytes:
    """Return the bytes of a file. Raises ScenarioError."""
    try:
        with regular(path).open("rb") as opened:
            content = opened.read(LARGEST_FILE + 1)
    except OSError as error:
        raise ScenarioError([Problem(file, f"cannot be read: {error.strerror}")]) from None
    if len(content) > LARGEST_FILE:
        raise ScenarioError([Problem(file, f"is too large; at most {LARGEST_FILE:,} bytes")])
    return content
