"""The notes of the runs on this machine, by which other commands find them.

Each run keeps a note of its endpoint in runs/ while it is active. The process that wrote a note holds a lock on it. The lock ends with
the process, so a note without a lock is stale (`left_over.py`).
"""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import msgspec

from orchard.net.endpoints import BusError


class RunNote(msgspec.Struct):
    """An active run on this machine."""

    run: str  # its id
    endpoint: str
    title: str = ""  # its scenario and the time of its start, for people


@contextmanager
def noted(folder: Path, note: RunNote) -> Iterator[None]:
    """Keep a note in this context, with which other processes on this machine find the run. Raises OSError if it cannot be written."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{note.run}.going"
    beside = path.with_suffix(".new")
    with beside.open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        file.write(msgspec.json.encode(note).decode())
        file.flush()
        os.replace(beside, path)  # no process sees it before it is locked and complete
        try:
            yield
        finally:
            path.unlink(missing_ok=True)


def running_here(folder: Path, gone: list[Path] | None = None) -> list[RunNote]:
    """Return the active runs, sorted by id. Stale notes, of which the run.py is gone, are appended to `gone`."""
    notes = []
    for path in sorted(folder.glob("*.going")):
        with suppress(OSError, msgspec.DecodeError), path.open() as file:  # gone meanwhile, or malformed
            try:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
                if gone is not None:
                    gone.append(path)
            except BlockingIOError:  # the run holds the lock
                notes.append(msgspec.json.decode(file.read(), type=RunNote))
    return notes


def find_runs(folder: Path, connect: str | None) -> list[RunNote]:
    """Return the run at `connect`, or all active runs on this machine. Raises BusError if there is none."""
    runs = running_here(folder) if connect is None else [RunNote("", connect)]
    if not runs:
        raise BusError(
            "no run is active here; for a run elsewhere: --connect ENDPOINT "
            "(a run in local mode has no network, and cannot be reached: Ctrl-C ends it)"
        )
    return runs


def find_run(folder: Path, connect: str | None) -> list[RunNote]:
    """Return the run at `connect`, or the only active run on this machine. Raises BusError if there is none, or several."""
    runs = find_runs(folder, connect)
    if len(runs) > 1:
        which = "\n".join(f"  --connect {note.endpoint}  ({note.title})" for note in runs)
        raise BusError(f"{len(runs)} runs are active here; choose one:\n{which}")
    return runs
