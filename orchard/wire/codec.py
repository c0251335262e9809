"""Conversions between the messages on the wire and the types of agents, physics and the viewer.

They are exact to the last bit.
"""

from collections.abc import Mapping, Sequence
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
from orchard.field.lanes import ROW_WEST
from orchard.field.layout import Layout
from orchard.field.machines import Machine
from orchard.field.repeatable import sin_cos
from orchard.wire import messages as wire
from orchard.wire.messages import FARTHEST, MOST_BODIES, read

RANGE = 4  # bytes of a range, a float32
NUMBER = 8  # bytes of a number of a state, a float64


def _pose(body: Observation | Hitch) -> wire.PoseMessage:
    """Return the message of a body's pose."""
    point = wire.Point(float(body.x), float(body.y))
    return wire.PoseMessage(point, wire.Quaternion(*map(float, body.orientation)))


def _twist(twist: Twist) -> wire.TwistMessage:
    """Return the message of a velocity."""
    linear = wire.Linear(float(twist[0]), float(twist[1]))
    return wire.TwistMessage(linear, wire.Angular(float(twist[2])))


def odometry_of(run: str, seen: Observation) -> wire.Odometry:
    """Return the message of a body's pose and velocity."""
    hitch = None
    if seen.hitch is not None:
        hitch = wire.OtherEnd(seen.hitch.name, _pose(seen.hitch), _twist(seen.hitch.twist))
    return wire.Odometry(
        run=run,
        tick=seen.tick,
        pose=_pose(seen),
        twist=_twist(seen.twist),
        hitch=hitch,
        fill=float(seen.fill),
        full=bool(seen.full),
        accuracy=seen.accuracy,
        percentage=seen.charge,
    )


def _sweep(laser: Laser, scan: np.ndarray) -> dict[str, Any]:
    """Return the fields of `wire.Beams` for a laser and its ranges, m."""
    return {
        "angle_min": laser.first,
        "angle_max": laser.first + (laser.beams - 1) * laser.increment,
        "angle_increment": laser.increment,
        "range_min": LASER_NEAREST,
        "range_max": LASER_RANGE,
        "ranges": np.asarray(scan, dtype="<f4").tobytes(),
    }


def scan_of(run: str, seen: Observation, laser: Laser, rear_laser: Laser) -> wire.LaserScan:
    """Return the message of a body's scan. `rear_laser`: that of a bin that it tows."""
    rear = None
    if seen.hitch is not None and seen.hitch.scan is not None:
        rear = wire.Beams(**_sweep(rear_laser, seen.hitch.scan))
    return wire.LaserScan(**_sweep(laser, seen.scan), run=run, tick=seen.tick, rear=rear)


def seen_of(
    run: str, seen: Observations, due: Sequence[str], asked: list[wire.AskedOf]
) -> wire.Seen:
    """Return the message for the session that owns these agents, which are asked now.

    `asked`: the requests that they hear now.
    """
    names = [name for name in due if name in seen.names]
    states = []
    ranges = []
    hitches = {}
    for name in names:
        body = seen.names[name]
        states.append(seen.states[body].tobytes())
        ranges.append(seen.scans[body].tobytes())
        hitch = seen.hitches.get(name)
        if hitch is not None:
            hitches[name] = _other_seen(hitch)
    fills = _of(names, seen.fills)
    return wire.Seen(
        run=run,
        tick=seen.tick,
        due=list(due),
        names=names,
        states=b"".join(states),
        ranges=b"".join(ranges),
        hitches=hitches,
        fills=fills,
        full=[name for name in fills if name in seen.full],
        asked=asked,
        accuracies=_of(names, seen.accuracies),
        percentages=_of(names, seen.charges),
    )


def _of(names: Sequence[str], values: Mapping[str, float]) -> dict[str, float]:
    """Return the values of these names, without names that have none."""
    return {name: values[name] for name in names if name in values}


def _other_seen(hitch: Hitch) -> wire.OtherSeen:
    """Return the message for the body at the other end of the bar."""
    ranges = None
    if hitch.scan is not None:
        ranges = hitch.scan.tobytes()
    return wire.OtherSeen(hitch.name, (hitch.x, hitch.y, *hitch.orientation, *hitch.twist), ranges)


def observations_of(seen: wire.Seen) -> dict[str, Observation]:
    """Return what the agents that are asked observe, by name.

    Raises ValueError if the arrays do not fit, or hold invalid numbers.
    """
    if len(seen.states) != NUMBER * STATE * len(seen.names):
        raise ValueError(f"the states do not fit {len(seen.names)} names")
    states = np.frombuffer(seen.states, "<f8").reshape(-1, STATE)
    # NaN is not <= FARTHEST, so it is refused, too.
    if not (np.abs(states) <= FARTHEST).all():
        raise ValueError("states: not a number, or out of bounds")
    observations = Observations(
        tick=seen.tick,
        names={name: body for body, name in enumerate(seen.names)},
        states=states,
        scans=_sweeps_of(seen.names, seen.ranges),
        hitches={name: _hitch_of(other) for name, other in seen.hitches.items()},
        fills=seen.fills,
        full=seen.full,
        accuracies=seen.accuracies,
        charges=seen.percentages,
    )
    return observations.of(seen.due)


@lru_cache(maxsize=MOST_BODIES)
def _beams_of(name: str) -> int:
    """Return the number of beams of a body's laser. Raises ValueError for an unknown kind."""
    kind = KINDS.get(kind_of(name))
    if kind is None:
        raise ValueError(f"{name}: unknown kind")
    return kind.laser.beams


def _hitch_of(other: wire.OtherSeen) -> Hitch:
    """Return the body at the other end of the bar. Raises ValueError for invalid ranges."""
    x, y, z, w, vx, vy, turn = other.state
    scan = None
    if other.ranges is not None:
        scan = _sweeps_of(["bin"], other.ranges)[0]
    twist = Twist(vx, vy, turn)
    return Hitch(other.name, x, y, (z, w), twist=twist, scan=scan)


def _sweeps_of(names: Sequence[str], ranges: bytes) -> list[np.ndarray]:
    """Return each body's ranges, m, views of one array.

    Raises ValueError if they do not fit the names, and for NaN and negative ranges.
    """
    parts = _slices(tuple(names))
    beams = parts[-1].stop if parts else 0
    if len(ranges) != RANGE * beams:
        expected = f"{RANGE} for each of {beams} beams"
        raise ValueError(f"the ranges do not fit: {len(ranges)} bytes, not {expected}")
    measured = np.frombuffer(ranges, "<f4")
    # A NaN makes the minimum NaN, which is not >= 0.
    if not measured.min(initial=0.0) >= 0.0:
        raise ValueError("ranges: not a number, or below 0")
    return [measured[part] for part in parts]


@lru_cache(maxsize=64)
def _slices(names: tuple[str, ...]) -> list[slice]:
    """Return where each body's ranges are among those of all bodies, one after another."""
    ends = [*accumulate(map(_beams_of, names))]
    # Each begins where the one before ends; the last end is no beginning.
    return [slice(begin, end) for begin, end in zip([0, *ends], ends, strict=False)]


def orchard_of(run: str, tick: int, layout: Layout) -> wire.Orchard:
    """Return the message for a layout."""
    rows = [(ROW_WEST, lane.y, layout.row_east, lane.y) for lane in layout.lanes]
    picked = {name: list(block.rows) for name, block in layout.blocks.items()}
    bodies = []
    for start in layout.starts:
        body = wire.BodyStart(
            name=start.name,
            kind=start.kind,
            pose=_pose_of(start.pose),
            bin=start.bin,
            rows=picked.get(start.name, []),
        )
        bodies.append(body)
    kinds = {}
    for name, kind in sorted(KINDS.items()):
        kinds[name] = _kind_of_body(kind, layout.machines[name])
    walls = [tuple(wall) for wall in layout.walls.tolist()]
    return wire.Orchard(run=run, tick=tick, walls=walls, rows=rows, bodies=bodies, kinds=kinds)


def _pose_of(pose: Pose) -> wire.PoseMessage:
    """Return the message of a pose."""
    sin, cos = sin_cos(pose.yaw / 2)
    return wire.PoseMessage(wire.Point(pose.x, pose.y), wire.Quaternion(sin, cos))


def _kind_of_body(kind: Kind, machine: Machine) -> wire.KindOfBody:
    """Return the message for a kind of bodies."""
    laser = wire.LaserOfKind(
        x=kind.laser.ahead,
        beams=kind.laser.beams,
        angle_min=kind.laser.first,
        angle_increment=kind.laser.increment,
        range_min=LASER_NEAREST,
        range_max=LASER_RANGE,
    )
    return wire.KindOfBody(
        length=kind.length,
        width=kind.width,
        height=kind.height,
        colour=kind.colour,
        max_linear=machine.speed,
        max_angular=machine.turn,
        tows=kind.tows,
        solid=kind.solid,
        robot=kind.robot,
        laser=laser,
    )


def picture_of(run: str, frame: Frame) -> wire.TickStateMessage:
    """Return the message for a frame, without its events."""
    scans = None
    if frame.scans is not None:
        scans = [np.asarray(scan, dtype="<f4").tobytes() for scan in frame.scans]
    seldom: dict[str, Any] = {}
    for name in SELDOM:
        array = getattr(frame, name)
        seldom[name] = None
        if array is not None:
            seldom[name] = array.tolist()
    return wire.TickStateMessage(
        run=run,
        tick=frame.tick,
        poses=np.asarray(frame.poses, dtype="<f8").tobytes(),
        scans=scans,
        doing=dict(frame.doing),
        **seldom,
        delivered=frame.delivered,
        waiting_bins=frame.waiting_bins,
        states=dict(frame.states),
        velocities={name: [*known] for name, known in frame.velocities.items()},
        charges=dict(frame.charges),
        whole=frame.is_whole,
    )


def frame_of(picture: wire.TickStateMessage, layout: Layout) -> Frame:
    """Return the frame in a picture.

    Raises ValueError if it does not fit the layout, or holds invalid numbers.
    """
    poses = np.frombuffer(picture.poses, dtype="<f8").reshape(-1, 3)
    seldom: dict[str, Any] = {}
    for name in SELDOM:
        values = getattr(picture, name)
        if values is not None:
            seldom[name] = np.array(values)
    if not _fits(picture, poses, seldom, layout):
        bodies = f"{len(layout.names)} bodies and {layout.scenario.rows} rows"
        raise ValueError(f"it does not fit {bodies}")
    if not (np.abs(poses) <= FARTHEST).all():
        raise ValueError("not a number, or out of bounds")
    scans = None if picture.scans is None else _sweeps_of(layout.names, b"".join(picture.scans))
    velocities: Any = {name: tuple(known) for name, known in picture.velocities.items()}
    return Frame(
        tick=picture.tick,
        poses=poses,
        doing=picture.doing,
        scans=scans,
        **seldom,
        delivered=picture.delivered,
        waiting_bins=picture.waiting_bins,
        states=picture.states,
        velocities=velocities,
        charges=picture.charges,
        is_whole=picture.whole,
    )


def _fits(
    picture: wire.TickStateMessage,
    poses: np.ndarray,
    seldom: Mapping[str, np.ndarray],
    layout: Layout,
) -> bool:
    """Whether a picture has the bodies and rows of a layout. `seldom`: its arrays, by name."""
    bodies = len(layout.names)
    load_out = layout.scenario.load_out
    # The entries that these two have; each other array has one for each body. Without a load-out
    # there is one trailer, which does nothing.
    lengths = {"row_ends": layout.scenario.rows, "trailers": load_out.trailers.count or 1}
    for name, array in seldom.items():
        if len(array) != lengths.get(name, bodies):
            return False
    if picture.waiting_bins > (load_out.empty_bins or 0):
        return False
    if picture.scans is not None and not _scans_fit(picture.scans, layout):
        return False
    return len(poses) == bodies


def _scans_fit(scans: Sequence[bytes], layout: Layout) -> bool:
    """Whether there is a scan for each body of a layout, with the ranges of all its beams."""
    if len(scans) != len(layout.names):
        return False
    for name, scan in zip(layout.names, scans, strict=True):
        if len(scan) != RANGE * _beams_of(name):
            return False
    return True


def report_of(action: Action, mail: bytes, memory: bytes | None) -> wire.Report:
    """Return the message for an action.

    `mail`: the digest of the mail that the agent heard. `memory`: None if physics has it already.
    The velocity counts `once`, because agents compute it from the pose of one tick.
    """
    return wire.Report(
        twist=action.twist,
        deeds=action.deeds,
        requests=action.requests,
        answers=given_by(action),
        memory=memory,
        mail=mail,
        once=True,
        doing=action.doing,
        state=action.state,
        waits_for=action.waits_for,
        steps_done=action.steps_done,
        hold=action.hold,
    )


def twist_of(velocity: wire.Velocity | wire.Advice) -> Twist:
    """Return the velocity in a message."""
    return Twist(velocity.linear.x, velocity.linear.y, velocity.angular.z)


def velocities_of(payload: bytes) -> tuple[wire.Velocities, dict[str, str]]:
    """Return the well-formed actions in a message, and name -> what is wrong with each other one.

    Raises ValueError as `read` does.
    """
    try:
        return read(payload, wire.Velocities), {}
    except ValueError:
        # Some action is malformed. Read each by itself, so that the others count.
        parts = read(payload, wire.VelocityParts)
    faults: dict[str, str] = {}
    whole = wire.Velocities(parts.run, parts.tick, parts.owner, {})
    for name, part in parts.velocities.items():
        try:
            whole.velocities[name] = unpack(bytes(part), wire.Report)
        except ValueError as error:
            faults[name] = str(error)
    return whole, faults
