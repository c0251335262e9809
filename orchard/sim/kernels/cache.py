"""The folder of the compiled kernels, and its files.

This module does not import numba, which takes long to load.
"""

import hashlib
import logging
import os
import re
import time
from contextlib import suppress
from pathlib import Path

from orchard.folders import half_written, regular, write_whole

COMPILING = "compiling for this machine; this is done once and takes up to a minute"
# A kernel that each run calls. Other programs keep theirs in the same folder.
OF_EACH_RUN = "laser.cast_all"
# After so long without use, the kernels of other sources are removed. A program that runs now may
# still load them.
UNUSED_SECONDS = 24 * 3600.0  # s
# Bytes of the SHA-256 of name and code, with which each file begins.
DIGEST = 32
# The names of folders of kernels.
FOLDER = re.compile(r"kernels-[0-9a-f]{16}")
# A file that tells a folder of kernels from a folder of the user.
MARK = "made-by-the-orchard.txt"
MARKED = b"""The Orchard keeps its compiled kernels in this folder.
It removes the folder when no program has used it for a day.
"""

_HERE = Path(__file__).parent
_FIELD = _HERE.parent.parent / "field"
# The modules of `orchard.field` that have constants and functions for the kernels.
_FIELD_MODULES = ("kinds", "lanes", "layout", "passes", "queue", "repeatable", "ticks")
_SOURCES = [
    *sorted(_HERE.glob("*.py")),
    *(_FIELD / f"{module}.py" for module in _FIELD_MODULES),
]

log = logging.getLogger("orchard")


def kernels_folder() -> Path | None:
    """Return a folder with a hash of the sources in its name; None if kernels cannot be stored."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if not chosen and not os.access(_HERE, os.W_OK):
        return None
    sources = b"".join(path.read_bytes() for path in _SOURCES)
    parent = Path(chosen or _HERE / "__pycache__")
    return parent / f"kernels-{hashlib.sha256(sources).hexdigest()[:16]}"


def are_compiled() -> bool:
    """Whether compiled kernels exist for this machine.

    If not, the first tick waits until they are compiled.
    """
    folder = kernels_folder()
    return folder is not None and any(folder.rglob(f"{OF_EACH_RUN}-*.nbc"))


def _remove_unused(own: Path) -> None:
    """Remove the folders of kernels beside a program's own one that nothing has used for so long.

    Another process may do so at the same time.
    """
    for folder in own.parent.glob("kernels-*"):
        with suppress(OSError):
            is_unused = time.time() - folder.stat().st_mtime > UNUSED_SECONDS
            if folder != own and is_unused and _is_made_here(folder):
                _remove(folder)


def _is_made_here(folder: Path) -> bool:
    """Whether a folder has the name and the mark of a folder of kernels, and nothing else in it."""
    if not FOLDER.fullmatch(folder.name) or folder.is_symlink():
        return False
    if regular(folder / MARK).read_bytes() != MARKED:
        return False
    return set(folder.iterdir()) == {folder / MARK, *_kernels_in(folder)}


def _kernels_in(folder: Path) -> list[Path]:
    """Return the files of kernels of a folder, also those that are not written whole."""
    return [*folder.glob("*.nbc"), *half_written(folder, r".+\.nbc")]


def _remove(folder: Path) -> None:
    """Remove a folder of kernels. A file that is added meanwhile stays, and so does the folder."""
    for path in (*_kernels_in(folder), folder / MARK):
        path.unlink(missing_ok=True)
    folder.rmdir()


def _digest(name: str, code: bytes) -> bytes:
    """Return the checksum of a kernel's code, DIGEST bytes."""
    return hashlib.sha256(name.encode() + b"\n" + code).digest()


class KernelFiles:
    """The compiled kernels of a folder.

    Each is in a file that is written whole, with its SHA-256: a file that is torn or changed is not
    used.
    """

    def __init__(self, folder: Path) -> None:
        """The folder need not exist yet."""
        self.folder = folder
        # Each warning is logged once for all files.
        self._logged: set[str] = set()
        # The time tells others that the folder is in use. It may not exist yet, or be of another
        # user.
        with suppress(OSError):
            os.utime(folder)

    def load(self, name: str) -> bytes | None:
        """Return the code of a kernel; None if it must be compiled.

        A fault of a file is logged, once for all files.
        """
        try:
            content = (self.folder / name).read_bytes()
        except FileNotFoundError:
            return None
        except OSError as error:
            fault = f"compiled kernels in {self.folder} cannot be read: {error.strerror}"
            self._warn_once(f"{fault}; they are compiled anew")
            return None
        if _digest(name, content[DIGEST:]) != content[:DIGEST]:
            fault = f"compiled kernels in {self.folder} are torn or changed"
            self._warn_once(f"{fault}; they are compiled anew, which takes up to a minute")
            return None
        return content[DIGEST:]

    def keep(self, name: str, code: bytes) -> None:
        """Write the code of a kernel, and remove kernels of other sources.

        If that fails, it is logged once for all files.
        """
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            if not (self.folder / MARK).exists():
                write_whole(self.folder / MARK, MARKED)
            write_whole(self.folder / name, _digest(name, code) + code)
            _remove_unused(self.folder)
        except OSError as error:
            fault = f"compiled kernels cannot be kept in {self.folder}: {error.strerror}"
            self._warn_once(f"{fault}; the next start compiles them again")

    def _warn_once(self, sentence: str) -> None:
        """Log a warning, unless it was logged before."""
        if sentence not in self._logged:
            self._logged.add(sentence)
            log.warning("%s", sentence)
