"""What an agent finds in its scan and in answers of bystanders: whether a way or a turn is free.

A scan is an array of ranges, (beams,), m. A return is a point at which a beam of the laser ends.
Points are in the agent's own frame: metres ahead of its centre, metres to its left. Zones are in
the frame of its laser, which is `Laser.ahead` further ahead (orchard/contract/zone.py).

A bystander is a person or an animal. A laser looks forward, but a turn also sweeps the space beside
and behind. So a robot that turns asks bystanders that could be near for their positions, and stands
while one of them is, or may be, within the circle that the turn sweeps. It asks a distant bystander
again only after the time that this bystander needs to come near.
"""

import math
from collections.abc import Mapping
from functools import cache
from typing import NamedTuple, cast

import numpy as np

from orchard.contract.agent import MOST_HOLD, Hitch, Observation
from orchard.contract.zone import Zone, beams, in_zone
from orchard.field import repeatable
from orchard.field.geometry import Pose, angle_between, from_frame, to_frame
from orchard.field.kinds import ANIMALS, AROUND, KINDS, PEOPLE, Kind, Laser, kind_of
from orchard.field.layout import Layout
from orchard.field.scenario import TIME_STEP

# A robot stops for what is nearer to its front edge than this, m (docs/reference.md, "The
# behaviours").
STOP_DISTANCE = 0.8
# m by which the corridor ahead is wider than the robot, on either side.
SIDE_MARGIN = 0.2
# m, in place of SIDE_MARGIN, for a robot that is not sure of its position. Waiting pickers stand
# 0.25 m from its side, and it may be nearer to them than it takes itself to be.
UNSURE_MARGIN = 0.03
# Nothing may return to the lasers of robot and bin from what is nearer than this to what they sweep
# in a turn, m. For bystanders, which lasers may not see, it is BYSTANDER_MARGIN.
TURN_MARGIN = 0.05
# A robot drives back only if it sees nothing so near behind it, m.
BACK = 0.2
# Returns so near to a box count as returns from it, m.
ON_BOX = 0.1
# rad, at most, between the poses at which a turn is checked.
_SWEEP_STEP = repeatable.PI / 48
_BIN_HALF = KINDS["bin"].length / 2
_CENTRE = Pose(0.0, 0.0, 0.0)
# m. Lasers are not at the robot's centre. So returns are first chosen by ranges that are so much
# longer than what counts.
_LASER_OFFSET = 1.0


class Box(NamedTuple):
    """A box with sides along x and y of the frame `map`, m.

    A robot that is blind to it ignores its returns.
    """

    # The centre.
    x: float
    y: float
    # Half the sides.
    half_x: float
    half_y: float


@cache
def corridor(half_width: float, ahead: float) -> Zone:
    """Return the zone before a body: `ahead` m long, `half_width` m to either side."""
    return Zone(0.0, ahead, -half_width, half_width)


def stop_zone(seen: Observation) -> Zone:
    """Return the corridor ahead of a robot in which it stops for obstacles."""
    kind = KINDS[kind_of(seen.name)]
    half_width = kind.width / 2
    if seen.hitch is not None:
        half_width = max(half_width, _BIN_HALF)
    margin = SIDE_MARGIN
    if seen.accuracy:
        margin = UNSURE_MARGIN
    return corridor(half_width + margin, STOP_DISTANCE)


def something_ahead(seen: Observation, blind_to: list[Box]) -> bool:
    """Whether anything but the boxes `blind_to` returns from the corridor of `stop_zone`."""
    laser = KINDS[kind_of(seen.name)].laser
    is_inside = in_zone(seen.scan, laser, stop_zone(seen))
    if not np.count_nonzero(is_inside):
        return False
    if not blind_to:
        return True
    others = _not_on(_returns(seen.scan, laser, is_inside), seen.pose, blind_to)
    return len(others) > 0


def turn_is_free(seen: Observation, turn: float, blind_to: list[Box]) -> bool:
    """Whether nothing but the boxes `blind_to` returns from what robot and bin sweep in a turn.

    `turn`: what remains of it, rad; left is positive.
    """
    points, parts = _around(seen, blind_to)
    if not len(points):
        return True
    return not _swept(points, parts, turn)


def back_is_free(seen: Observation) -> bool:
    """Whether nothing that the lasers of robot and bin see is right behind.

    A robot without a bin sees nothing there.
    """
    points, parts = _around(seen, [])
    ahead = points[:, 0]
    left = points[:, 1]
    for part in parts:
        gaps_now = _gaps(ahead, left, part)
        # To a robot that has driven back all points lie further ahead.
        gaps_after_drive = _gaps(ahead + BACK, left, part)
        # A point that is within the margin already counts only if it comes nearer still.
        if (gaps_after_drive < np.minimum(TURN_MARGIN, gaps_now)).any():
            return False
    return True


class _Part(NamedTuple):
    """The box of a robot or of its bin, in the robot's frame, m and rad."""

    # Its centre, and where it faces.
    pose: Pose
    half_length: float
    half_width: float


def _around(seen: Observation, blind_to: list[Box]) -> tuple[np.ndarray, list[_Part]]:
    """Return the points that a turn could reach, (m, 2), and the boxes of robot and bin."""
    kind = KINDS[kind_of(seen.name)]
    parts = [_Part(_CENTRE, kind.length / 2, kind.width / 2)]
    tows_bin = seen.hitch is not None and kind.tows > 0.0
    if tows_bin:
        parts.append(_Part(_pose_of_bin(seen, kind), _BIN_HALF, _BIN_HALF))
    # For speed most returns are left out by their ranges, before their points are computed. Of the
    # others the reach decides.
    rear_end = max(-part.pose.x + part.half_length for part in parts)
    points = _not_on(_points_around(seen, kind, rear_end + _LASER_OFFSET), seen.pose, blind_to)
    reach = _reach(kind, tows_bin)
    is_near = points[:, 0] ** 2 + points[:, 1] ** 2 < reach * reach
    return points[is_near], parts


def _pose_of_bin(seen: Observation, kind: Kind) -> Pose:
    """Return where the towed bin is, in the robot's frame.

    It is where a coupled bin should be, unless it is further away from there than ON_BOX: a bin
    that something holds stays behind, askew, while the robot goes on.
    """
    coupled = Pose(-kind.tows, 0.0, 0.0)
    hitch = cast(Hitch, seen.hitch)
    x, y = to_frame(seen.pose, hitch.pose.x, hitch.pose.y)
    if math.hypot(x - coupled.x, y) < ON_BOX:
        return coupled
    return Pose(x, y, angle_between(seen.pose.yaw, hitch.pose.yaw))


def _gaps(ahead: np.ndarray, left: np.ndarray, part: _Part) -> np.ndarray:
    """Return how far points are from a box, m: the greater of the distances along both sides.

    `ahead`, `left`: of the points in the robot's frame, of any shape, which the result has too. It
    is negative inside the box.
    """
    along = ahead - part.pose.x
    across = left - part.pose.y
    if part.pose.yaw:
        along, across = to_frame(part.pose, ahead, left)
    return np.maximum(np.abs(along) - part.half_length, np.abs(across) - part.half_width)


@cache
def turn_zone(kind: str) -> Zone:
    """Return a zone around all that a robot without a bin sweeps in a turn.

    While the zone is free, so is any turn: see `turn_is_free`. It is a square around the robot's
    centre. Zones are in the frame of the laser, which is ahead of the centre.
    """
    half = _reach(KINDS[kind], towing=False) + TURN_MARGIN
    ahead = KINDS[kind].laser.ahead
    return Zone(-half - ahead, half - ahead, -half, half)


def _reach(kind: Kind, towing: bool) -> float:
    """Return how far from the robot's centre a point may matter to a turn, m.

    The margin widens the boxes on both sides, which moves a corner by less than two margins.
    """
    return sweep_radius(kind, towing) + 2 * TURN_MARGIN


def _swept(points: np.ndarray, parts: list[_Part], turn: float) -> bool:
    """Whether a part comes nearer to any point than the margin while the robot turns.

    `points`: (m, 2). `turn`: by how much, rad; left is positive. A point that is within the margin
    from the beginning counts only if it comes nearer still: a robot that touches something may turn
    away.
    """
    steps = int(abs(turn) / _SWEEP_STEP) + 1
    # (steps + 1, 2): sine and cosine of the turn at each pose, from the present one on.
    turned = np.array([repeatable.sin_cos(turn * i / steps) for i in range(steps + 1)])
    sines = turned[:, :1]
    cosines = turned[:, 1:]
    # (steps + 1, m): the points in the robot's frame at each pose.
    ahead = cosines * points[:, 0] + sines * points[:, 1]
    left = cosines * points[:, 1] - sines * points[:, 0]
    for part in parts:
        gaps = _gaps(ahead, left, part)
        gaps_now = gaps[0]
        if (gaps < np.minimum(TURN_MARGIN, gaps_now)).any():
            return True
    return False


def _points_around(seen: Observation, kind: Kind, radius: float) -> np.ndarray:
    """Return the points at which the lasers of robot and bin return within a range, (m, 2).

    `radius`: of that range, m. Points on the robot itself, which the bin's laser sees, are left
    out.
    """
    own = _returns(seen.scan, kind.laser, seen.scan < radius)
    if seen.hitch is None or seen.hitch.scan is None:
        return own
    scan = seen.hitch.scan
    bin_pose = seen.hitch.pose
    # Its yaw may be more than half a turn, which is the same direction to `from_frame`.
    bin_in_frame = Pose(*to_frame(seen.pose, bin_pose.x, bin_pose.y), bin_pose.yaw - seen.pose.yaw)
    ahead, left = from_frame(bin_in_frame, *_returns(scan, AROUND, scan < radius).T)
    is_beyond_ends = np.abs(ahead) > kind.length / 2 + ON_BOX
    is_beyond_sides = np.abs(left) > kind.width / 2 + ON_BOX
    is_other = is_beyond_ends | is_beyond_sides
    return np.concatenate([own, np.array([ahead[is_other], left[is_other]]).T])


def _returns(scan: np.ndarray, laser: Laser, chosen: np.ndarray) -> np.ndarray:
    """Return the points of the chosen beams, (m, 2). `chosen`: (beams,) bool."""
    cosines, sines = beams(laser)
    ranges = scan[chosen].astype(np.float64)
    points = np.empty((len(ranges), 2))
    points[:, 0] = laser.ahead + ranges * cosines[chosen]
    points[:, 1] = ranges * sines[chosen]
    return points


def _not_on(points: np.ndarray, pose: Pose, boxes: list[Box]) -> np.ndarray:
    """Return the points that lie on none of these boxes, (m, 2).

    `pose`: of the robot, in the frame `map`, as the boxes are.
    """
    if not boxes:
        return points
    x, y = from_frame(pose, *points.T)
    is_off_all = np.ones(len(points), dtype=bool)
    for box in boxes:
        is_off_x = np.abs(x - box.x) > box.half_x + ON_BOX
        is_off_y = np.abs(y - box.y) > box.half_y + ON_BOX
        is_off_all &= is_off_x | is_off_y
    return points[is_off_all]


def path(seen: Observation, reach: float) -> Zone:
    """Return the zone of a walker's path up to a reach, m."""
    return corridor(KINDS[kind_of(seen.name)].width / 2 + SIDE_MARGIN, reach)


def is_path_free(seen: Observation, reach: float) -> bool:
    """Whether nothing returns from a walker's path up to a reach, m."""
    return not path(seen, reach).is_occupied(seen)


def free_directions(seen: Observation, reach: float, count: int = 13) -> list[float]:
    """Return the free ones of `count` directions from right to left, rad from straight ahead.

    They cover the half circle that a laser at the front sees. `reach`: how far they must be free,
    m.
    """
    kind = KINDS[kind_of(seen.name)]
    half_width = kind.width / 2 + SIDE_MARGIN
    points = _returns(seen.scan, kind.laser, seen.scan < reach + kind.width)
    angles = []
    for i in range(count):
        angle = repeatable.PI * (i / (count - 1) - 0.5)
        if not _in_path(points, angle, half_width, reach):
            angles.append(angle)
    return angles


def _in_path(points: np.ndarray, angle: float, half_width: float, reach: float) -> bool:
    """Whether a point lies in a path at an angle, rad, up to a reach, m."""
    ahead, left = to_frame(Pose(0.0, 0.0, angle), *points.T)
    return bool(((ahead > 0.0) & (ahead < reach) & (np.abs(left) < half_width)).any())


# Ticks for which a bystander that did not answer is not asked again: lasers alone look for it.
SILENT_TICKS = 50
# No bystander may be nearer than this to the circle that a turn sweeps, m.
BYSTANDER_MARGIN = 0.1
# A bystander is asked so long before it may have come near, s: an answer takes two ticks.
ASK_AHEAD = 0.3


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
    """Return the people and animals of an orchard, in body order."""
    bystanders = []
    for start in layout.starts:
        if start.kind in PEOPLE + ANIMALS:
            kind = KINDS[start.kind]
            bystanders.append(Bystander(start.name, kind.speed, kind.radius))
    return tuple(bystanders)


def sweep_radius(kind: Kind, towing: bool) -> float:
    """Return the distance from a robot's centre to the furthest corner of it or its bin, m."""
    if not towing:
        return kind.radius
    return math.sqrt((kind.tows + _BIN_HALF) ** 2 + _BIN_HALF * _BIN_HALF)


class Circle(NamedTuple):
    """What a robot sweeps when it turns, in the frame `map`, m."""

    x: float
    y: float
    radius: float


def time_to_reach(
    bystander: Bystander, sighting: Sighting | None, tick: int, circle: Circle
) -> float:
    """Return the time until a bystander may touch a circle, s from now.

    It is negative if the bystander may touch the circle already, -inf if its place is unknown, and
    inf for SILENT_TICKS after a question that it did not answer: lasers alone look for it then.
    """
    if sighting is None:
        return -math.inf
    if math.isinf(sighting.x):
        if tick - sighting.tick < SILENT_TICKS:
            return math.inf
        return -math.inf
    dx = sighting.x - circle.x
    dy = sighting.y - circle.y
    room = math.sqrt(dx * dx + dy * dy) - circle.radius - bystander.radius - BYSTANDER_MARGIN
    return room / bystander.speed - (tick - sighting.tick) * TIME_STEP


class TurnHazards(NamedTuple):
    """The bystanders that are, or may be, within the circle of a turn."""

    # Names of those that are or may be within it now.
    near: list[str]
    # Names of those, and of those that soon may be within it.
    to_ask: list[str]
    # Ticks for which both lists stay empty, at least; 0 if they are not empty now, or if a
    # bystander has not answered.
    ticks: int


def turn_hazards(
    bystanders: tuple[Bystander, ...],
    sighted: Mapping[str, Sighting],
    tick: int,
    circle: Circle,
) -> TurnHazards:
    """Return which bystanders are or may be within a circle, by what they reported.

    `sighted`: name -> its last report.
    """
    near = []
    to_ask = []
    times = []
    for bystander in bystanders:
        sighting = sighted.get(bystander.name)
        seconds = time_to_reach(bystander, sighting, tick, circle)
        if seconds < TIME_STEP:
            near.append(bystander.name)
        if seconds < ASK_AHEAD:
            to_ask.append(bystander.name)
        if math.isinf(seconds):
            # Nothing is known of its position, so it is not known that the lists stay empty.
            seconds = 0.0
        times.append(seconds)
    soonest = min(times, default=MOST_HOLD * TIME_STEP)
    return TurnHazards(near, to_ask, max(0, int((soonest - ASK_AHEAD) / TIME_STEP)))
