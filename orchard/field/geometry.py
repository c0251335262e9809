"""Poses, velocities, headings and boxes on the plane.

x east, y north, metres; yaw in radians, 0 faces east, counter-clockwise positive (REP-103).
"""

from typing import NamedTuple

from orchard.field import repeatable

EAST = 0.0
NORTH = repeatable.QUARTER
WEST = repeatable.PI
SOUTH = -repeatable.QUARTER
HEADINGS = {"EAST": EAST, "NORTH": NORTH, "WEST": WEST, "SOUTH": SOUTH}


class Pose(NamedTuple):
    """Where a body's centre is, in the orchard's frame (`map` in REP-105), and which way it faces."""

    x: float
    y: float
    yaw: float


class Twist(NamedTuple):
    """A velocity in the body's own frame (`base_link`): forward, to the left, counter-clockwise."""

    x: float = 0.0  # m/s
    y: float = 0.0  # m/s
    yaw: float = 0.0  # rad/s


STILL = Twist()


class Rect(NamedTuple):
    """A part of the ground with sides along x and y, metres."""

    west: float
    south: float
    east: float
    north: float

    def contains(self, x: float, y: float) -> bool:
        return self.west <= x <= self.east and self.south <= y <= self.north


def angle_between(start: float, end: float) -> float:
    """The smallest turn from one direction to another, in (-pi, pi], positive to the left."""
    return repeatable.wrap(end - start)


def nearest_heading(yaw: float) -> str:
    """The name of that of the four headings which is nearest to a yaw."""
    return min(HEADINGS, key=lambda name: abs(angle_between(yaw, HEADINGS[name])))


def to_frame(pose: Pose, x: float, y: float) -> tuple[float, float]:
    """A point of the orchard as seen from a pose: metres ahead, metres to the left."""
    s, c = repeatable.sin_cos(pose.yaw)
    dx, dy = x - pose.x, y - pose.y
    return c * dx + s * dy, c * dy - s * dx


def from_frame(pose: Pose, ahead: float, left: float) -> tuple[float, float]:
    """The point of the orchard that lies so many metres ahead and to the left of a pose."""
    s, c = repeatable.sin_cos(pose.yaw)
    return pose.x + c * ahead - s * left, pose.y + s * ahead + c * left


def yaw_of(z: float, w: float) -> float:
    """The yaw of an upright body from its quaternion (0, 0, z, w)."""
    return repeatable.wrap(2.0 * repeatable.atan2(z, w))
