"""The folders in which the program writes for its user, and the files that it reads and writes:
whole, or not at all.
"""

import errno
import os
import re
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import platformdirs

RUNS = "ORCHARD_RUNS"  # environment variable: another folder of runs
_HERE = Path(__file__).parent
# The folder that the package is in: of a clone its top level; of an installed package a folder of
# many packages.
ABOVE = _HERE.parent


def runs_folder(above: Path = ABOVE) -> Path:
    """Return the folder for recordings, snapshots and notes of active runs. It need not exist yet.

    `above` is the folder that the package is in. A clone keeps its own runs, whichever way it is
    started. The installed package keeps them with the user's data, never where it is installed.
    """
    is_clone = (above / "run.py").is_file() and (above / "pyproject.toml").is_file()
    if is_clone:
        own = above
    else:
        own = platformdirs.user_data_path("orchard", appauthor=False)
    return Path(os.environ.get(RUNS) or own / "runs").absolute()


def regular(path: str | Path) -> Path:
    """Return the path of a file.

    Raises OSError if it is no regular file: from a named pipe or a device a read may never return.
    """
    mode = os.stat(path).st_mode
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, "is no regular file")
    return Path(path)


def real(path: Path) -> Path:
    """Return the path to which links lead, as far as it is there.

    `Path.resolve` raises RuntimeError where links lead in a circle. Here such a path stays, and
    the error comes where it is opened.
    """
    return Path(os.path.realpath(path))


@contextmanager
def named(path: Path) -> Iterator[None]:
    """In this context a file or a folder is written. An OSError that is raised there gets its path.

    The error of a full disk has none, and the user would not learn which disk that is.
    """
    try:
        yield
    except OSError as error:
        if error.filename is not None or error.strerror is None:
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error


def write_whole(path: Path, content: bytes) -> None:
    """Write a file, in place of an old one, so that a kill leaves the old file or the new one.

    Raises OSError, and leaves nothing then.
    """
    # Readers of a folder pass over names with a dot.
    beside = path.with_name(f".{path.name}.{os.getpid()}.new")
    try:
        with beside.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
    except OSError as error:
        beside.unlink(missing_ok=True)
        raise OSError(error.errno, error.strerror, str(path)) from error


def half_written(folder: Path, name: str) -> list[Path]:
    """Return the files that `write_whole` has left in a folder when a kill ended it in the middle.

    `name`: a regular expression for the names of the whole files. Other files are left out: they
    may be of other programs.
    """
    left = re.compile(rf"\.(?:{name})\.\d+\.new")
    return [path for path in folder.glob(".*.new") if left.fullmatch(path.name)]


def newest_path(paths: Iterable[Path]) -> Path | None:
    """Return the path that was changed last; None without any. Paths that are gone do not count."""
    there = [path for path in paths if path.exists()]
    return max(there, key=lambda path: path.stat().st_mtime, default=None)
