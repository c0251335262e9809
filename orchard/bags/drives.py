"""How the bodies of a recorded run drove: poses and velocities, tick by tick, and what
lasers hit.
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
STILL: Velocities = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class RecordingError(Exception):
    """A recording cannot be read, or lacks what is needed.

    The text names the file and the reason.
    """


State = tuple[float, float, float, float]  # x, y (m), z and w of the quaternion, in the frame `map`


@dataclass
class Drives:
    """What a recording tells of its bodies.

    The maps have entries only for the ticks at which something changes.
    """

    scenario: Scenario
    names: list[str]  #: of all bodies, in the order of the layout
    first: int = 0  #: the first tick
    last: int = 0  #: the newest tick
    gaps: list[tuple[int, int]] = field(
        default_factory=list
    )  #: (last tick before, first tick after) of what is not recorded
    left_out: int = 0  #: ticks that are not recorded besides, because the logger was too slow
    is_torn: bool = False  #: whether the end of a part is missing
    poses: dict[int, dict[str, State]] = field(default_factory=dict)  #: tick -> body -> its pose
    velocities: dict[int, dict[str, Velocities]] = field(
        default_factory=dict
    )  #: tick of the step's end -> body -> done and wanted
    points: dict[int, dict[str, np.ndarray]] = field(
        default_factory=dict
    )  #: tick -> body -> (m, 2) m, what its laser hit, in its frame

    def ticks(self) -> Iterator[tuple[int, Mapping[str, State], Mapping[str, Velocities]]]:
        """Yield for each recorded tick its number, and pose and velocities of every body that was
        seen so far.
        """
        poses, velocities = dict[str, State](), dict[str, Velocities]()
        for tick in range(self.first, self.last + 1):
            poses |= self.poses.get(tick, {})
            velocities |= self.velocities.get(tick, {})
            if not any(since < tick < until for since, until in self.gaps):
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
        if (known := read_part(file)) is None:
            raise RecordingError(
                f"{file}: it cannot be read: it is no recording, or too much of it is missing"
            )
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
        raise RecordingError(
            f"{recording}: it has no pose of any body: the run ended within its first second, or"
            " too much is missing"
        )
    drives.first, drives.last = min(drives.poses), max(drives.poses)
    return drives


def _chunks_of(file: Path, with_scans: bool) -> list[Chunk]:
    wanted = [POSES, f"/{VELOCITIES}", f"/{SCENARIO}", *([f"/{SCANS}**"] if with_scans else [])]
    return list(RrdReader(file).stream().filter(content=[f"+ {entity}" for entity in wanted]))


def _scenario_in(file: Path, chunks: list[Chunk]) -> Scenario:
    for chunk in chunks:
        if chunk.entity_path == f"/{SCENARIO}":
            (text,) = column(chunk, "TextDocument:text")[0]
            return check(msgspec.json.decode(text), f"the scenario in {file}")
    raise RecordingError(
        f"{file}: it has no scenario and no velocities: an older version recorded it"
    )


def _take(drives: Drives, chunk: Chunk) -> None:
    path = chunk.entity_path
    if path == POSES:
        _take_poses(drives, chunk)
    elif path == f"/{VELOCITIES}":
        for tick, body, velocities in zip(
            ticks_of(chunk), column(chunk, "body"), column(chunk, "velocities"), strict=True
        ):
            drives.velocities.setdefault(tick, {})[drives.names[body[0]]] = tuple(velocities)
    elif path.startswith(f"/{SCANS}") and not chunk.is_static:
        for tick, points in zip(ticks_of(chunk), column(chunk, "Points3D:positions"), strict=True):
            places = np.array(points or [], dtype=np.float64).reshape(-1, 3)
            drives.points.setdefault(tick, {})[path.removeprefix(f"/{SCANS}")] = places[:, :2]


def _take_poses(drives: Drives, chunk: Chunk) -> None:
    columns = (
        column(chunk, f"Transform3D:{name}")
        for name in ("child_frame", "translation", "quaternion")
    )
    for tick, frames, places, turns in zip(ticks_of(chunk), *columns, strict=True):
        (x, y, _), (_, _, z, w) = places[0], turns[0]
        drives.poses.setdefault(tick, {})[frames[0]] = x, y, z, w


def ranges_of(points: np.ndarray, laser: Laser, every: int) -> np.ndarray:
    """Return the ranges of every `every`-th beam, m, float32, +inf without a return, from the
    points that it hit, (m, 2) m.
    """
    beams = math.ceil(laser.beams / every)
    ranges = np.full(beams, np.inf, dtype=np.float32)
    x, y = points[:, 0] - laser.ahead, points[:, 1]
    numbers = np.clip(
        np.round((np.arctan2(y, x) - laser.first) / (laser.increment * every)), 0, beams - 1
    ).astype(int)
    np.minimum.at(ranges, numbers, np.minimum(np.hypot(x, y), LASER_RANGE).astype(np.float32))
    return ranges
