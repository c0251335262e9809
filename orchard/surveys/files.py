"""Reads a file of rows: finds its format by its content, whatever its name is.

A file of another format is refused with the name of that format.
"""

from codecs import BOM_UTF8, BOM_UTF16_BE, BOM_UTF16_LE

from orchard.field.problems import Problem, ScenarioError
from orchard.folders import regular
from orchard.surveys.features import SurveyFile, with_short_names
from orchard.surveys.geojson import read_geojson
from orchard.surveys.kml import read_kml
from orchard.surveys.layers import GEOPACKAGE, SHAPEFILE, read_layers
from orchard.surveys.options import Source
from orchard.surveys.packed import ZIP, unpacked
from orchard.surveys.table import read_table

# Bytes. GDAL reads larger files by itself.
LARGEST_FILE = 10_000_000
READABLE = "a file of rows is GeoJSON, KML, CSV, GeoPackage or Shapefile, or a zip archive of one"
# First bytes of files that people take for a file of rows -> what they are.
_OTHERS = {
    b"\x89PNG": "a picture (PNG)",
    b"\xff\xd8\xff": "a picture (JPEG)",
    b"II*\0": "a picture (TIFF)",
    b"MM\0*": "a picture (TIFF)",
    b"%PDF": "a PDF",
    b"\x1f\x8b": "packed by gzip; unpack it",
    b"AC10": "a drawing (DWG)",
}


# Files that belong to a Shapefile.
_BESIDE_SHAPEFILE = (".shx", ".dbf", ".prj", ".cpg", ".qpj")


def read_survey(source: Source) -> SurveyFile:
    """Return what a file holds. Raises ScenarioError."""
    if _content(source).startswith(ZIP):
        with unpacked(source) as inner:
            survey = _read(inner)
    else:
        survey = _read(source)
    return survey._replace(features=with_short_names(survey.features))


def _read(source: Source) -> SurveyFile:
    """Return what a file holds, with names as they stand in the file. Raises ScenarioError."""
    content = _content(source)
    for beginning, words in _OTHERS.items():
        if content.startswith(beginning):
            raise _fault(source, f"is {words}; {READABLE}")
    suffix = source.path.suffix.lower()
    if suffix in _BESIDE_SHAPEFILE:
        raise _fault(source, f"belongs to a Shapefile; give its file {source.path.stem}.shp")
    if content.startswith((GEOPACKAGE, SHAPEFILE)):
        return read_layers(source)
    if source.options.layer is not None:
        raise _fault(source, "has no layers, which a GeoPackage has; leave out --layer")
    if len(content) > LARGEST_FILE:
        raise _fault(source, f"is too large; at most {LARGEST_FILE:,} bytes")
    return _read_text(content, source)


def _read_text(content: bytes, source: Source) -> SurveyFile:
    """Return what a file of text holds. Raises ScenarioError."""
    begin = content.removeprefix(BOM_UTF8).lstrip()
    if not begin:
        raise _fault(source, f"is empty; {READABLE}")
    if begin.startswith((b"{", b"[")):
        return read_geojson(begin, source.file)
    if begin.startswith(b"<") or source.path.suffix.lower() == ".kml":
        return read_kml(begin, source.file)
    if b"\0" in begin and not content.startswith((BOM_UTF16_LE, BOM_UTF16_BE)):
        raise _fault(source, f"is no text; {READABLE}")
    return read_table(content, source.file)


def _fault(source: Source, text: str) -> ScenarioError:
    """Return what is wrong with a file, to be raised."""
    return ScenarioError([Problem(source.file, text)])


def _content(source: Source) -> bytes:
    """Return the bytes of a file, at most one more than are read. Raises ScenarioError."""
    try:
        with regular(source.path).open("rb") as opened:
            return opened.read(LARGEST_FILE + 1)
    except OSError as error:
        raise _fault(source, f"cannot be read: {error.strerror}") from None
