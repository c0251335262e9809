"""Reads what the parts of a recording contain and lack, and the end of a file if its writer was
killed.
"""

import logging
import os
import re
import subprocess
import warnings
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from rerun.chunk import Chunk, RrdReader

from orchard.field.scenario import TIME_STEP
from orchard.view.files import QUIET, packing, part, parts_of, viewer_program
from orchard.view.palette import Colour

POSES = "/tf"  # entity with a value at the last tick of a part
MISSING = "recording/missing"  # entity that records what a part lacks
SCENARIO = "recording/scenario"  # entity: the scenario as JSON
VELOCITIES = (
    "recording/velocities"  # entity: a body's number, and its `Velocities`, whenever these change
)
LETTERS = "recording/letters"  # entity: each message between agents, with its fields as JSON
UNREADABLE = (
    RuntimeError,
    ValueError,
    Warning,
)  # from Rerun's reader: the file is torn, empty, or without an end
PACK_SECONDS = 600  # that packing may take
WORDS = "StateConfiguration:values"
COLOURS = "StateConfiguration:colors"
log = logging.getLogger("orchard")
SINCE, LEFT_OUT = (
    "since",
    "left_out",
)  # components of MISSING: last tick before a gap, at its end; frames left out


class RecordingPart(NamedTuple):
    """The readable content of one file."""

    run: str  # the run's id
    last: int  # last tick in the file; 0: none
    gaps: tuple[tuple[int, int], ...]  # (last tick before, first tick after)
    left_out: int  # frames missing besides, because the writer was too slow
    said: dict[str, dict[str, Colour]]  # entity -> its state texts and their colours
    is_torn: bool = False  # whether its end was missing, and it had to be repaired


class Before(NamedTuple):
    """The point from which a recording continues."""

    file: Path  # where to write
    last: int  # last tick in the earlier parts; 0 if there are none
    said: Mapping[
        str, dict[str, Colour]
    ]  # entity -> its state texts in the earlier parts, and their colours


def before(path: Path, run: str) -> Before:
    """Return where to continue the recording of a run.

    A part without a readable frame, or of another run, is overwritten.
    """
    known, number = Before(path, 0, {}), 1
    while (found := read_part(known.file)) is not None and found.run == run and found.last:
        number += 1
        known = Before(part(path, number), found.last, {**known.said, **found.said})
    return known


def read_part(path: Path) -> RecordingPart | None:
    """Return the content of a file, or None if nothing can be read.

    A file that a kill has torn is repaired first.
    """
    with suppress(*UNREADABLE):
        return _read(path) if path.exists() and path.stat().st_size else None
    try:
        optimize(path)  # it is torn, or cut off where a message ended
    except OSError as error:
        log.warning("%s", error)
    with suppress(*UNREADABLE):
        return _read(path)._replace(is_torn=True)
    return None


def optimize(path: str | Path) -> None:
    """Pack a recording in place, to half its size, or repair it.

    Raises OSError if that fails; then it stays as it is.
    """
    packed = packing(Path(path))
    command = [
        viewer_program(),
        "rrd",
        "optimize",
        "--continue-on-error",
        str(path),
        "-o",
        str(packed),
    ]
    try:
        subprocess.run(
            command, check=True, capture_output=True, timeout=PACK_SECONDS, env=os.environ | QUIET
        )
        packed.replace(path)
    except subprocess.SubprocessError as error:
        raise OSError(
            f"{path}: it stays as it was recorded, neither packed nor repaired: {_why(error)}"
        ) from error
    finally:
        packed.unlink(missing_ok=True)


def _why(error: subprocess.SubprocessError) -> str:
    if not isinstance(error, subprocess.CalledProcessError):
        return f"Rerun's program takes longer than {PACK_SECONDS} s"
    words = error.stderr.decode(errors="backslashreplace").strip()
    if numbers := re.findall(r"\(os error (\d+)\)", words):
        return os.strerror(int(numbers[-1]))
    last = words.rpartition("\n")[2].removeprefix("Error: ")
    return f"Rerun's program has ended with exit code {error.returncode}" + (
        f": {last}" if last else ""
    )


def missing(path: Path, ticks: int) -> dict[str, Any]:
    """Return the summary's entries for the recording of so many ticks: parts, gaps (s), frames left
    out.
    """
    parts = {file: found for file in parts_of(path) if (found := read_part(file)) is not None}
    last = max((found.last for found in parts.values()), default=0)
    gaps = [gap for found in parts.values() for gap in found.gaps] + (
        [(last, ticks)] if last < ticks else []
    )
    return {
        "recording_parts": [file.name for file in parts],
        "recording_gaps": [
            [round(since * TIME_STEP, 1), round(until * TIME_STEP, 1)] for since, until in gaps
        ],
        "messages_dropped": sum(found.left_out for found in parts.values()),
    }


def _read(path: Path) -> RecordingPart:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        reader = RrdReader(path)
        last, left_out = 0, 0
        gaps: list[tuple[int, int]] = []
        said: dict[str, dict[str, Colour]] = {}
        for chunk in reader.stream().filter(content=[f"+ {POSES}", f"+ /{MISSING}", "+ /world/**"]):
            if chunk.entity_path == POSES:
                last = max(last, *ticks_of(chunk))
            elif chunk.is_static:
                said.update((chunk.entity_path, words) for words in _words(chunk))
            elif chunk.entity_path == f"/{MISSING}":
                gaps += _values(chunk, SINCE)
                left_out += sum(value for value, _ in _values(chunk, LEFT_OUT))
        return RecordingPart(
            reader.recordings()[0].recording_id, last, tuple(sorted(gaps)), left_out, said
        )


def ticks_of(chunk: Chunk) -> list[int]:
    """Return the tick of each row of a chunk."""
    nanoseconds = chunk.to_record_batch()["sim_time"].cast("int64").to_pylist()
    return [round(time / 1e9 / TIME_STEP) for time in nanoseconds]


def column(chunk: Chunk, name: str) -> list[Any]:
    """Return the values of a component; none if the chunk has no such component."""
    batch = chunk.to_record_batch()
    return list(batch[name].to_pylist()) if name in batch.schema.names else []


def _values(chunk: Chunk, name: str) -> list[tuple[int, int]]:
    return [
        (int(value[0]), tick)
        for value, tick in zip(column(chunk, name), ticks_of(chunk), strict=False)
        if value
    ]


def _words(chunk: Chunk) -> list[dict[str, Colour]]:
    rows = [row for row in zip(column(chunk, WORDS), column(chunk, COLOURS), strict=True) if row[0]]
    return sorted(
        (
            {
                word: (c >> 24 & 255, c >> 16 & 255, c >> 8 & 255)
                for word, c in zip(*row, strict=True)
            }
            for row in rows
        ),
        key=len,
    )
