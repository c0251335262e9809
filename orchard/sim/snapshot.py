"""A whole run as data, and as a file: everything that is needed to go on from a tick with the hash of a run never interrupted.

A file begins with a line that names what it is and the version, then a line with the SHA-256 of the rest; it is written beside its
place and moved there, so that a kill leaves the old file or the new one, never half of one.
"""

import hashlib
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from orchard.contract.messages import Written, pack, unpack

VERSION = 1
HEAD = b"orchard snapshot %d\n"
LARGEST = 1 << 24  # bytes; that of the largest orchard has a hundredth of it
KEPT = 2  # files: the newest, and the one before it


class SnapshotError(Exception):
    """A snapshot that cannot be used; the text names it and says why."""


class Snapshot(msgspec.Struct):
    """A run between two ticks."""

    run: Annotated[str, Meta(pattern="^[A-Za-z0-9_-]{0,64}$")]  # its id
    scenario: dict[str, Any]
    world: dict[str, Any]  # field of World -> a number, or an array's bytes
    digest: Annotated[bytes, Meta(min_length=32, max_length=32)]  # the run's hash so far
    memories: dict[str, bytes | None]  # name -> what its agent remembers, as it sent it
    letters: list[tuple[int, dict[str, Written]]]  # (tick, sender -> what it wrote) of the last two ticks
    figures: dict[str, Any]  # the run's figures so far
    held: list[str] = []  # the agents that somebody held

    @property
    def tick(self) -> int:
        return int(self.world["tick"])


# -- files


def write(snapshot: Snapshot, folder: Path) -> Path:
    """Write a snapshot into a folder, and remove those that are no longer needed. Raises OSError."""
    return store(*as_file(snapshot), folder)


def as_file(snapshot: Snapshot) -> tuple[str, bytes]:
    """The name and the content of a snapshot's file."""
    payload = pack(snapshot)
    head = HEAD % VERSION + hashlib.sha256(payload).hexdigest().encode() + b"\n"
    return f"tick-{snapshot.tick:09d}.snapshot", head + payload


def store(name: str, content: bytes, folder: Path) -> Path:
    """Write such a file into a folder, and remove those that are no longer needed. Raises OSError."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / name
    beside = path.with_suffix(".new")
    with beside.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    beside.replace(path)
    for old in list(_newest_first(folder))[KEPT:]:
        old.unlink()
    return path


def read(path: Path) -> Snapshot:
    """The snapshot in a file. Raises SnapshotError, naming the file and what is wrong with it."""
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST + 1)
    except OSError as error:
        raise SnapshotError(f"{path}: {error.strerror}") from error
    if len(data) > LARGEST:
        raise SnapshotError(f"{path}: larger than {LARGEST} bytes, as no snapshot is")
    found = re.match(rb"orchard snapshot (\d{1,9})\n([0-9a-f]{64})\n", data)
    if not found:
        raise SnapshotError(f"{path}: not a snapshot of an orchard")
    if int(found[1]) != VERSION:
        raise SnapshotError(f"{path}: version {int(found[1])}; this program reads version {VERSION}")
    payload = data[found.end() :]
    if hashlib.sha256(payload).hexdigest().encode() != found[2]:
        raise SnapshotError(f"{path}: torn or changed: its checksum does not fit")
    try:
        snapshot: Snapshot = unpack(payload, Snapshot)
        msgspec.convert(snapshot.world.get("tick"), int)
    except ValueError as error:
        raise SnapshotError(f"{path}: {error}") from error
    return snapshot


def newest(folder: Path, refused: list[str]) -> Snapshot:
    """The newest snapshot in a folder that can be read; why newer ones could not goes into `refused`. Raises SnapshotError."""
    for path in _newest_first(folder):
        try:
            return read(path)
        except SnapshotError as error:
            refused.append(str(error))
    raise SnapshotError("; ".join([*refused, f"{folder}: no snapshot there that can be used"]))


def _newest_first(folder: Path) -> Iterator[Path]:
    yield from sorted(folder.glob("tick-*.snapshot"), reverse=True)
