"""Between what agents, physics and the viewer know and the messages on the wire: in both directions, to the last bit."""

from collections.abc import Iterable, Sequence
from functools import lru_cache
from itertools import accumulate
from struct import Struct
from typing import Any

import numpy as np

from orchard.contract.agent import Action, Hitch, Observation
from orchard.contract.events import SELDOM, Frame
from orchard.contract.mail import written_by
from orchard.contract.observations import STATE, Observations, observation_of
from orchard.field.geometry import Twist
from orchard.field.kinds import KINDS, LASER_RANGE, Laser, kind_of
from orchard.field.layout import Layout
from orchard.wire.messages import (
    Angular,
    AskedOf,
    Beams,
    Drive,
    LaserScan,
    Linear,
    Odometry,
    OtherEnd,
    OtherSeen,
    Picture,
    Point,
    PoseMessage,
    Quaternion,
    Report,
    Seen,
    TwistMessage,
    Velocities,
    Velocity,
)
from orchard.wire.types import FARTHEST, MOST_BODIES

_SEVEN = Struct(f"<{STATE}d")  # a body's state
RANGE = 4  # bytes of a float32


def _pose(x: float, y: float, orientation: tuple[float, float]) -> PoseMessage:
    return PoseMessage(Point(float(x), float(y)), Quaternion(float(orientation[0]), float(orientation[1])))


def _twist(twist: Twist) -> TwistMessage:
    return TwistMessage(Linear(float(twist[0]), float(twist[1])), Angular(float(twist[2])))


def odometry_of(run: str, seen: Observation) -> Odometry:
    """What travels of an observation, all but the scan."""
    hitch = seen.hitch and OtherEnd(seen.hitch.name, _pose(seen.hitch.x, seen.hitch.y, seen.hitch.orientation), _twist(seen.hitch.twist))
    pose = _pose(seen.x, seen.y, seen.orientation)
    return Odometry(run, seen.tick, pose, _twist(seen.twist), hitch, float(seen.fill), bool(seen.full))


def _sweep(laser: Laser, scan: np.ndarray | None) -> tuple[float, float, float, float, bytes]:
    last = laser.first + (laser.beams - 1) * laser.increment
    return laser.first, last, laser.increment, LASER_RANGE, np.asarray(scan, dtype="<f4").tobytes()


def scan_of(run: str, seen: Observation, laser: Laser, rear_laser: Laser) -> LaserScan:
    """What travels of an observation's scan, and of its bin's."""
    rear = None if seen.hitch is None or seen.hitch.scan is None else Beams(*_sweep(rear_laser, seen.hitch.scan))
    return LaserScan(run, seen.tick, *_sweep(laser, seen.scan), rear)


def seen_of(run: str, seen: Observations, bodies: Sequence[int], asked: list[AskedOf]) -> Seen:
    """What travels to the holder of these bodies, given by number, whose agents hear what was asked."""
    names = [seen.names[body] for body in bodies]
    states = b"".join([seen.states[body].tobytes() for body in bodies])
    ranges = b"".join([seen.scans[body].tobytes() for body in bodies])
    hitches = {name: _other_seen(seen.hitches[name]) for name in names if name in seen.hitches}
    fills = {name: seen.fills[name] for name in names if name in seen.fills}
    full = [name for name in fills if name in seen.full]
    return Seen(run, seen.tick, names, states, ranges, hitches, fills, full, asked)


def _other_seen(hitch: Hitch) -> OtherSeen:
    ranges = None if hitch.scan is None else hitch.scan.tobytes()
    return OtherSeen(hitch.name, (hitch.x, hitch.y, *hitch.orientation, *hitch.twist), ranges)


def observations_of(seen: Seen) -> dict[str, Observation]:
    """Name -> what was to be seen of that body, to the last bit. Raises ValueError for what does not fit, or is no number."""
    states, rear = _states_of(seen.states), {name: other.ranges for name, other in seen.hitches.items() if other.ranges is not None}
    if len(states) != len(seen.names):
        raise ValueError(f"states do not fit {len(seen.names)} names")
    fitting = [_fitting(seen.ranges, seen.names), *[_fitting(sweep, ["bin"]) for sweep in rear.values()]]
    sweeps = _sweeps_of([*seen.names, *["bin"] * len(rear)], fitting)
    behind = dict(zip(rear, sweeps[len(states) :], strict=True))
    hitches = {name: _hitch_seen(other, behind.get(name)) for name, other in seen.hitches.items()}
    return {
        name: observation_of(name, seen.tick, state, scan, hitches.get(name), seen.fills.get(name, 0.0), name in seen.full)
        for name, state, scan in zip(seen.names, states, sweeps, strict=False)
    }


def _states_of(states: bytes) -> list[tuple[float, ...]]:
    """Seven numbers a body. Raises ValueError for what is no number, or no place."""
    if len(states) % _SEVEN.size:
        raise ValueError(f"states: {len(states)} bytes are no multiple of {_SEVEN.size}")
    if not np.abs(np.frombuffer(states, "<f8")).max(initial=0.0) <= FARTHEST:
        raise ValueError("states: not a number, or out of bounds")
    return [*_SEVEN.iter_unpack(states)]


@lru_cache(maxsize=MOST_BODIES)
def _beams_of(name: str) -> int:
    kind = KINDS.get(kind_of(name))
    if kind is None:
        raise ValueError(f"{name}: there is no such kind")
    return kind.laser.beams


def _hitch_seen(other: OtherSeen, scan: np.ndarray | None) -> Hitch:
    x, y, z, w, vx, vy, turn = other.state
    return Hitch(other.name, x, y, (z, w), Twist(vx, vy, turn), scan)


def _fitting(ranges: bytes, names: Sequence[str]) -> bytes:
    """The ranges of these bodies. Raises ValueError unless there is one for each beam."""
    beams = sum(map(_beams_of, names))
    if len(ranges) != RANGE * beams:
        raise ValueError(f"ranges do not fit: {len(ranges)} bytes, wanted are {RANGE} for each of {beams} beams")
    return ranges


def _sweeps_of(names: Sequence[str], ranges: Iterable[bytes]) -> list[np.ndarray]:
    """Each body's ranges, of fitting ones one after another. Raises ValueError for what no laser can have measured."""
    measured = np.frombuffer(b"".join(ranges), "<f4")
    if not measured.min(initial=0.0) >= 0.0:
        raise ValueError("ranges: not a number, or below 0")
    return [measured[part] for part in _parts(tuple(names))]


@lru_cache(maxsize=64)
def _parts(names: tuple[str, ...]) -> list[slice]:
    """Where in the ranges of all these bodies each one's are."""
    ends = [*accumulate(map(_beams_of, names))]
    return [slice(begin, end) for begin, end in zip([0, *ends], ends, strict=False)]


def picture_of(run: str, frame: Frame) -> Picture:
    """What travels of a frame, its events apart."""
    scans = None if frame.scans is None else [np.asarray(scan, dtype="<f4").tobytes() for scan in frame.scans]
    lists = {name: _listed(getattr(frame, name)) for name in ("coupled", "fill", "alive", "row_picked")}
    poses = np.asarray(frame.poses, dtype="<f8").tobytes()
    return Picture(run, frame.tick, poses, scans, dict(frame.doing), **lists, delivered=frame.delivered)


def frame_of(picture: Picture, layout: Layout) -> Frame:
    """The frame that was sent. Raises ValueError for one that is not of this orchard, or holds what is no number."""
    bodies, rows = len(layout.names), layout.scenario.rows
    poses = np.frombuffer(picture.poses, dtype="<f8").reshape(-1, 3)
    arrays: dict[str, Any] = {name: _array(getattr(picture, name)) for name in SELDOM}
    lengths = {"row_picked": rows}
    fit = all(array is None or len(array) == lengths.get(name, bodies) for name, array in arrays.items())
    if not fit or len(poses) != bodies or (picture.scans is not None and len(picture.scans) != bodies):
        raise ValueError(f"it is not of {bodies} bodies and {rows} rows")
    if not (np.abs(poses) <= FARTHEST).all():
        raise ValueError("not a number, or out of bounds")
    scans = None
    if picture.scans is not None:
        scans = _sweeps_of(layout.names, [_fitting(sweep, [name]) for name, sweep in zip(layout.names, picture.scans, strict=True)])
    return Frame(picture.tick, poses, picture.doing, scans, **arrays, delivered=picture.delivered)


def _listed(array: np.ndarray | None) -> list[Any] | None:
    return None if array is None else array.tolist()


def _array(values: list[Any] | None) -> np.ndarray | None:
    return None if values is None else np.array(values)


def drive_of(action: Action, mail: bytes, memory: bytes | None) -> Drive:
    """What travels of an action."""
    x, y, turn = action.twist
    doing, waits_for = action.doing[:200], action.waits_for[:200]
    report = Report(action.deeds, doing, waits_for, action.steps_done, mail, memory, written_by(action))
    return Drive(Linear(x, y), Angular(turn), True, report)


def velocity_of(velocities: Velocities, name: str) -> Velocity:
    """One of several, as if it had come on its own."""
    drive = velocities.velocities[name]
    return Velocity(velocities.run, velocities.tick, drive.linear, drive.angular, velocities.holder, drive.once, drive.report)


def action_of(velocity: Velocity) -> Action:
    """The action that was sent, its mail and memory apart."""
    twist = Twist(velocity.linear.x, velocity.linear.y, velocity.angular.z)
    report = velocity.report or Report()
    return Action(twist, report.deeds, doing=report.doing, waits_for=report.waits_for, steps_done=report.steps_done)
