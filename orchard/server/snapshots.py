"""Snapshots of a run that physics owns: one at its first tick, and then one now and then, for whoever goes on from there."""

import fcntl
import logging
import os
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path

from orchard.sim.snapshot import Snapshot, SnapshotError, as_file, newest, store

SNAPSHOT_SECONDS = 2.0  # of wall time between two snapshots
KEPT_SECONDS = 2.0  # for which a person who stops robots is kept waiting for the disk

log = logging.getLogger("orchard")


@contextmanager
def sole(folder: Path | None) -> Iterator[None]:
    """Within this nobody else keeps snapshots in a folder. Raises SnapshotError where somebody does.

    The lock goes with the process that holds it, however that ends. A folder that cannot be made is told of by `Keeper`.
    """
    if folder is None:
        yield
        return
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
    with _locked(folder):
        yield


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    try:
        opened = os.open(folder, os.O_RDONLY)
    except OSError:
        yield
        return
    try:
        _lock(opened, folder)
        yield
    finally:
        os.close(opened)


def _lock(opened: int, folder: Path) -> None:
    try:
        fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise SnapshotError(f"{folder}: the run of these snapshots goes on still; stop it first") from error


class SnapshotWriter:
    """Writes snapshots into a folder, `seconds` of wall time apart; none without a folder.

    A thread of its own writes, so that a slow disk holds up nobody; while it writes no other snapshot is due.
    """

    def __init__(self, folder: Path | None, seconds: float) -> None:
        self._folder, self._seconds = folder, seconds
        self._due = 0.0  # on the clock
        self._hand = ThreadPoolExecutor(max_workers=1)
        self._writing: Future[bool] | None = None
        self._failed = False

    def is_due(self) -> bool:
        is_idle = self._writing is None or self._writing.done()
        return self._folder is not None and is_idle and time.monotonic() >= self._due

    def keep(self, snapshot: Snapshot) -> None:
        """Begin to write it, once the one before is written; one that waits for that is left out, for this is newer."""
        if self._folder is None:
            return
        if self._writing is not None:
            self._writing.cancel()
        self._writing = self._hand.submit(self._store, *as_file(snapshot), self._folder)
        self._due = time.monotonic() + self._seconds

    def _store(self, name: str, content: bytes, folder: Path) -> bool:
        """Whether it could be written. A disk that is full is told of once."""
        try:
            store(name, content, folder)
        except OSError as error:
            if not self._failed:
                log.error("no snapshot: %s", error)
            self._failed = True
            return False
        return True

    def finish(self, seconds: float | None = None) -> bool:
        """Wait until what was kept last is on the disk, or for so long; whether it is there."""
        try:
            return self._writing is not None and self._writing.result(seconds)
        except TimeoutError:
            return False


def last(folder: Path) -> Snapshot | None:
    """The newest snapshot in a folder that can be used; None where none was ever written. Raises SnapshotError where all are bad."""
    refused: list[str] = []
    if not folder.is_dir() or not any(folder.glob("tick-*.snapshot")):
        return None
    try:
        return newest(folder, refused)
    finally:
        for why in refused:
            log.warning("not used: %s", why)
