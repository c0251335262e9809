"""What an agent makes of its scan: is my way free, is my turn free, which side is freer.

Points are in the agent's own frame: metres ahead of its centre, metres to its left.
"""

from functools import cache, lru_cache
from typing import NamedTuple, cast

import numpy as np

from orchard.contract.agent import Hitch, Observation
from orchard.field import repeatable
from orchard.field.geometry import Pose, to_frame
from orchard.field.kinds import AROUND, KINDS, Kind, Laser, kind_of

STOP_DISTANCE = 0.8  # m from the front edge: nearer than this a robot stops (reference.md, 'The behaviours')
SIDE_MARGIN = 0.2  # m on either side of the corridor in which it looks
TURN_MARGIN = 0.05  # m around what a turn sweeps
_SWEEP_STEP = repeatable.PI / 48  # rad between the poses that a turn is tried at
_BIN_HALF = KINDS["bin"].length / 2
_CORRIDORS = 64  # kept: there are some few, one for each width and each distance that is looked at


class Box(NamedTuple):
    """A box with sides along x and y of the orchard, whose returns are not obstacles to somebody."""

    x: float
    y: float
    half_x: float
    half_y: float


@cache
def beams(laser: Laser) -> tuple[np.ndarray, np.ndarray]:
    """Cosine and sine of every beam's angle to the front."""
    pairs = [repeatable.sin_cos(laser.first + i * laser.increment) for i in range(laser.beams)]
    return np.array([c for _, c in pairs]), np.array([s for s, _ in pairs])


@lru_cache(maxsize=_CORRIDORS)
def corridor(half_width: float, ahead: float) -> np.ndarray:
    """(180,): the range below which a forward beam ends inside a corridor of a half width, so far ahead of the front edge."""
    cosines, sines = beams(KINDS["picker"].laser)
    with np.errstate(divide="ignore"):
        ranges: np.ndarray = np.minimum(ahead / np.maximum(cosines, 1e-12), half_width / np.abs(sines))
    return ranges


def corridor_half_width(kind: Kind, towing: bool) -> float:
    """Half of what a robot must find free ahead: itself or its bin, whichever is wider, and a margin."""
    return max(kind.width / 2, _BIN_HALF if towing else 0.0) + SIDE_MARGIN


def something_ahead(seen: Observation, blind_to: list[Box]) -> bool:
    """Whether anything returns from the swept corridor nearer than the stopping distance."""
    kind = KINDS[kind_of(seen.name)]
    inside = seen.scan < corridor(corridor_half_width(kind, seen.hitch is not None), STOP_DISTANCE)
    if not np.count_nonzero(inside):
        return False
    if not blind_to:
        return True
    points = _returns(seen.scan, kind.laser, inside)
    return bool(len(_not_on(points, seen.pose, blind_to)))


def turn_is_free(seen: Observation, turn: float, blind_to: list[Box]) -> bool:
    """Whether nothing returns from what the robot and its bin will still sweep in a turn (rad, positive to the left)."""
    kind = KINDS[kind_of(seen.name)]
    boxes = [(0.0, kind.length / 2, kind.width / 2)]
    if seen.hitch is not None and kind.tows:
        boxes.append((-kind.tows, _BIN_HALF, _BIN_HALF))
    points = _points_around(seen, kind, max(-x + half for x, half, _ in boxes) + 1.0)
    if blind_to:
        points = _not_on(points, seen.pose, blind_to)
    return not len(points) or not _swept(points, boxes, turn)


def _swept(points: np.ndarray, boxes: list[tuple[float, float, float]], turn: float) -> bool:
    """Whether any point comes to lie in a box (x of its centre, half length, half width) while the frame turns."""
    steps = int(abs(turn) / _SWEEP_STEP) + 1
    turned = np.array([repeatable.sin_cos(turn * i / steps) for i in range(steps + 1)])
    s, c = turned[:, :1], turned[:, 1:]  # a row for each step, a column for each point
    ahead, left = c * points[:, 0] + s * points[:, 1], np.abs(c * points[:, 1] - s * points[:, 0])
    for x, half_length, half_width in boxes:
        if ((np.abs(ahead - x) < half_length + TURN_MARGIN) & (left < half_width + TURN_MARGIN)).any():
            return True
    return False


def _points_around(seen: Observation, kind: Kind, radius: float) -> np.ndarray:
    """(m, 2): all returns within a radius of the centre, the robot's own and its bin's, without the robot itself."""
    own = _returns(seen.scan, kind.laser, seen.scan < radius)
    if seen.hitch is None or seen.hitch.scan is None:
        return own
    return np.concatenate([own, _behind(seen, seen.hitch, kind, radius)])


def _behind(seen: Observation, hitch: Hitch, kind: Kind, radius: float) -> np.ndarray:
    scan = cast(np.ndarray, hitch.scan)
    points = _returns(scan, AROUND, scan < radius)
    pose, bin_pose = seen.pose, hitch.pose
    x, y = to_frame(pose, bin_pose.x, bin_pose.y)
    s, c = repeatable.sin_cos(bin_pose.yaw - pose.yaw)
    ahead, left = x + c * points[:, 0] - s * points[:, 1], y + s * points[:, 0] + c * points[:, 1]
    other = (np.abs(ahead) > kind.length / 2 + 0.1) | (np.abs(left) > kind.width / 2 + 0.1)
    return np.stack([ahead[other], left[other]], axis=1)


def _returns(scan: np.ndarray, laser: Laser, chosen: np.ndarray) -> np.ndarray:
    """(m, 2): the chosen returns as points in the frame of what carries the laser."""
    cosines, sines = beams(laser)
    ranges = scan[chosen].astype(np.float64)
    return np.stack([laser.ahead + ranges * cosines[chosen], ranges * sines[chosen]], axis=1)


def _not_on(points: np.ndarray, pose: Pose, boxes: list[Box]) -> np.ndarray:
    """Those of the points that do not lie on one of the boxes."""
    s, c = repeatable.sin_cos(pose.yaw)
    x, y = pose.x + c * points[:, 0] - s * points[:, 1], pose.y + s * points[:, 0] + c * points[:, 1]
    keep = np.ones(len(points), dtype=bool)
    for box in boxes:
        keep &= (np.abs(x - box.x) > box.half_x + 0.1) | (np.abs(y - box.y) > box.half_y + 0.1)
    return points[keep]


def nearest_in_path(seen: Observation, reach: float) -> float:
    """Metres ahead to the nearest return in a walker's own path, up to a reach; infinity where it is free."""
    kind = KINDS[kind_of(seen.name)]
    if not np.count_nonzero(seen.scan < reach):
        return float("inf")
    chosen = seen.scan < corridor(kind.width / 2 + SIDE_MARGIN, reach)
    if not np.count_nonzero(chosen):
        return float("inf")
    cosines, _ = beams(kind.laser)
    return float((seen.scan[chosen] * cosines[chosen]).min())


def free_directions(seen: Observation, reach: float, count: int = 13) -> list[float]:
    """Those of some directions from right to left, rad from straight ahead, in which a walker finds nothing in its path up to a reach."""
    kind = KINDS[kind_of(seen.name)]
    points = _returns(seen.scan, kind.laser, seen.scan < reach + kind.width)
    angles = [repeatable.PI * (i / (count - 1) - 0.5) for i in range(count)]
    return [angle for angle in angles if not _in_path(points, angle, kind.width / 2 + SIDE_MARGIN, reach)]


def _in_path(points: np.ndarray, angle: float, half_width: float, reach: float) -> bool:
    """Whether any point lies in a path from the origin in some direction."""
    s, c = repeatable.sin_cos(angle)
    ahead, left = c * points[:, 0] + s * points[:, 1], c * points[:, 1] - s * points[:, 0]
    return bool(((ahead > 0.0) & (ahead < reach) & (np.abs(left) < half_width)).any())


def freer_side(seen: Observation, reach: float) -> int:
    """+1 where there is more room to the left, -1 to the right: beams that return within a reach are counted."""
    near = seen.scan < reach
    half = len(near) // 2
    return 1 if int(near[half:].sum()) <= int(near[:half].sum()) else -1
