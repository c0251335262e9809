"""Damaged files: what a reader of snapshots owes them."""

from contextlib import suppress
from pathlib import Path

from orchard.sim.restore import world_from
from orchard.sim.snapshot import SnapshotError, read


def assert_usable_or_refused(path: Path, data: bytes) -> None:
    path.write_bytes(data)
    with suppress(SnapshotError):
        world_from(read(path))
