"""Unpacks the one file of rows that a zip archive holds, such as a packed Shapefile or KMZ."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from zipfile import BadZipFile, ZipFile, ZipInfo

from orchard.field.problems import Problem, ScenarioError, printable
from orchard.surveys.choosing import listed
from orchard.surveys.options import Source

# How a zip archive begins.
ZIP = b"PK\x03\x04"
# Endings of the names of files of rows.
OF_ROWS = (".shp", ".gpkg", ".kml", ".geojson", ".json", ".csv")
# A file in every archive of Office Open XML: in XLSX and DOCX.
OF_OFFICE = "[Content_Types].xml"
# Bytes of a file of rows, with the files that belong to it, when they are unpacked.
MOST_UNPACKED = 50_000_000


@contextmanager
def unpacked(source: Source) -> Iterator[Source]:
    """Yield the file of rows in an archive, unpacked. Problems name it by the archive's name.

    It is removed at the end of the context. Raises ScenarioError if there is not exactly one.
    """
    with TemporaryDirectory() as folder:
        try:
            with ZipFile(source.path) as archive:
                path = _unpack(archive, source, Path(folder))
        except (BadZipFile, EOFError, NotImplementedError, OSError) as error:
            raise _fault(source, f"is a zip archive that is damaged: {error}") from None
        except RuntimeError as error:
            raise _fault(source, f"is a zip archive that cannot be unpacked: {error}") from None
        yield source._replace(path=path)


def _unpack(archive: ZipFile, source: Source, folder: Path) -> Path:
    """Write the file of rows into a folder, with the files that belong to it. Return its path.

    Files of the same name without ending belong together, as those of a Shapefile.
    """
    member = _of_rows(archive, source)
    stem = PurePosixPath(member.filename).with_suffix("")
    size = 0
    for part in archive.infolist():
        path = PurePosixPath(part.filename)
        if part.is_dir() or path.with_suffix("") != stem:
            continue
        size += part.file_size
        if size > MOST_UNPACKED:
            raise _fault(source, f"is too large unpacked; at most {MOST_UNPACKED:,} bytes")
        # The names are chosen here, so none leads out of the folder, as one in the archive could.
        (folder / f"rows{path.suffix.lower()}").write_bytes(archive.read(part))
    return folder / f"rows{PurePosixPath(member.filename).suffix.lower()}"


def _of_rows(archive: ZipFile, source: Source) -> ZipInfo:
    """Return the one file of rows that an archive holds. Raises ScenarioError."""
    members = []
    for part in archive.infolist():
        path = PurePosixPath(part.filename)
        # Some systems pack a hidden twin of each file.
        is_hidden = path.name.startswith(".") or "__MACOSX" in path.parts
        if path.suffix.lower() in OF_ROWS and not part.is_dir() and not is_hidden:
            members.append(part)
    if not members:
        if OF_OFFICE in archive.namelist():
            raise _fault(source, "is a file of an office program, such as XLSX; save it as CSV")
        wanted = ", ".join(OF_ROWS)
        raise _fault(source, f"is a zip archive without a file of rows; expected one of {wanted}")
    if len(members) > 1:
        names = listed([printable(part.filename) for part in members])
        raise _fault(source, f"is a zip archive with {names}; unpack it, and give one of them")
    return members[0]


def _fault(source: Source, text: str) -> ScenarioError:
    """Return what is wrong with an archive, to be raised."""
    return ScenarioError([Problem(source.file, text)])
