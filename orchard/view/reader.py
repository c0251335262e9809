"""What the parts of a recording hold, and what they lack.

All carry the run's id, so that Rerun shows them as one recording when they are opened together. What counts is what can be read: the
end of a file whose writer was killed may be torn off.
"""

import subprocess
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from rerun.chunk import Chunk, RrdReader

from orchard.field.scenario import TIME_STEP
from orchard.view.files import part, parts_of
from orchard.view.program import viewer_program

POSES = "/tf"  # the entity that tells how far a part reaches
MISSING = "recording/missing"  # and the one that tells what is not in it
UNREADABLE = (RuntimeError, ValueError, Warning)  # what Rerun's reader raises: torn, no recording in it, no end to it
WORDS = "StateConfiguration:values"
SINCE, LEFT_OUT = "since", "left_out"  # its values: the last tick before a gap, told where the gap ends; how many pictures


class RecordingPart(NamedTuple):
    """What can be read of one file."""

    run: str  # the run's id
    last: int  # the last tick that is in it; 0 for none
    gaps: tuple[tuple[int, int], ...]  # (last tick before, first tick after)
    left_out: int  # pictures that it lacks besides, because its writer was too slow
    said: dict[str, list[str]]  # entity -> all that it is said to do


class Before(NamedTuple):
    """What a recording goes on from."""

    file: Path  # where to write
    last: int  # the last tick that is in the parts before; 0 if there are none
    said: Mapping[str, list[str]]


def before(path: Path, run: str) -> Before:
    """What there is of a run's recording.

    Torn parts are mended and packed. One in which no picture can be read is written anew, as one of another run is.
    """
    known, number = Before(path, 0, {}), 1
    while (found := read_part(known.file)) is not None and found.run == run and found.last:
        number += 1
        known = Before(part(path, number), found.last, {**known.said, **found.said})
    return known


def read_part(path: Path) -> RecordingPart | None:
    """What is in a file, which is mended first if a kill has torn it; None where nothing can be read."""
    if not path.exists():
        return None
    try:
        return _read(path)
    except UNREADABLE:  # torn, or cut off where a message ended
        optimize(path)
    try:
        return _read(path)
    except UNREADABLE:
        return None


def optimize(path: str | Path) -> None:
    """Pack a recording, in place: half its size, and it opens faster. Mends one that a kill has torn."""
    path = Path(path)
    packed = path.with_suffix(".packed.rrd")
    command = [viewer_program(), "rrd", "optimize", "--continue-on-error", str(path), "-o", str(packed)]
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


def _read(path: Path) -> RecordingPart:
    """Raises one of UNREADABLE where not all of a file can be read."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        reader = RrdReader(path)
        last, left_out = 0, 0
        gaps: list[tuple[int, int]] = []
        said: dict[str, list[str]] = {}
        for chunk in reader.stream().filter(content=[f"+ {POSES}", f"+ /{MISSING}", "+ /world/**"]):
            if chunk.entity_path == POSES:
                last = max(last, *_ticks(chunk))
            elif chunk.is_static:
                said.update((chunk.entity_path, words) for words in _words(chunk))
            elif chunk.entity_path == f"/{MISSING}":
                gaps += _values(chunk, SINCE)
                left_out += sum(value for value, _ in _values(chunk, LEFT_OUT))
        return RecordingPart(reader.recordings()[0].recording_id, last, tuple(sorted(gaps)), left_out, said)


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


def _words(chunk: Chunk) -> list[list[str]]:
    """The lists of words in a chunk, the longest at the end."""
    batch = chunk.to_record_batch()
    return sorted(filter(None, batch[WORDS].to_pylist()), key=len) if WORDS in batch.schema.names else []


def _seconds(tick: int) -> float:
    return round(tick * TIME_STEP, 1)
