"""How the bodies of a recorded run drove: poses and velocities, tick by tick, and what
lasers hit.

`orchard export` reads them here and writes them into a bag (`export.py`). A recording has one file,
or several, which are called its parts. A part is a sequence of chunks: tables of Rerun, each of one
entity, with a row per tick.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
import numpy as np
from rerun.chunk import Chunk, RrdReader

from orchard.contract.events import Velocities
from orchard.field.kinds import LASER_RANGE, Laser
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario, check
from orchard.view.files import parts_of
from orchard.view.reader import POSES, SCENARIO, VELOCITIES, column, read_part, ticks_of

SCANS = "scans/"
# Of a body that has not driven: forward, left and turn as done, and the same three as wanted.
STILL: Velocities = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class RecordingError(Exception):
    """A recording cannot be read, or lacks what is needed.

    The text names the file and the reason.
    """


# x and y (m), z and w of the quaternion, in the frame `map`.
State = tuple[float, float, float, float]


@dataclass
class Drives:
    """What a recording tells of its bodies.

    The maps have entries only for the ticks at which something changes.
    """

    scenario: Scenario
    names: list[str]  #: of all bodies, in the order of the layout
    first: int = 0  #: the first tick
    last: int = 0  #: the newest tick
    #: times without a record: (last tick before the gap, first tick after it)
    gaps: list[tuple[int, int]] = field(default_factory=list)
    left_out: int = 0  #: ticks outside the gaps that the logger was too slow to record
    is_torn: bool = False  #: whether the end of a part is missing
    poses: dict[int, dict[str, State]] = field(default_factory=dict)  #: tick -> body -> its pose
    #: tick at the end of a step -> body -> its velocities in the step, done and wanted
    velocities: dict[int, dict[str, Velocities]] = field(default_factory=dict)
    #: tick -> body -> points that its laser hit: m rows of x and y (metres), in the body's frame
    points: dict[int, dict[str, np.ndarray]] = field(default_factory=dict)

    def ticks(self) -> Iterator[tuple[int, Mapping[str, State], Mapping[str, Velocities]]]:
        """Yield for each recorded tick its number, and pose and velocities of every body that was
        seen so far.
        """
        poses = dict[str, State]()
        velocities = dict[str, Velocities]()
        for tick in range(self.first, self.last + 1):
            poses |= self.poses.get(tick, {})
            velocities |= self.velocities.get(tick, {})
            is_recorded = not any(before < tick < after for before, after in self.gaps)
            if is_recorded:
                yield tick, poses, velocities


def read_drives(recording: Path, with_scans: bool = False) -> Drives:
    """Return what all parts of a recording tell of its bodies; torn parts are repaired first.

    Raises RecordingError.
    """
    parts = parts_of(recording)
    if not parts:
        raise RecordingError(f"{recording}: no such recording")
    drives: Drives | None = None
    for file in parts:
        part = read_part(file)
        if part is None:
            raise RecordingError(
                f"{file}: it cannot be read: it is no recording, or too much of it is missing"
            )
        chunks = _chunks_of(file, with_scans)
        if drives is None:
            scenario = _scenario_in(file, chunks)
            # The names need none of the user's own classes, which may not be here.
            drives = Drives(scenario, list(lay_out(scenario.without_code).names))
        drives.gaps += part.gaps
        drives.left_out += part.left_out
        drives.is_torn |= part.is_torn
        for chunk in chunks:
            _take(drives, chunk)
    if drives is None or not drives.poses:
        raise RecordingError(
            f"{recording}: it has no pose of any body: the run ended within its first second, or"
            " too much is missing"
        )
    drives.first = min(drives.poses)
    drives.last = max(drives.poses)
    return drives


def _chunks_of(file: Path, with_scans: bool) -> list[Chunk]:
    """Return the chunks of a file that tell of bodies and of the scenario."""
    entities = [POSES, f"/{VELOCITIES}", f"/{SCENARIO}"]
    if with_scans:
        entities.append(f"/{SCANS}**")
    # In Rerun's filters `+` takes an entity in, and `**` stands for all entities below a path.
    return list(RrdReader(file).stream().filter(content=[f"+ {entity}" for entity in entities]))


def _scenario_in(file: Path, chunks: list[Chunk]) -> Scenario:
    """Return the scenario of a recording. Raises RecordingError if it has none."""
    for chunk in chunks:
        if chunk.entity_path == f"/{SCENARIO}":
            (text,) = column(chunk, "TextDocument:text")[0]
            return check(msgspec.json.decode(text), f"the scenario in {file}")
    raise RecordingError(
        f"{file}: it has no scenario and no velocities: an older version recorded it"
    )


def _take(drives: Drives, chunk: Chunk) -> None:
    """Add to the drives what a chunk of a recording tells of them."""
    path = chunk.entity_path
    if path == POSES:
        _take_poses(drives, chunk)
    elif path == f"/{VELOCITIES}":
        _take_velocities(drives, chunk)
    elif path.startswith(f"/{SCANS}") and not chunk.is_static:
        _take_scans(drives, chunk, body=path.removeprefix(f"/{SCANS}"))


def _take_poses(drives: Drives, chunk: Chunk) -> None:
    """Add poses: each row has a list of one frame, one translation and one quaternion."""
    rows = zip(
        ticks_of(chunk),
        column(chunk, "Transform3D:child_frame"),
        column(chunk, "Transform3D:translation"),
        column(chunk, "Transform3D:quaternion"),
        strict=True,
    )
    for tick, frames, translations, quaternions in rows:
        x, y, _ = translations[0]
        _, _, z, w = quaternions[0]
        drives.poses.setdefault(tick, {})[frames[0]] = (x, y, z, w)


def _take_velocities(drives: Drives, chunk: Chunk) -> None:
    """Add velocities: each row has a list of one body, by its place in the layout."""
    rows = zip(ticks_of(chunk), column(chunk, "body"), column(chunk, "velocities"), strict=True)
    for tick, bodies, velocities in rows:
        name = drives.names[bodies[0]]
        drives.velocities.setdefault(tick, {})[name] = tuple(velocities)


def _take_scans(drives: Drives, chunk: Chunk, body: str) -> None:
    """Add what the laser of a body hit. A row without points is a scan that hit nothing."""
    rows = zip(ticks_of(chunk), column(chunk, "Points3D:positions"), strict=True)
    for tick, points in rows:
        hits = np.array(points or [], dtype=np.float64).reshape(-1, 3)
        drives.points.setdefault(tick, {})[body] = hits[:, :2]


def ranges_of(points: np.ndarray, laser: Laser, every: int) -> np.ndarray:
    """Return the range of each recorded beam of a laser, from the points that its beams hit.

    `points`: a row of x and y (metres) for each point, in the frame of the body. `every`: one of so
    many beams is recorded. Ranges: metres, float32, +inf for a beam that hit nothing.
    """
    beam_count = math.ceil(laser.beams / every)
    ranges = np.full(beam_count, np.inf, dtype=np.float32)
    # Points are seen from the laser here, which is ahead of the body's centre.
    x = points[:, 0] - laser.ahead
    y = points[:, 1]
    angles = np.arctan2(y, x) - laser.first
    nearest_beams = np.round(angles / (laser.increment * every))
    beams = np.clip(nearest_beams, 0, beam_count - 1).astype(int)
    distances = np.minimum(np.hypot(x, y), LASER_RANGE).astype(np.float32)
    # Of points at the same beam the nearest counts.
    np.minimum.at(ranges, beams, distances)
    return ranges
