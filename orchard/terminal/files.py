"""The files that a command writes: they are checked before it begins its work."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from orchard.field.problems import Problem
from orchard.folders import real

# Bytes at the beginning of a file by which its kind is known.
HEAD = 1 << 16


@dataclass(frozen=True)
class KindOfFile:
    """A kind of file that commands write. A file of this kind may be replaced by a new one.

    `name`: what it is, for a sentence: "a summary". `mark`: a regular expression for the bytes at
    the beginning of each file of this kind that the Orchard has written.
    """

    name: str
    mark: bytes

    def is_kind_of(self, path: Path) -> bool:
        """Whether the Orchard has written a file as one of this kind. Raises OSError."""
        with path.open("rb") as file:
            return re.match(self.mark, file.read(HEAD), re.DOTALL) is not None


def check_writable(path: Path, read: Path | None = None, kind: KindOfFile | None = None) -> None:
    """Raise OSError if a file cannot be written. An existing file is not changed.

    `read`: a file that the command reads; `path` must not be the same file. `kind`: of what is
    written. An existing file must be empty or of that kind, or the user would lose what is in it.
    """
    if read is not None and path.exists() and read.exists() and path.samefile(read):
        raise OSError(f"{path}: cannot be written: it is the file that is read; expected another")
    # To open a named pipe would wait for a reader. /dev/stdout is allowed, even where stdout is a
    # pipe: that has no name, so nothing is at its real path, such as /proc/7/fd/pipe:[9].
    if real(path).is_fifo():
        raise OSError(f"{path}: is a named pipe; expected a file")
    is_new = not path.exists()
    try:
        path.open("ab").close()
    except OSError as error:
        expected = "expected a file in a directory that exists and can be written"
        raise OSError(f"{path}: cannot be written: {error.strerror}; {expected}") from error
    if is_new:
        # The check has made an empty file. If `path` is a link, the file that it leads to is
        # removed, and the link stays.
        real(path).unlink()
    elif kind is not None and not _may_be_replaced(path, kind):
        raise OSError(
            f"{path}: cannot be written: this file is not {kind.name} that the Orchard has"
            " written, and is not replaced; expected another name"
        )


def _may_be_replaced(path: Path, kind: KindOfFile) -> bool:
    """Whether a file holds nothing that a user could miss: it is a device, empty or of the kind."""
    return not path.is_file() or not path.stat().st_size or kind.is_kind_of(path)


def one_file(written: Sequence[Path]) -> Iterator[Problem]:
    """Yield what is wrong if some of the files that a command writes are one."""
    files = [real(path) for path in written]
    same = [str(path) for path, file in zip(written, files, strict=True) if files.count(file) > 1]
    if same:
        yield Problem("--summary", f"{', '.join(same)}: two of these are one file")
