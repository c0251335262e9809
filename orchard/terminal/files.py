"""The files that a command writes: they are checked before it begins its work."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from orchard.field.problems import Problem
from orchard.folders import real


def check_writable(path: Path, read: Path | None = None) -> None:
    """Raise OSError if a file cannot be written. An existing file is not changed.

    `read`: a file that the command reads. It must not be written in its place.
    """
    if read is not None and path.exists() and read.exists() and path.samefile(read):
        raise OSError(f"{path}: cannot be written: it is the file that is read; expected another")
    # A pipe would wait for a reader. /dev/stdout is no pipe here, whatever stdout is.
    if real(path).is_fifo():
        raise OSError(f"{path}: is a named pipe; expected a file")
    is_new = not path.exists()
    try:
        path.open("ab").close()
    except OSError as error:
        expected = "expected a file in a directory that exists and can be written"
        raise OSError(f"{path}: cannot be written: {error.strerror}; {expected}") from error
    if is_new:
        # A link stays.
        real(path).unlink()


def one_file(written: Sequence[Path]) -> Iterator[Problem]:
    """Yield what is wrong if some of the files that a command writes are one."""
    files = [real(path) for path in written]
    same = [str(path) for path, file in zip(written, files, strict=True) if files.count(file) > 1]
    if same:
        yield Problem("--summary", f"{', '.join(same)}: two of these are one file")
