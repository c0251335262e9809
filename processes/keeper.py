"""Snapshots of a run that physics owns: one at its first tick, and then one now and then, for whoever goes on from there."""

import logging
import time
from pathlib import Path

from orchard.snapshot import Snapshot, newest, write

SNAPSHOT_SECONDS = 2.0  # of wall time between two snapshots

log = logging.getLogger("orchard")


class Keeper:
    """Writes snapshots into a folder, `seconds` of wall time apart; none without a folder."""

    def __init__(self, folder: Path | None, seconds: float) -> None:
        self._folder, self._seconds = folder, seconds
        self._due = 0.0  # on the clock
        self._failed = False

    def is_due(self) -> bool:
        return self._folder is not None and time.monotonic() >= self._due

    def keep(self, snapshot: Snapshot) -> None:
        """Write it. A disk that is full is told of once, and holds up nobody."""
        if self._folder is None:
            return
        try:
            write(snapshot, self._folder)
        except OSError as error:
            if not self._failed:
                log.error("no snapshot of tick %d: %s", snapshot.tick, error)
            self._failed = True
        self._due = time.monotonic() + self._seconds


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
