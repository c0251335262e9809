"""A whole run as data, and as a file.

A run that is resumed from it gets the same hash as a run without interruption. The first line of a
file names its format and version. The second line is the SHA-256 of the rest.

`orchard.server.snapshots` and `orchard.launch` write and read them, and `orchard.saved_run` makes
them of a run in local mode.

Theory of operation. A run writes its files into a folder of its own; the file RUN there holds its
id. A snapshot is for going on after a crash, so only the KEPT last written stay. A keyframe is for
a fork, so all of them stay until the run begins again. The two differ only in their names: a moment
that is to be both is written twice.

    a new file                          | what is removed
    ------------------------------------+----------------------------------------------------------
    of another run than the folder's    | all snapshots and keyframes; RUN gets the new id
    a snapshot or keyframe of tick 0    | all others of its kind
    a later snapshot                    | all snapshots but the KEPT last written, with the new one
    a later keyframe                    | nothing

Which files go is decided by the time at which they were written. A reader goes by the ticks of
their names: it takes the file with the highest one that is whole, of the right run and version,
possible, and of that tick. Of each other one it tells why not, and goes on to the next lower tick.
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

VERSION = 10
HEAD = b"orchard snapshot %d\n"
# bytes. The snapshot of the largest orchard has a hundredth of that.
LARGEST = 1 << 24
# Snapshots that stay: those that were written last.
KEPT = 2
# A file's name is the STEM with its tick, and the suffix of its kind. Ticks may have more digits.
STEM = "tick-%09d"
SNAPSHOT = ".snapshot"
KEYFRAME = ".keyframe"
# The file with the id of the run that writes its snapshots into the folder.
RUN = "run"
# The names of its snapshots and keyframes, as a regular expression.
NAMES = rf"tick-\d{{9,}}(?:{re.escape(SNAPSHOT)}|{re.escape(KEYFRAME)})"


class SnapshotError(Exception):
    """A snapshot cannot be used. The text names the reason."""


class Snapshot(msgspec.Struct):
    """The state of a run between two ticks."""

    # The run's id.
    run: Annotated[str, Meta(pattern="^[A-Za-z0-9_-]{0,64}$")]
    scenario: dict[str, Any]
    # Attribute of World -> a number, or an array's bytes.
    world: dict[str, Any]
    # The run's hash so far.
    digest: Annotated[bytes, Meta(min_length=32, max_length=32)]
    # Name -> the agent's memory as msgpack.
    memories: dict[str, bytes | None]
    # (tick, sender -> its letters) of the last two ticks.
    letters: list[tuple[int, dict[str, Written]]]
    # The run's figures so far.
    figures: dict[str, Any]
    # The agents that a session owned.
    owned: list[str] = []
    # Agent -> the first tick for which lockstep has not waited for it. From there on the hash is
    # another.
    lost: dict[str, int] = {}
    # The agents that were left to clients elsewhere.
    elsewhere: list[str] = []

    @property
    def tick(self) -> int:
        """The tick after the last step."""
        return int(self.world["tick"])


# -- files


def as_file(snapshot: Snapshot) -> tuple[str, bytes]:
    """Return the name and the content of a snapshot's file.

    A keyframe has the same content, and a name with KEYFRAME in place of SNAPSHOT.
    """
    payload = pack(snapshot)
    head = HEAD % VERSION + hashlib.sha256(payload).hexdigest().encode() + b"\n"
    return STEM % snapshot.tick + SNAPSHOT, head + payload


def store(name: str, content: bytes, folder: Path, run: str = "") -> Path:
    """Write a file into a run's folder, and return its path. Raises OSError.

    `name`: of a snapshot or a keyframe. `content`: as `as_file` returns it. `run`: its id. What the
    file outdates is removed, and what a process has left that was killed while it wrote.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / name
    of_others: list[Path] = []
    if run_of(folder) != run:
        of_others = [old for old in snapshots_in(folder) if old != path]
        write_whole(folder / RUN, run.encode())
    write_whole(path, content)
    outdated = of_others or _outdated(path)
    for old in [*outdated, *half_written(folder, f"{NAMES}|{RUN}")]:
        old.unlink(missing_ok=True)
    return path


def snapshots_in(folder: Path, *suffixes: str) -> list[Path]:
    """Return the snapshots and keyframes of a folder, or those with these suffixes, in any order.

    Files with names that the program does not give are others' and are left out.
    """
    paths = []
    for path in folder.glob("tick-*"):
        is_asked_for = not suffixes or path.suffix in suffixes
        if is_asked_for and re.fullmatch(NAMES, path.name):
            paths.append(path)
    return paths


def _outdated(path: Path) -> list[Path]:
    """Return the files of the same kind that a new one outdates."""
    written = _highest_tick_first(path.parent, path.suffix)
    # Not the highest ticks count, which may be of damaged files, but the last that were written.
    # Of those that were written at one time the order above decides.
    written.sort(key=lambda old: old.lstat().st_mtime_ns, reverse=True)
    # The new one stays, also if the clock was set back.
    others = [old for old in written if old != path]
    if path.stem == STEM % 0:
        return others
    if path.suffix == KEYFRAME:
        return []
    # The new one is one of the KEPT.
    return others[KEPT - 1 :]


def read(path: Path) -> Snapshot:
    """Return the snapshot in a file. Raises SnapshotError, which names the fault."""
    try:
        with regular(path).open("rb") as file:
            data = file.read(LARGEST + 1)
    except OSError as error:
        raise SnapshotError(error.strerror or "cannot be read") from error
    if len(data) > LARGEST:
        raise SnapshotError(f"larger than {LARGEST} bytes: not a snapshot")
    head = re.match(rb"orchard snapshot (\d{1,9})\n([0-9a-f]{64})\n", data)
    if not head:
        raise SnapshotError("not a snapshot of an orchard")
    version = int(head[1])
    if version != VERSION:
        raise SnapshotError(f"version {version}; this program reads version {VERSION}")
    payload = data[head.end() :]
    if hashlib.sha256(payload).hexdigest().encode() != head[2]:
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
    """Return the usable snapshot of a folder with the highest tick. Raises SnapshotError if there
    is none.

    `refused`: gets the faults of those with higher ticks. `run`: the id of the run to which it must
    belong; '' for that of the folder. `examine`: raises SnapshotError for impossible content.
    `until`: take the one with the highest tick up to this one, which may be a keyframe.
    """
    expected = run or run_of(folder)
    if until is None:
        paths = _highest_tick_first(folder, SNAPSHOT)
    else:
        both_kinds = _highest_tick_first(folder, KEYFRAME, SNAPSHOT)
        paths = [path for path in both_kinds if _tick_of(path) <= until]
    for path in paths:
        try:
            snapshot = read(path)
            if snapshot.run != expected:
                wanted = expected or f"a file {RUN} there with its id"
                raise SnapshotError(f"of another run, {snapshot.run}; expected {wanted}")
            examine(snapshot)
            if snapshot.tick != _tick_of(path):
                raise SnapshotError(f"of tick {snapshot.tick}, which its name should say")
        except SnapshotError as error:
            refused.append(f"{path}: {error}")
        else:
            return snapshot
    raise SnapshotError("; ".join([*refused, f"{folder}: no usable snapshot"]))


def ticks_of(folder: Path) -> list[int]:
    """Return the ticks of which a folder has a keyframe or a snapshot, which may be damaged."""
    return sorted({_tick_of(path) for path in snapshots_in(folder)})


def _tick_of(path: Path) -> int:
    """Return the tick that the name of a snapshot says."""
    return int(path.stem.removeprefix("tick-"))


def _highest_tick_first(folder: Path, *suffixes: str) -> list[Path]:
    """Return the files of a folder with these suffixes, those with the highest tick first. Of one
    tick the snapshot comes before the keyframe.
    """

    def rank(path: Path) -> tuple[int, str]:
        return _tick_of(path), path.suffix

    return sorted(snapshots_in(folder, *suffixes), key=rank, reverse=True)
