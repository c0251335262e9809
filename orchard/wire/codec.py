"""Conversions between the messages on the wire and the types of agents, physics and the viewer. They are exact to the last bit."""

from collections.abc import Sequence
from functools import lru_cache
from itertools import accumulate
from typing import Any

import numpy as np

from orchard.contract.agent import STATE, Action, Hitch, Observation, Observations
from orchard.contract.events import SELDOM, Frame
from orchard.contract.mail import given_by
from orchard.contract.messages import unpack
from orchard.field.geometry import Pose, Twist
from orchard.field.kinds import KINDS, LASER_NEAREST, LASER_RANGE, Kind, Laser, kind_of
from orchard.field.layout import ROW_WEST, Layout
from orchard.field.repeatable import sin_cos
from orchard.wire import messages as wire
from orchard.wire.messages import FARTHEST, MOST_BODIES, read

RANGE = 4  # bytes of a float32


def _pose(body: Observation | Hitch) -> wire.PoseMessage:
    return wire.PoseMessage(
        wire.Point(float(body.x), float(body.y)), wire.Quaternion(*map(float, body.orientation))
    )


def _twist(twist: Twist) -> wire.TwistMessage:
    return wire.TwistMessage(
        wire.Linear(float(twist[0]), float(twist[1])), wire.Angular(float(twist[2]))
    )


def odometry_of(run: str, seen: Observation) -> wire.Odometry:
    hitch = seen.hitch and wire.OtherEnd(
        seen.hitch.name, _pose(seen.hitch), _twist(seen.hitch.twist)
    )
    measured = float(seen.fill), bool(seen.full), seen.accuracy, seen.charge
    return wire.Odometry(run, seen.tick, _pose(seen), _twist(seen.twist), hitch, *measured)


def _sweep(
    laser: Laser, scan: np.ndarray | None
) -> tuple[float, float, float, float, float, bytes]:
    last = laser.first + (laser.beams - 1) * laser.increment
    return (
        laser.first,
        last,
        laser.increment,
        LASER_NEAREST,
        LASER_RANGE,
        np.asarray(scan, dtype="<f4").tobytes(),
    )


def scan_of(run: str, seen: Observation, laser: Laser, rear_laser: Laser) -> wire.LaserScan:
    rear = (
        None
        if seen.hitch is None or seen.hitch.scan is None
        else wire.Beams(*_sweep(rear_laser, seen.hitch.scan))
    )
    return wire.LaserScan(*_sweep(laser, seen.scan), run, seen.tick, rear)


def seen_of(
    run: str, seen: Observations, due: Sequence[str], asked: list[wire.AskedOf]
) -> wire.Seen:
    """Return the message for the session that owns these agents, which are asked now. `asked`: the requests that they hear now."""
    names = [name for name in due if name in seen.names]
    bodies = [seen.names[name] for name in names]
    states = b"".join([seen.states[body].tobytes() for body in bodies])
    ranges = b"".join([seen.scans[body].tobytes() for body in bodies])
    hitches = {name: _other_seen(hitch) for name in names if (hitch := seen.hitches.get(name))}
    fills = {name: seen.fills[name] for name in names if name in seen.fills}
    full = [name for name in fills if name in seen.full]
    accuracies = {name: seen.accuracies[name] for name in names if name in seen.accuracies}
    charges = {name: seen.charges[name] for name in names if name in seen.charges}
    return wire.Seen(
        run,
        seen.tick,
        list(due),
        names,
        states,
        ranges,
        hitches,
        fills,
        full,
        asked,
        accuracies,
        charges,
    )


def _other_seen(hitch: Hitch) -> wire.OtherSeen:
    ranges = None if hitch.scan is None else hitch.scan.tobytes()
    return wire.OtherSeen(hitch.name, (hitch.x, hitch.y, *hitch.orientation, *hitch.twist), ranges)


def observations_of(seen: wire.Seen) -> dict[str, Observation]:
    """Return what the agents that are asked observe, by name. Raises ValueError if the arrays do not fit, or hold invalid numbers."""
    if len(seen.states) != 8 * STATE * len(seen.names):
        raise ValueError(f"the states do not fit {len(seen.names)} names")
    states = np.frombuffer(seen.states, "<f8").reshape(-1, STATE)
    if not (np.abs(states) <= FARTHEST).all():
        raise ValueError("states: not a number, or out of bounds")
    index = {name: body for body, name in enumerate(seen.names)}
    hitches = {name: _hitch_of(other) for name, other in seen.hitches.items()}
    sweeps = _sweeps_of(seen.names, seen.ranges)
    measured = seen.fills, seen.full, seen.accuracies, seen.percentages
    return Observations(seen.tick, index, states, sweeps, hitches, *measured).of(seen.due)


@lru_cache(maxsize=MOST_BODIES)
def _beams_of(name: str) -> int:
    kind = KINDS.get(kind_of(name))
    if kind is None:
        raise ValueError(f"{name}: unknown kind")
    return kind.laser.beams


def _hitch_of(other: wire.OtherSeen) -> Hitch:
    x, y, z, w, vx, vy, turn = other.state
    scan = None if other.ranges is None else _sweeps_of(["bin"], other.ranges)[0]
    return Hitch(other.name, x, y, (z, w), Twist(vx, vy, turn), scan)


def _sweeps_of(names: Sequence[str], ranges: bytes) -> list[np.ndarray]:
    """Each body's ranges, views of one array. Raises ValueError if they do not fit the names, and for NaN and negative ranges."""
    parts = _slices(tuple(names))
    if len(ranges) != RANGE * (beams := parts[-1].stop if parts else 0):
        raise ValueError(
            f"the ranges do not fit: {len(ranges)} bytes, not {RANGE} for each of {beams} beams"
        )
    measured = np.frombuffer(ranges, "<f4")
    if not measured.min(initial=0.0) >= 0.0:
        raise ValueError("ranges: not a number, or below 0")
    return [measured[part] for part in parts]


@lru_cache(maxsize=64)
def _slices(names: tuple[str, ...]) -> list[slice]:
    ends = [*accumulate(map(_beams_of, names))]
    return [slice(begin, end) for begin, end in zip([0, *ends], ends, strict=False)]


def orchard_of(run: str, tick: int, layout: Layout) -> wire.Orchard:
    rows = [(ROW_WEST, lane.y, layout.row_east, lane.y) for lane in layout.lanes]
    picked = {name: list(block.rows) for name, block in layout.blocks.items()}
    bodies = [
        wire.Place(
            name=start.name,
            kind=start.kind,
            pose=_pose_of(start.pose),
            bin=start.bin,
            rows=picked.get(start.name, []),
        )
        for start in layout.starts
    ]
    kinds = {name: _kind_of_body(kind) for name, kind in sorted(KINDS.items())}
    return wire.Orchard(
        run, tick, [tuple(wall) for wall in layout.walls.tolist()], rows, bodies, kinds
    )


def _pose_of(pose: Pose) -> wire.PoseMessage:
    sin, cos = sin_cos(pose.yaw / 2)
    return wire.PoseMessage(wire.Point(pose.x, pose.y), wire.Quaternion(sin, cos))


def _kind_of_body(kind: Kind) -> wire.KindOfBody:
    laser = wire.LaserOfKind(
        kind.laser.ahead,
        kind.laser.beams,
        kind.laser.first,
        kind.laser.increment,
        LASER_NEAREST,
        LASER_RANGE,
    )
    size = kind.length, kind.width, kind.height
    return wire.KindOfBody(
        *size, kind.colour, kind.speed, kind.turn, kind.tows, kind.solid, kind.robot, laser
    )


def picture_of(run: str, frame: Frame) -> wire.Picture:
    """Return the message for a frame, without its events."""
    scans = (
        None
        if frame.scans is None
        else [np.asarray(scan, dtype="<f4").tobytes() for scan in frame.scans]
    )
    lists: dict[str, Any] = {
        name: None if (array := getattr(frame, name)) is None else array.tolist() for name in SELDOM
    }
    poses, velocities = (
        np.asarray(frame.poses, dtype="<f8").tobytes(),
        {name: [*known] for name, known in frame.velocities.items()},
    )
    said: dict[str, Any] = {
        "states": dict(frame.states),
        "velocities": velocities,
        "charges": dict(frame.charges),
        "whole": frame.is_whole,
    }
    return wire.Picture(
        run, frame.tick, poses, scans, dict(frame.doing), **lists, delivered=frame.delivered, **said
    )


def frame_of(picture: wire.Picture, layout: Layout) -> Frame:
    """Return the frame in a picture. Raises ValueError if it does not fit the layout, or holds invalid numbers."""
    bodies, rows = len(layout.names), layout.scenario.rows
    poses = np.frombuffer(picture.poses, dtype="<f8").reshape(-1, 3)
    arrays: dict[str, Any] = {
        name: np.array(values) for name in SELDOM if (values := getattr(picture, name)) is not None
    }
    fit = all(
        len(array) == (rows if name == "row_ends" else bodies) for name, array in arrays.items()
    )
    if picture.scans is not None:
        fit &= [*map(len, picture.scans)] == [RANGE * _beams_of(name) for name in layout.names]
    if not fit or len(poses) != bodies:
        raise ValueError(f"it does not fit {bodies} bodies and {rows} rows")
    if not (np.abs(poses) <= FARTHEST).all():
        raise ValueError("not a number, or out of bounds")
    scans = None if picture.scans is None else _sweeps_of(layout.names, b"".join(picture.scans))
    velocities: Any = {name: tuple(known) for name, known in picture.velocities.items()}
    said: dict[str, Any] = {
        "states": picture.states,
        "velocities": velocities,
        "charges": picture.charges,
        "is_whole": picture.whole,
    }
    return Frame(
        picture.tick, poses, picture.doing, scans, **arrays, delivered=picture.delivered, **said
    )


def report_of(action: Action, mail: bytes, memory: bytes | None) -> wire.Report:
    """Return the message for an action. `mail`: the digest of the mail that the agent heard. `memory`: None if physics has it already."""
    said = {
        name: getattr(action, name)
        for name in ("doing", "state", "waits_for", "steps_done", "hold")
    }
    return wire.Report(
        action.twist,
        action.deeds,
        action.requests,
        answers=given_by(action),
        memory=memory,
        mail=mail,
        once=True,
        **said,
    )


def twist_of(velocity: wire.Velocity | wire.Advice) -> Twist:
    return Twist(velocity.linear.x, velocity.linear.y, velocity.angular.z)


def velocities_of(payload: bytes) -> tuple[wire.Velocities, dict[str, str]]:
    """Return the well-formed actions in a message, and name -> what is wrong with each other one. Raises ValueError as `read` does."""
    try:
        return read(payload, wire.Velocities), {}
    except ValueError:
        parts = read(payload, wire.VelocityParts)
    faults: dict[str, str] = {}
    whole = wire.Velocities(parts.run, parts.tick, parts.owner, {})
    for name, part in parts.velocities.items():
        try:
            whole.velocities[name] = unpack(bytes(part), wire.Report)
        except ValueError as error:
            faults[name] = str(error)
    return whole, faults
