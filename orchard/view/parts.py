"""What the parts of a recording hold, and what they lack.

All carry the run's id, so that Rerun shows them as one recording when they are opened together. What counts is what can be read: the
end of a file whose writer was killed may be torn off.
"""

import subprocess
import sys
import warnings
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

from rerun.chunk import Chunk, RrdReader

from orchard.config import TIME_STEP
from orchard.parts import part, parts_of

POSES = "/tf"  # the entity that tells how far a part reaches
MISSING = "recording/missing"  # and the one that tells what is not in it
SINCE, LEFT_OUT = "since", "left_out"  # its values: the last tick before a gap, told where the gap ends; how many pictures


class Part(NamedTuple):
    """What can be read of one file."""

    run: str  # the run's id
    last: int  # the last tick that is in it; 0 for none
    gaps: tuple[tuple[int, int], ...]  # (last tick before, first tick after)
    left_out: int  # pictures that it lacks besides, because its writer was too slow


def next_part(path: Path, run: str) -> tuple[Path, int]:
    """Where a run's recording goes on, and the last tick that is in it: (path, 0) for a new one.

    Torn parts are mended and packed. One in which no picture can be read is written anew, as one of another run is.
    """
    last = 0
    for number in count(1):
        found = read_part(part(path, number))
        if found is None or found.run != run or not found.last:
            return part(path, number), last
        last = found.last
    raise AssertionError("unreachable")


def read_part(path: Path) -> Part | None:
    """What is in a file, which is mended first if a kill has torn it; None where nothing can be read."""
    if not path.exists():
        return None
    try:
        return _read(path)
    except (RuntimeError, Warning):  # torn, or cut off where a message ended
        optimize(path)
    try:
        return _read(path)
    except (RuntimeError, Warning, LookupError):
        return None


def optimize(path: str | Path) -> None:
    """Pack a recording, in place: half its size, and it opens faster. Mends one that a kill has torn."""
    path = Path(path)
    packed = path.with_suffix(".packed.rrd")
    command = [sys.executable, "-m", "rerun", "rrd", "optimize", "--continue-on-error", str(path), "-o", str(packed)]
    subprocess.run(command, check=True, capture_output=True, timeout=600)
    packed.replace(path)


def missing(path: Path, ticks: int) -> dict[str, Any]:
    """What the summary tells of the recording of a run of so many ticks: its parts, its gaps (s, simulated), what was left out."""
    parts = {file: found for file in parts_of(path) if (found := read_part(file)) is not None}
    last = max((found.last for found in parts.values()), default=0)
    gaps = [gap for found in parts.values() for gap in found.gaps] + ([(last, ticks)] if last < ticks else [])
    return {
        "recording_parts": [file.name for file in parts],
        "recording_gaps": [[_seconds(since), _seconds(until)] for since, until in gaps],
        "messages_dropped": sum(found.left_out for found in parts.values()),
    }


def _read(path: Path) -> Part:
    """Raises RuntimeError or a Warning where not all of a file can be read, LookupError where no recording is in it."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        reader = RrdReader(path)
        last, left_out = 0, 0
        gaps: list[tuple[int, int]] = []
        for chunk in reader.stream().filter(content=[f"+ {POSES}", f"+ /{MISSING}"]):
            if chunk.entity_path == POSES:
                last = max(last, *_ticks(chunk))
            else:
                gaps += _values(chunk, SINCE)
                left_out += sum(value for value, _ in _values(chunk, LEFT_OUT))
        return Part(reader.recordings()[0].recording_id, last, tuple(sorted(gaps)), left_out)


def _ticks(chunk: Chunk) -> list[int]:
    nanoseconds = chunk.to_record_batch()["sim_time"].cast("int64").to_pylist()
    return [round(time / 1e9 / TIME_STEP) for time in nanoseconds]


def _values(chunk: Chunk, name: str) -> Iterator[tuple[int, int]]:
    """(value, tick) of one component of a chunk; none if it is not in there."""
    batch = chunk.to_record_batch()
    if name in batch.schema.names:
        for value, tick in zip(batch[name].to_pylist(), _ticks(chunk), strict=True):
            if value:
                yield int(value[0]), tick


def _seconds(tick: int) -> float:
    return round(tick * TIME_STEP, 1)
