"""Damaged files: what a reader of snapshots owes them."""

from contextlib import suppress
from pathlib import Path

from orchard.snapshot import SnapshotError, read
from orchard.thaw import world_from


def assert_usable_or_refused(path: Path, data: bytes) -> None:
    path.write_bytes(data)
    with suppress(SnapshotError):
        world_from(read(path))
