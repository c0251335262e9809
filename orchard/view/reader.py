"""Reads what the parts of a recording contain and lack, the end of a file if its writer was killed; and how its bodies drove."""

import logging
import math
import os
import re
import subprocess
import warnings
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
from rerun.chunk import Chunk, RrdReader

from orchard.contract.events import Velocities
from orchard.field.kinds import LASER_RANGE, Laser
from orchard.field.layout import lay_out
from orchard.field.scenario import TIME_STEP, Scenario, check
from orchard.view.files import QUIET, packing, part, parts_of, viewer_program
from orchard.view.palette import Colour

POSES = "/tf"  # entity with a value at the last tick of a part
MISSING = "recording/missing"  # entity that records what a part lacks
SCENARIO = "recording/scenario"  # entity: the scenario as JSON
VELOCITIES = "recording/velocities"  # entity: a body's number, and its `Velocities`, whenever these change
SCANS = "scans/"
STILL: Velocities = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
UNREADABLE = (RuntimeError, ValueError, Warning)  # from Rerun's reader: the file is torn, empty, or without an end
PACK_SECONDS = 600  # that packing may take
WORDS = "StateConfiguration:values"
COLOURS = "StateConfiguration:colors"
log = logging.getLogger("orchard")
SINCE, LEFT_OUT = "since", "left_out"  # components of MISSING: last tick before a gap, at its end; frames left out


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
    said: Mapping[str, dict[str, Colour]]  # entity -> its state texts in the earlier parts, and their colours


def before(path: Path, run: str) -> Before:
    """Return where to continue the recording of a run. A part without a readable frame, or of another run, is overwritten."""
    known, number = Before(path, 0, {}), 1
    while (found := read_part(known.file)) is not None and found.run == run and found.last:
        number += 1
        known = Before(part(path, number), found.last, {**known.said, **found.said})
    return known


def read_part(path: Path) -> RecordingPart | None:
    """Return the content of a file, or None if nothing can be read. A file that a kill has torn is repaired first."""
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
    """Pack a recording in place, to half its size, or repair it. Raises OSError if that fails; then it stays as it is."""
    packed = packing(Path(path))
    command = [viewer_program(), "rrd", "optimize", "--continue-on-error", str(path), "-o", str(packed)]
    try:
        subprocess.run(command, check=True, capture_output=True, timeout=PACK_SECONDS, env=os.environ | QUIET)
        packed.replace(path)
    except subprocess.SubprocessError as error:
        raise OSError(f"{path}: it stays as it was recorded, neither packed nor repaired: {_why(error)}") from error
    finally:
        packed.unlink(missing_ok=True)


def _why(error: subprocess.SubprocessError) -> str:
    if not isinstance(error, subprocess.CalledProcessError):
        return f"Rerun's program takes longer than {PACK_SECONDS} s"
    words = error.stderr.decode(errors="backslashreplace").strip()
    if numbers := re.findall(r"\(os error (\d+)\)", words):
        return os.strerror(int(numbers[-1]))
    last = words.rpartition("\n")[2].removeprefix("Error: ")
    return f"Rerun's program has ended with exit code {error.returncode}" + (f": {last}" if last else "")


def missing(path: Path, ticks: int) -> dict[str, Any]:
    """Return the summary's entries for the recording of so many ticks: parts, gaps (s), frames left out."""
    parts = {file: found for file in parts_of(path) if (found := read_part(file)) is not None}
    last = max((found.last for found in parts.values()), default=0)
    gaps = [gap for found in parts.values() for gap in found.gaps] + ([(last, ticks)] if last < ticks else [])
    return {
        "recording_parts": [file.name for file in parts],
        "recording_gaps": [[round(since * TIME_STEP, 1), round(until * TIME_STEP, 1)] for since, until in gaps],
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
                last = max(last, *_ticks_of(chunk))
            elif chunk.is_static:
                said.update((chunk.entity_path, words) for words in _words(chunk))
            elif chunk.entity_path == f"/{MISSING}":
                gaps += _values(chunk, SINCE)
                left_out += sum(value for value, _ in _values(chunk, LEFT_OUT))
        return RecordingPart(reader.recordings()[0].recording_id, last, tuple(sorted(gaps)), left_out, said)


def _ticks_of(chunk: Chunk) -> list[int]:
    nanoseconds = chunk.to_record_batch()["sim_time"].cast("int64").to_pylist()
    return [round(time / 1e9 / TIME_STEP) for time in nanoseconds]


def _column(chunk: Chunk, name: str) -> list[Any]:
    """The values of a component; none if the chunk has no such component."""
    batch = chunk.to_record_batch()
    return list(batch[name].to_pylist()) if name in batch.schema.names else []


def _values(chunk: Chunk, name: str) -> list[tuple[int, int]]:
    return [(int(value[0]), tick) for value, tick in zip(_column(chunk, name), _ticks_of(chunk), strict=False) if value]


def _words(chunk: Chunk) -> list[dict[str, Colour]]:
    rows = zip(_column(chunk, WORDS), _column(chunk, COLOURS), strict=True)
    return sorted((dict(zip(words, map(_colour, colours), strict=True)) for words, colours in rows if words), key=len)


def _colour(rgba: int) -> Colour:
    return rgba >> 24 & 255, rgba >> 16 & 255, rgba >> 8 & 255


# -- how its bodies drove: poses and velocities, tick by tick, and what lasers hit


class RecordingError(Exception):
    """A recording cannot be read, or lacks what is needed. The text names the file and the reason."""


State = tuple[float, float, float, float]  # x, y (m), z and w of the quaternion, in the frame `map`


@dataclass
class Drives:
    """What a recording tells of its bodies. The maps have entries only for the ticks at which something changes."""

    scenario: Scenario
    names: list[str]  #: of all bodies, in the order of the layout
    first: int = 0  #: the first tick
    last: int = 0  #: the newest tick
    gaps: list[tuple[int, int]] = field(default_factory=list)  #: (last tick before, first tick after) of what is not recorded
    left_out: int = 0  #: ticks that are not recorded besides, because the logger was too slow
    is_torn: bool = False  #: whether the end of a part is missing
    poses: dict[int, dict[str, State]] = field(default_factory=dict)  #: tick -> body -> its pose
    velocities: dict[int, dict[str, Velocities]] = field(default_factory=dict)  #: tick of the step's end -> body -> done and wanted
    points: dict[int, dict[str, np.ndarray]] = field(default_factory=dict)  #: tick -> body -> (m, 2) m, what its laser hit, in its frame

    def ticks(self) -> Iterator[tuple[int, Mapping[str, State], Mapping[str, Velocities]]]:
        """Yield for each recorded tick its number, and pose and velocities of every body that was seen so far."""
        poses, velocities = dict[str, State](), dict[str, Velocities]()
        for tick in range(self.first, self.last + 1):
            poses |= self.poses.get(tick, {})
            velocities |= self.velocities.get(tick, {})
            if not any(since < tick < until for since, until in self.gaps):
                yield tick, poses, velocities


def read_drives(recording: Path, with_scans: bool = False) -> Drives:
    """Return what all parts of a recording tell of its bodies; torn parts are repaired first. Raises RecordingError."""
    parts = parts_of(recording)
    if not parts:
        raise RecordingError(f"{recording}: no such recording")
    drives: Drives | None = None
    for file in parts:
        if (known := read_part(file)) is None:
            raise RecordingError(f"{file}: it cannot be read: it is no recording, or too much of it is missing")
        chunks = _chunks_of(file, with_scans)
        if drives is None:
            scenario = _scenario_in(file, chunks)
            drives = Drives(scenario, list(lay_out(scenario.without_code).names))
        drives.gaps += known.gaps
        drives.left_out += known.left_out
        drives.is_torn |= known.is_torn
        for chunk in chunks:
            _take(drives, chunk)
    if drives is None or not drives.poses:
        raise RecordingError(f"{recording}: it has no pose of any body: the run ended within its first second, or too much is missing")
    drives.first, drives.last = min(drives.poses), max(drives.poses)
    return drives


def _chunks_of(file: Path, with_scans: bool) -> list[Chunk]:
    wanted = [POSES, f"/{VELOCITIES}", f"/{SCENARIO}", *([f"/{SCANS}**"] if with_scans else [])]
    return list(RrdReader(file).stream().filter(content=[f"+ {entity}" for entity in wanted]))


def _scenario_in(file: Path, chunks: list[Chunk]) -> Scenario:
    for chunk in chunks:
        if chunk.entity_path == f"/{SCENARIO}":
            (text,) = _column(chunk, "TextDocument:text")[0]
            return check(msgspec.json.decode(text), f"the scenario in {file}")
    raise RecordingError(f"{file}: it has no scenario and no velocities: an older version recorded it")


def _take(drives: Drives, chunk: Chunk) -> None:
    path = chunk.entity_path
    if path == POSES:
        _take_poses(drives, chunk)
    elif path == f"/{VELOCITIES}":
        for tick, body, velocities in zip(_ticks_of(chunk), _column(chunk, "body"), _column(chunk, "velocities"), strict=True):
            drives.velocities.setdefault(tick, {})[drives.names[body[0]]] = tuple(velocities)
    elif path.startswith(f"/{SCANS}") and not chunk.is_static:
        for tick, points in zip(_ticks_of(chunk), _column(chunk, "Points3D:positions"), strict=True):
            places = np.array(points or [], dtype=np.float64).reshape(-1, 3)
            drives.points.setdefault(tick, {})[path.removeprefix(f"/{SCANS}")] = places[:, :2]


def _take_poses(drives: Drives, chunk: Chunk) -> None:
    columns = (_column(chunk, f"Transform3D:{name}") for name in ("child_frame", "translation", "quaternion"))
    for tick, frames, places, turns in zip(_ticks_of(chunk), *columns, strict=True):
        (x, y, _), (_, _, z, w) = places[0], turns[0]
        drives.poses.setdefault(tick, {})[frames[0]] = x, y, z, w


def ranges_of(points: np.ndarray, laser: Laser, every: int) -> np.ndarray:
    """Return the ranges of every `every`-th beam, m, float32, +inf without a return, from the points that it hit, (m, 2) m."""
    beams = math.ceil(laser.beams / every)
    ranges = np.full(beams, np.inf, dtype=np.float32)
    x, y = points[:, 0] - laser.ahead, points[:, 1]
    numbers = np.clip(np.round((np.arctan2(y, x) - laser.first) / (laser.increment * every)), 0, beams - 1).astype(int)
    np.minimum.at(ranges, numbers, np.minimum(np.hypot(x, y), LASER_RANGE).astype(np.float32))
    return ranges
