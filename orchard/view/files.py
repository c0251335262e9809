"""The files of a recording, NAME.rrd, NAME.part2.rrd, ..., and the path of Rerun's program that
opens them.
"""

import logging
import os
import re
import sys
import threading
from importlib.util import find_spec
from itertools import count, takewhile
from pathlib import Path

from orchard.folders import newest_path

# The bytes with which each recording begins.
HEAD = b"RRF"


def part(path: Path, number: int) -> Path:
    """Return the path of a part. Parts are numbered from 1."""
    if number == 1:
        return path
    return path.with_suffix(f".part{number}{path.suffix}")


def is_further_part(path: Path) -> bool:
    """Return whether a file is part 2 or later of a recording."""
    return re.search(r"\.part\d+$", path.stem) is not None


def parts_of(path: Path) -> list[Path]:
    """Return the existing parts in order, up to the first one that is missing."""
    return list(takewhile(Path.exists, (part(path, number) for number in count(1))))


def existing_recording(path: Path | None, folder: Path) -> Path:
    """Return the first part of a recording: that of a file, or of the newest one in a folder.

    Raises OSError or ValueError if there is none, or if the file is no recording.
    """
    if path is None:
        first_parts = (file for file in folder.glob("*.rrd") if not is_further_part(file))
        path = newest_path(first_parts)
    if path is None or not path.is_file():
        raise ValueError(
            f"{path or folder}: no recording there; a run without --record none makes one"
        )
    if not is_recording(path):
        raise ValueError(
            f"{path}: it cannot be read: it is no recording; "
            "expected a file NAME.rrd that a run has written"
        )
    return path


def packing(path: Path) -> Path:
    """Return the path of the packed copy while it is written.

    It is that of no recording: a kill may leave half of it.
    """
    return path.with_suffix(f"{path.suffix}.packing")


def remove_half_packed(path: Path) -> None:
    """Delete what processes have left that were killed while they packed a recording's parts."""
    for whole in parts_of(path):
        if _may_be_replaced(packing(whole)):
            packing(whole).unlink(missing_ok=True)


def is_recording(path: Path) -> bool:
    """Return whether a file begins as a recording. Raises OSError if it cannot be read."""
    return _head_of(path) == HEAD


def _head_of(path: Path) -> bytes:
    """Return the first bytes of a file. Raises OSError."""
    with path.open("rb") as file:
        return file.read(len(HEAD))


def _may_be_replaced(path: Path) -> bool:
    """Whether there is nothing in the place of a recording but a recording, or an empty file."""
    return not path.exists() or (path.is_file() and _head_of(path) in (HEAD, b""))


def check_recording(path: Path) -> None:
    """Raise ValueError for files that a recording must not replace, by their names or contents.

    Its further parts, and the copies that are made to pack it, are such files too.
    """
    if path.suffix != ".rrd":
        raise ValueError(
            f"{path}: a recording would replace this file; expected a name that ends in .rrd, as"
            f" {path.with_suffix('.rrd')}"
        )
    if is_further_part(path):
        raise ValueError(
            f"{path}: a further part of another recording has such a name; expected one without"
            " .part and a number"
        )
    parts = parts_of(path) or [path]
    for file in (*parts, *map(packing, parts)):
        if not _may_be_replaced(file):
            raise ValueError(
                f"{file}: this file is no recording, and is not replaced; "
                "expected another name, or a recording"
            )


def remove_further_parts(path: Path) -> None:
    """Delete parts 2 and later, before a new recording replaces an old one."""
    for old in parts_of(path)[1:]:
        old.unlink()


CHOSEN = "RERUN_CLI_PATH"  # Rerun's own variable; it names another program
# Environment of Rerun's program, which otherwise reports each of its steps.
QUIET = {"RUST_LOG": "error"}


def viewer_program() -> str:
    """Return the path of Rerun's program. Raises FileNotFoundError if there is no such file.

    `python -m rerun` is not used: it starts the program as a child, which keeps running when its
    parent is ended.
    """
    chosen = os.environ.get(CHOSEN)
    if chosen:
        path = Path(chosen)
        place = f"{CHOSEN}={path}"
    else:
        path = _packaged_viewer()
        place = str(path)
    if not path.is_file():
        raise FileNotFoundError(
            f"{place}: no such program; expected Rerun's viewer, which the package rerun-sdk"
            " installs"
        )
    return str(path)


def _packaged_viewer() -> Path:
    """Return where the package rerun-sdk has Rerun's program.

    Nothing is imported, and the virtual environment need not be active.
    """
    package = find_spec("rerun_cli")
    if package is None or package.origin is None:
        return Path("rerun")
    return Path(package.origin).with_name("rerun")


# Variables that name a screen on Linux.
SCREENS = ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET")
IN_A_BROWSER = "to watch in a browser on this machine, give --web 9090, or another port"


def window(*sources: str) -> list[str]:
    """Return the command line of a viewer window for data of this machine.

    `sources`: recordings, or addresses of data. Raises FileNotFoundError, OSError without a screen.
    """
    program = viewer_program()
    if sys.platform == "linux" and not any(map(os.environ.get, SCREENS)):
        raise OSError(
            "no screen for the viewer's window: neither DISPLAY nor WAYLAND_DISPLAY is set;"
            f" {IN_A_BROWSER}"
        )
    return [program, "--bind", "127.0.0.1", *sources]


PIECE = 1 << 16  # bytes

log = logging.getLogger("orchard")


class RecordingFile(threading.Thread):
    """Writes into a file what is written into the pipe `inlet`.

    On a full disk, where Rerun's own sink hangs, it reads on.

    Call `seal` when the writer has opened the inlet, and `join` when the writer has closed it.
    """

    def __init__(self, path: Path) -> None:
        """Raises OSError if the file cannot be opened."""
        super().__init__(name="recording", daemon=True)
        self.path = path
        self._file = path.open("wb", buffering=0)
        self._outlet, self._own_inlet = os.pipe()
        self.inlet = f"/dev/fd/{self._own_inlet}"
        self.is_whole = True
        self.start()

    def seal(self) -> None:
        """Close this end of the inlet, so that the pipe ends with its writer."""
        os.close(self._own_inlet)

    def run(self) -> None:
        """Write what is read until the pipe ends."""
        with self._file, open(self._outlet, "rb", buffering=0) as pipe:
            while piece := pipe.read(PIECE):
                if self.is_whole:
                    self._write(piece)

    def _write(self, piece: bytes) -> None:
        """Write a piece; log that the file is no longer whole if that fails."""
        try:
            while piece:
                written = self._file.write(piece)
                piece = piece[written:]
        except OSError as error:
            self.is_whole = False
            log.error("%s: %s; the rest of the run is not recorded", self.path, error.strerror)
