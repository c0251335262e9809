"""What an agent finds in its scan and in the answers of bystanders: is the way or a turn free, which side is freer?

Points are in the agent's own frame: metres ahead of its centre, metres to its left.

A laser looks forward, but a turn also sweeps the space beside and behind. So a robot that turns asks people and animals that could be
near for their positions, and stands while one of them is, or may be, within the circle that the turn sweeps. It asks a distant one again
only after the time that this one needs to come near.
"""

import math
from collections.abc import Mapping
from functools import cache
from typing import NamedTuple

import numpy as np

from orchard.contract.agent import MOST_HOLD, Observation
from orchard.contract.zone import Zone, beams, in_zone
from orchard.field import repeatable
from orchard.field.geometry import Pose, from_frame, to_frame
from orchard.field.kinds import ANIMALS, AROUND, KINDS, PEOPLE, Kind, Laser, kind_of
from orchard.field.layout import Layout
from orchard.field.scenario import TIME_STEP

STOP_DISTANCE = 0.8  # m from the front edge: a robot stops for what is nearer (docs/reference.md, "The behaviours")
SIDE_MARGIN = 0.2  # m by which the corridor ahead is wider on either side
UNSURE_MARGIN = (
    0.03  # m, of a robot that is not sure of its place: 0.25 m from its side stand waiting pickers
)
TURN_MARGIN = 0.05  # m around the area that a turn sweeps
BACK = 0.2  # m behind it that a robot sees free before it drives back
_SWEEP_STEP = repeatable.PI / 48  # rad between the poses at which a turn is checked
_BIN_HALF = KINDS["bin"].length / 2


class Box(NamedTuple):
    """A box with sides along x and y of the frame `map`, m. A robot that is blind to it ignores its returns."""

    x: float
    y: float
    half_x: float
    half_y: float


@cache
def corridor(half_width: float, ahead: float) -> Zone:
    """Return the zone from a body's front edge to `ahead` metres before it, `half_width` to either side."""
    return Zone(0.0, ahead, -half_width, half_width)


def stop_zone(seen: Observation) -> Zone:
    """Return the corridor ahead of a robot in which it stops for obstacles."""
    kind = KINDS[kind_of(seen.name)]
    widest = kind.width / 2 if seen.hitch is None else max(kind.width / 2, _BIN_HALF)
    return corridor(widest + (UNSURE_MARGIN if seen.accuracy else SIDE_MARGIN), STOP_DISTANCE)


def something_ahead(seen: Observation, blind_to: list[Box]) -> bool:
    """Whether anything but the boxes `blind_to` returns from the corridor ahead, nearer than the stopping distance."""
    laser = KINDS[kind_of(seen.name)].laser
    inside = in_zone(seen.scan, laser, stop_zone(seen))
    if not np.count_nonzero(inside):
        return False
    return not blind_to or len(_not_on(_returns(seen.scan, laser, inside), seen.pose, blind_to)) > 0


def turn_is_free(seen: Observation, turn: float, blind_to: list[Box]) -> bool:
    """Whether nothing but the boxes `blind_to` returns from the area that robot and bin still sweep in a turn (rad, left is positive)."""
    points, boxes = _around(seen, blind_to)
    return not len(points) or not _swept(points, boxes, turn)


def back_is_free(seen: Observation) -> bool:
    """Whether nothing that the lasers of robot and bin see is right behind. A robot without a bin sees nothing there."""
    points, boxes = _around(seen, [])
    ahead, aside = points[:, 0], np.abs(points[:, 1])
    return not any(
        (_gaps(ahead + BACK, aside, box) < np.minimum(TURN_MARGIN, _gaps(ahead, aside, box))).any()
        for box in boxes
    )


def _around(
    seen: Observation, blind_to: list[Box]
) -> tuple[np.ndarray, list[tuple[float, float, float]]]:
    """The returns that a turn could reach, (m, 2), and the boxes of robot and bin: x of the centre, half length, half width."""
    kind = KINDS[kind_of(seen.name)]
    boxes = [(0.0, kind.length / 2, kind.width / 2)]
    if seen.hitch is not None and kind.tows:
        boxes.append((-kind.tows, _BIN_HALF, _BIN_HALF))
    points = _not_on(
        _points_around(seen, kind, max(-x + half for x, half, _ in boxes) + 1.0),
        seen.pose,
        blind_to,
    )
    reach = _reach(kind, len(boxes) > 1)
    return points[points[:, 0] ** 2 + points[:, 1] ** 2 < reach * reach], boxes


def _gaps(ahead: np.ndarray, aside: np.ndarray, box: tuple[float, float, float]) -> np.ndarray:
    """How far points are from a box, along its sides, m."""
    x, half_length, half_width = box
    return np.maximum(np.abs(ahead - x) - half_length, aside - half_width)


@cache
def turn_zone(kind: str) -> Zone:
    """Return a zone around all that a robot without a bin sweeps in a turn: while it is free, `turn_is_free`."""
    half, ahead = _reach(KINDS[kind], towing=False) + TURN_MARGIN, KINDS[kind].laser.ahead
    return Zone(-half - ahead, half - ahead, -half, half)


def _reach(kind: Kind, towing: bool) -> float:
    """How far from the centre a turn may sweep, m: a margin on both sides moves a corner by less than two margins."""
    return sweep_radius(kind, towing) + 2 * TURN_MARGIN


def _swept(points: np.ndarray, boxes: list[tuple[float, float, float]], turn: float) -> bool:
    """Whether a box (x of its centre, half length, half width) comes nearer to any point than the margin while the frame turns.

    A point that is within the margin from the beginning counts only if it comes nearer still: a robot that touches may turn away.
    """
    steps = int(abs(turn) / _SWEEP_STEP) + 1
    turned = np.array([repeatable.sin_cos(turn * i / steps) for i in range(steps + 1)])
    s, c = turned[:, :1], turned[:, 1:]  # a row for each step, a column for each point
    ahead, left = c * points[:, 0] + s * points[:, 1], np.abs(c * points[:, 1] - s * points[:, 0])
    for box in boxes:
        gaps = _gaps(ahead, left, box)
        if (gaps < np.minimum(TURN_MARGIN, gaps[0])).any():
            return True
    return False


def _points_around(seen: Observation, kind: Kind, radius: float) -> np.ndarray:
    own = _returns(seen.scan, kind.laser, seen.scan < radius)
    if seen.hitch is None or seen.hitch.scan is None:
        return own
    scan, bin_pose = seen.hitch.scan, seen.hitch.pose
    bin_in_frame = Pose(*to_frame(seen.pose, bin_pose.x, bin_pose.y), bin_pose.yaw - seen.pose.yaw)
    ahead, left = from_frame(bin_in_frame, *_returns(scan, AROUND, scan < radius).T)
    other = (np.abs(ahead) > kind.length / 2 + 0.1) | (np.abs(left) > kind.width / 2 + 0.1)
    return np.concatenate([own, np.array([ahead[other], left[other]]).T])


def _returns(scan: np.ndarray, laser: Laser, chosen: np.ndarray) -> np.ndarray:
    cosines, sines = beams(laser)
    ranges = scan[chosen].astype(np.float64)
    points = np.empty((len(ranges), 2))
    points[:, 0], points[:, 1] = laser.ahead + ranges * cosines[chosen], ranges * sines[chosen]
    return points


def _not_on(points: np.ndarray, pose: Pose, boxes: list[Box]) -> np.ndarray:
    if not boxes:
        return points
    x, y = from_frame(pose, *points.T)
    keep = np.ones(len(points), dtype=bool)
    for box in boxes:
        keep &= (np.abs(x - box.x) > box.half_x + 0.1) | (np.abs(y - box.y) > box.half_y + 0.1)
    return points[keep]


def path(seen: Observation, reach: float) -> Zone:
    """Return the zone of a walker's path up to a reach, m."""
    return corridor(KINDS[kind_of(seen.name)].width / 2 + SIDE_MARGIN, reach)


def is_path_free(seen: Observation, reach: float) -> bool:
    """Whether nothing returns from a walker's path up to a reach, m."""
    return not path(seen, reach).is_occupied(seen)


def free_directions(seen: Observation, reach: float, count: int = 13) -> list[float]:
    """Return the free ones of `count` directions from right to left, rad from straight ahead, up to a reach."""
    kind = KINDS[kind_of(seen.name)]
    points = _returns(seen.scan, kind.laser, seen.scan < reach + kind.width)
    angles = [repeatable.PI * (i / (count - 1) - 0.5) for i in range(count)]
    return [
        angle
        for angle in angles
        if not _in_path(points, angle, kind.width / 2 + SIDE_MARGIN, reach)
    ]


def _in_path(points: np.ndarray, angle: float, half_width: float, reach: float) -> bool:
    ahead, left = to_frame(Pose(0.0, 0.0, angle), *points.T)
    return bool(((ahead > 0.0) & (ahead < reach) & (np.abs(left) < half_width)).any())


SILENT_TICKS = 50  # ticks for which a bystander that did not answer is left to the lasers
MARGIN = 0.1  # m around the circle that a turn sweeps
ASK_AHEAD = 0.3  # s before a bystander may have come near, it is asked: an answer takes two ticks


class Bystander(NamedTuple):
    """A person or an animal."""

    name: str
    speed: float  # m/s, maximum
    radius: float  # m, of the circle around its box


class Sighting(NamedTuple):
    """The position that a bystander reported, m; infinitely far if it did not answer."""

    tick: int
    x: float
    y: float


def bystanders_of(layout: Layout) -> tuple[Bystander, ...]:
    return tuple(
        Bystander(s.name, KINDS[s.kind].speed, KINDS[s.kind].radius)
        for s in layout.starts
        if s.kind in PEOPLE + ANIMALS
    )


def sweep_radius(kind: Kind, towing: bool) -> float:
    """Return the distance from a robot's centre to the furthest corner of the robot, or of its bin, m."""
    return (
        math.sqrt((kind.tows + _BIN_HALF) ** 2 + _BIN_HALF * _BIN_HALF) if towing else kind.radius
    )


def time_to_reach(
    bystander: Bystander, sighting: Sighting | None, tick: int, x: float, y: float, radius: float
) -> float:
    """Return the time until a bystander may touch a circle, s from now; negative if it may touch the circle already."""
    if sighting is None:
        return -math.inf
    if math.isinf(sighting.x):
        return math.inf if tick - sighting.tick < SILENT_TICKS else -math.inf
    dx, dy = sighting.x - x, sighting.y - y
    room = math.sqrt(dx * dx + dy * dy) - radius - bystander.radius - MARGIN
    return room / bystander.speed - (tick - sighting.tick) * TIME_STEP


class Doubts(NamedTuple):
    """Which bystanders a circle has to be kept free for."""

    near: list[str]  # those that are or may be within it now
    to_ask: list[str]  # those, and those that soon may be
    ticks: int  # for which both lists stay empty, at least; 0 if they are not, or if one has not answered


def doubts(
    bystanders: tuple[Bystander, ...],
    sighted: Mapping[str, Sighting],
    tick: int,
    x: float,
    y: float,
    radius: float,
) -> Doubts:
    """Return what is known of the bystanders around a circle, m."""
    left = {
        one.name: time_to_reach(one, sighted.get(one.name), tick, x, y, radius)
        for one in bystanders
    }
    soonest = min(
        (0.0 if math.isinf(time) else time for time in left.values()), default=MOST_HOLD * TIME_STEP
    )
    near, to_ask = (
        [name for name, time in left.items() if time < within] for within in (TIME_STEP, ASK_AHEAD)
    )
    return Doubts(near, to_ask, max(0, int((soonest - ASK_AHEAD) / TIME_STEP)))
