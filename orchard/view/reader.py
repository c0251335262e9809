"""Reads what the parts of a recording contain and lack, and the end of a file if its writer was
killed.

A recording has one file, or several, its parts: the first is NAME.rrd, the next one NAME.part2.rrd.
A logger that is started again during a run begins a new part.
"""

import logging
import os
import re
import subprocess
import warnings
from collections.abc import Mapping
from contextlib import suppress
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

from rerun.chunk import Chunk, RrdReader

from orchard.field.scenario import TIME_STEP
from orchard.view.columns import TIMELINE
from orchard.view.files import QUIET, packing, part, parts_of, viewer_program
from orchard.view.palette import Colour

# Entities of a recording. POSES has a value at the last tick of a part.
POSES = "/tf"
# What a part lacks.
MISSING = "recording/missing"
# The scenario as JSON.
SCENARIO = "recording/scenario"
# A body's number, and its `Velocities`, whenever these change.
VELOCITIES = "recording/velocities"
# Each message between agents, with its fields as JSON.
LETTERS = "recording/letters"
# From Rerun's reader: the file is torn, empty, or without an end.
UNREADABLE = (RuntimeError, ValueError, Warning)
# s that packing may take.
PACK_SECONDS = 600
# Components of a body: the texts of its states, and their colours.
WORDS = "StateConfiguration:values"
COLOURS = "StateConfiguration:colors"
# Component of MISSING, at the end of a gap: the last tick before it.
SINCE = "since"
# Component of MISSING: how many frames were left out since the last value of this component.
LEFT_OUT = "left_out"
log = logging.getLogger("orchard")


class RecordingPart(NamedTuple):
    """The readable content of one file.

    `run`: the run's id. `last`: the last tick in the file; 0 for none. `gaps`: for each, the last
    tick before it and the first tick after it. `left_out`: frames missing besides, because the
    writer was too slow. `colours`: entity -> its state texts and their colours. `is_torn`: whether
    its end was missing, and had to be repaired.
    """

    run: str
    last: int
    gaps: tuple[tuple[int, int], ...]
    left_out: int
    colours: dict[str, dict[str, Colour]]
    is_torn: bool = False


class Before(NamedTuple):
    """The point from which a recording continues.

    `file`: where to write. `last`: the last tick in the earlier parts; 0 if there are none.
    `colours`: entity -> its state texts in the earlier parts, and their colours.
    """

    file: Path
    last: int
    colours: Mapping[str, dict[str, Colour]]


def before(path: Path, run: str) -> Before:
    """Return where to continue the recording of a run.

    A part without a readable frame, or of another run, is overwritten.
    """
    earlier = Before(path, 0, {})
    # `number`: of the part after the one that is read.
    for number in count(2):
        current = read_part(earlier.file)
        if current is None or current.run != run or not current.last:
            break
        colours = {**earlier.colours, **current.colours}
        earlier = Before(part(path, number), current.last, colours)
    return earlier


def read_part(path: Path) -> RecordingPart | None:
    """Return the content of a file, or None if nothing can be read.

    A file that a kill has torn is repaired first.
    """
    if not path.exists() or path.stat().st_size == 0:
        return None
    with suppress(*UNREADABLE):
        return _read(path)
    # The file is torn, or cut off where a message ended.
    try:
        optimize(path)
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
    verb = ["rrd", "optimize", "--continue-on-error"]
    command = [viewer_program(), *verb, str(path), "-o", str(packed)]
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
    """Return why Rerun's program has failed, in words."""
    if not isinstance(error, subprocess.CalledProcessError):
        return f"Rerun's program takes longer than {PACK_SECONDS} s"
    words = error.stderr.decode(errors="backslashreplace").strip()
    numbers = re.findall(r"\(os error (\d+)\)", words)
    if numbers:
        return os.strerror(int(numbers[-1]))
    end = f"Rerun's program has ended with exit code {error.returncode}"
    last_line = words.rpartition("\n")[2].removeprefix("Error: ")
    if not last_line:
        return end
    return f"{end}: {last_line}"


def missing(path: Path, ticks: int) -> dict[str, Any]:
    """Return the entries of a run's summary on its recording: parts, gaps (s), frames left out.

    `ticks`: of the run. What the recording lacks at its end is a gap too.
    """
    parts = []
    gaps: list[tuple[int, int]] = []
    last = 0
    messages_dropped = 0
    for file in parts_of(path):
        content = read_part(file)
        if content is None:
            continue
        parts.append(file.name)
        gaps += content.gaps
        last = max(last, content.last)
        messages_dropped += content.left_out
    if last < ticks:
        gaps.append((last, ticks))
    in_seconds = []
    for since, until in gaps:
        in_seconds.append([round(since * TIME_STEP, 1), round(until * TIME_STEP, 1)])
    return {
        "recording_parts": parts,
        "recording_gaps": in_seconds,
        "messages_dropped": messages_dropped,
    }


def _read(path: Path) -> RecordingPart:
    """Return the content of a file. Raises one of UNREADABLE."""
    last = 0
    left_out = 0
    gaps: list[tuple[int, int]] = []
    colours: dict[str, dict[str, Colour]] = {}
    with warnings.catch_warnings():
        # For a torn file Rerun's reader only warns.
        warnings.simplefilter("error")
        reader = RrdReader(path)
        for chunk in reader.stream().filter(content=[f"+ {POSES}", f"+ /{MISSING}", "+ /world/**"]):
            if chunk.entity_path == POSES:
                last = max(last, *ticks_of(chunk))
            elif chunk.is_static:
                colours.update((chunk.entity_path, words) for words in _words(chunk))
            elif chunk.entity_path == f"/{MISSING}":
                gaps += _values(chunk, SINCE)
                left_out += sum(frames for frames, _ in _values(chunk, LEFT_OUT))
        run = reader.recordings()[0].recording_id
    return RecordingPart(run, last, tuple(sorted(gaps)), left_out, colours)


def ticks_of(chunk: Chunk) -> list[int]:
    """Return the tick of each row of a chunk."""
    nanoseconds = chunk.to_record_batch()[TIMELINE].cast("int64").to_pylist()
    return [round(time / 1e9 / TIME_STEP) for time in nanoseconds]


def column(chunk: Chunk, name: str) -> list[Any]:
    """Return the values of a component; none if the chunk has no such component."""
    batch = chunk.to_record_batch()
    if name not in batch.schema.names:
        return []
    return list(batch[name].to_pylist())


def _values(chunk: Chunk, name: str) -> list[tuple[int, int]]:
    """Return the values of a component of one number, each with its tick; none without it."""
    values = []
    # A chunk without the component has ticks, but no values.
    for value, tick in zip(column(chunk, name), ticks_of(chunk), strict=False):
        if value:
            values.append((int(value[0]), tick))
    return values


def _words(chunk: Chunk) -> list[dict[str, Colour]]:
    """Return the state texts of each row, and their colours; the longest row last."""
    rows = []
    for words, colours in zip(column(chunk, WORDS), column(chunk, COLOURS), strict=True):
        if words:
            pairs = zip(words, colours, strict=True)
            rows.append({word: _as_colour(number) for word, number in pairs})
    return sorted(rows, key=len)


def _as_colour(number: int) -> Colour:
    """Return a colour that is written as 0xRRGGBBAA."""
    return number >> 24 & 255, number >> 16 & 255, number >> 8 & 255
