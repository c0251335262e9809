"""Which runs go on on this machine: each leaves a note of where it can be reached, for as long as it goes on.

A note is locked by the process that wrote it. The lock goes with the process, however that ends, so a note without one is stale.
"""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TextIO

import msgspec


class Going(msgspec.Struct):
    """A run that goes on here."""

    run: str  # its id
    endpoint: str


@contextmanager
def noted(folder: Path, going: Going) -> Iterator[None]:
    """Within this, others on this machine can find the run. Raises OSError where no note can be written."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{going.run}.going"
    beside = path.with_suffix(".new")
    with beside.open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        file.write(msgspec.json.encode(going).decode())
        file.flush()
        os.replace(beside, path)  # nobody sees it before it is locked and whole
        try:
            yield
        finally:
            path.unlink(missing_ok=True)


def all_going(folder: Path) -> list[Going]:
    """The runs that go on, by id; stale notes are removed."""
    return [going for path in sorted(folder.glob("*.going")) if (going := _read(path)) is not None]


def _read(path: Path) -> Going | None:
    """None where the note is stale, gone, or no note."""
    with suppress(OSError, msgspec.DecodeError), path.open() as file:
        if _is_locked(file):
            return msgspec.json.decode(file.read(), type=Going)
        path.unlink(missing_ok=True)
    return None


def _is_locked(file: TextIO) -> bool:
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    return False
