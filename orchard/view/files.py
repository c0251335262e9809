"""The files of a recording, NAME.rrd and its further parts NAME.part2.rrd, ..., and the path of Rerun's program that opens them."""

import os
import re
from itertools import count, takewhile
from pathlib import Path

import rerun_cli

HEAD = b"RRF"  # with which each recording begins


def part(path: Path, number: int) -> Path:
    """Return the path of a part. Parts are numbered from 1."""
    return path if number == 1 else path.with_suffix(f".part{number}{path.suffix}")


def is_further_part(path: Path) -> bool:
    """Return whether a file is part 2 or later of a recording."""
    return re.search(r"\.part\d+$", path.stem) is not None


def parts_of(path: Path) -> list[Path]:
    """Return the existing parts in order, up to the first one that is missing."""
    return list(takewhile(Path.exists, (part(path, number) for number in count(1))))


def check_recording(path: Path) -> None:
    """Raise ValueError for a file that a recording must not replace: one of another name than NAME.rrd, or one with other contents."""
    if path.suffix != ".rrd":
        raise ValueError(f"{path}: a recording would replace this file; expected a name that ends in .rrd, as {path.with_suffix('.rrd')}")
    if path.is_file():
        with path.open("rb") as file:
            head = file.read(len(HEAD))
        if head not in (HEAD, b""):
            raise ValueError(f"{path}: this file is no recording, and is not replaced; expected another name, or a recording")


def remove_further_parts(path: Path) -> None:
    """Delete parts 2 and later, before a new recording replaces an old one."""
    for old in parts_of(path)[1:]:
        old.unlink()


CHOSEN = "RERUN_CLI_PATH"  # Rerun's own variable; it names another program
PACKAGED = Path(rerun_cli.__file__).with_name("rerun")  # found even if the virtual environment is not activated


def viewer_program() -> str:
    """Return the path of Rerun's program. Raises FileNotFoundError if there is no such file.

    `python -m rerun` is not used: it starts the program as a child, which keeps running when its parent is ended.
    """
    path = Path(os.environ.get(CHOSEN) or PACKAGED)
    if not path.is_file():
        which = f"{CHOSEN}={path}" if os.environ.get(CHOSEN) else str(path)
        raise FileNotFoundError(f"{which}: no such program; expected Rerun's viewer, which the package rerun-sdk installs")
    return str(path)


def window(*what: str) -> list[str]:
    """Return the command line of a viewer window, which accepts data from this machine only. Raises FileNotFoundError."""
    return [viewer_program(), "--bind", "127.0.0.1", *what]
