"""A whole run as data, and as a file: a run that is resumed from it gets the same hash as a run without interruption.

The first line of a file names its format and version. The second line is the SHA-256 of the rest.
"""

import hashlib
import re
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from orchard.contract.messages import Written, pack, unpack
from orchard.folders import half_written, regular, write_whole

VERSION = 9
HEAD = b"orchard snapshot %d\n"
LARGEST = 1 << 24  # bytes; the snapshot of the largest orchard has a hundredth of that
KEPT = 2  # files: the newest two
STEM, SNAPSHOT, KEYFRAME = (
    "tick-%09d",
    ".snapshot",
    ".keyframe",
)  # keyframes stay: from each of them a run can be forked
RUN = "run"  # file: the id of the run that writes its snapshots into the folder
# The names of its snapshots and keyframes, as a regular expression.
NAMES = rf"tick-\d{{9,}}(?:{re.escape(SNAPSHOT)}|{re.escape(KEYFRAME)})"


class SnapshotError(Exception):
    """A snapshot cannot be used. The text names the reason."""


class Snapshot(msgspec.Struct):
    """The state of a run between two ticks."""

    run: Annotated[str, Meta(pattern="^[A-Za-z0-9_-]{0,64}$")]  # the run's id
    scenario: dict[str, Any]
    world: dict[str, Any]  # field of World -> a number, or an array's bytes
    digest: Annotated[bytes, Meta(min_length=32, max_length=32)]  # the run's hash so far
    memories: dict[str, bytes | None]  # name -> the agent's memory as msgpack
    letters: list[
        tuple[int, dict[str, Written]]
    ]  # (tick, sender -> its letters) of the last two ticks
    figures: dict[str, Any]  # the run's figures so far
    owned: list[str] = []  # the agents that a session owned
    lost: dict[
        str, int
    ] = {}  # agent -> the first tick for which lockstep has not waited for it: from there on the hash is another
    elsewhere: list[str] = []  # the agents that were left to clients elsewhere

    @property
    def tick(self) -> int:
        return int(self.world["tick"])


# -- files


def as_file(snapshot: Snapshot) -> tuple[str, bytes]:
    payload = pack(snapshot)
    head = HEAD % VERSION + hashlib.sha256(payload).hexdigest().encode() + b"\n"
    return STEM % snapshot.tick + SNAPSHOT, head + payload


def store(name: str, content: bytes, folder: Path, run: str = "") -> Path:
    """Write a file of `as_file` into a run's folder, and return its path. Raises OSError.

    What it outdates is removed, and what a process has left that was killed while it wrote.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path, others = folder / name, list[Path]()
    if run_of(folder) != run:
        others = [old for old in snapshots_in(folder) if old != path]
        write_whole(folder / RUN, run.encode())
    write_whole(path, content)
    for old in (*(others or _outdated(path)), *half_written(folder, f"{NAMES}|{RUN}")):
        old.unlink(missing_ok=True)
    return path


def snapshots_in(folder: Path, *suffixes: str) -> list[Path]:
    """Return the snapshots and keyframes of a folder, or those with these suffixes, in any order.

    Files with names that the program does not give are others' and are left out.
    """
    return [
        path
        for path in folder.glob("tick-*")
        if re.fullmatch(NAMES, path.name) and (not suffixes or path.suffix in suffixes)
    ]


def _outdated(path: Path) -> list[Path]:
    """Return the files that a new one outdates: all but the KEPT last ones, or no keyframe; all, if the run has begun, or begun again."""
    written = _newest_first(path.parent, path.suffix)
    written.sort(
        key=lambda old: old.lstat().st_mtime_ns, reverse=True
    )  # the highest tick may be damaged
    others = [
        old for old in written if old != path
    ]  # a clock that was set back must not remove this one
    return (
        others if path.stem == STEM % 0 else [] if path.suffix == KEYFRAME else others[KEPT - 1 :]
    )


def read(path: Path) -> Snapshot:
    """Return the snapshot in a file. Raises SnapshotError, which names the fault."""
    try:
        with regular(path).open("rb") as file:
            data = file.read(LARGEST + 1)
    except OSError as error:
        raise SnapshotError(error.strerror or "cannot be read") from error
    if len(data) > LARGEST:
        raise SnapshotError(f"larger than {LARGEST} bytes: not a snapshot")
    found = re.match(rb"orchard snapshot (\d{1,9})\n([0-9a-f]{64})\n", data)
    if not found:
        raise SnapshotError("not a snapshot of an orchard")
    if int(found[1]) != VERSION:
        raise SnapshotError(f"version {int(found[1])}; this program reads version {VERSION}")
    payload = data[found.end() :]
    if hashlib.sha256(payload).hexdigest().encode() != found[2]:
        raise SnapshotError("truncated or changed: the checksum is wrong")
    try:
        snapshot: Snapshot = unpack(payload, Snapshot)
        msgspec.convert(snapshot.world.get("tick"), int)
    except ValueError as error:
        raise SnapshotError(str(error)) from error
    return snapshot


def run_of(folder: Path) -> str:
    """Return the id of the run to which a folder of snapshots belongs; '' if it has none."""
    try:
        return regular(folder / RUN).read_text(errors="replace")[:100]
    except OSError:
        return ""


def newest(
    folder: Path,
    refused: list[str],
    run: str = "",
    examine: Callable[[Snapshot], object] = lambda snapshot: snapshot,
    until: int | None = None,
) -> Snapshot:
    """Return the newest usable snapshot in a folder; append the faults of others to `refused`. Raises SnapshotError if there is none.

    `run`: the id of the run to which it must belong; '' for that of the folder. `examine`: raises SnapshotError for impossible content.
    `until`: the newest one up to this tick, which may be a keyframe.
    """
    expected = run or run_of(folder)
    known = (
        _newest_first(folder, SNAPSHOT)
        if until is None
        else _newest_first(folder, KEYFRAME, SNAPSHOT)
    )
    for path in known if until is None else [path for path in known if path.stem <= STEM % until]:
        try:
            found = read(path)
            if found.run != expected:
                raise SnapshotError(
                    f"of another run, {found.run}; expected {expected or f'a file {RUN} there with its id'}"
                )
            examine(found)
        except SnapshotError as error:
            refused.append(f"{path}: {error}")
        else:
            return found
    raise SnapshotError("; ".join([*refused, f"{folder}: no usable snapshot"]))


def ticks_of(folder: Path) -> list[int]:
    """Return the ticks of which a folder has a keyframe or a snapshot, which may be damaged."""
    return sorted({int(path.stem.removeprefix("tick-")) for path in snapshots_in(folder)})


def _newest_first(folder: Path, *suffixes: str) -> list[Path]:
    return sorted(snapshots_in(folder, *suffixes), reverse=True)
