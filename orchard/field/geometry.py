"""Poses, velocities, headings and boxes.

x points east and y north, m. Yaw is in rad: 0 faces east, counter-clockwise is positive (REP-103).
"""

from typing import NamedTuple, TypeVar

import numpy as np

from orchard.field import repeatable

# Headings in the frame `map`, rad, counter-clockwise.
EAST = 0.0
NORTH = repeatable.QUARTER
WEST = repeatable.PI
SOUTH = -repeatable.QUARTER
HEADINGS = {"EAST": EAST, "NORTH": NORTH, "WEST": WEST, "SOUTH": SOUTH}
# A coordinate of one point, or of many at once.
Number = TypeVar("Number", float, np.ndarray)


class Pose(NamedTuple):
    """The position of a body's centre in the orchard's frame (`map` in REP-105), m, and its yaw,
    rad.

    >>> here = Pose(3.0, 4.0, NORTH)
    >>> x, y = from_frame(here, 2.0, 0.0)  # 2 m ahead of it
    >>> x, y
    (3.0, 6.0)
    """

    x: float
    y: float
    yaw: float


class Twist(NamedTuple):
    """A velocity in the body's own frame (`base_link` in REP-105): forward, to the left,
    counter-clockwise.

    >>> Twist(x=0.5)  # half a metre a second straight ahead
    Twist(x=0.5, y=0.0, yaw=0.0)
    """

    x: float = 0.0  #: m/s
    y: float = 0.0  #: m/s
    yaw: float = 0.0  #: rad/s


STILL = Twist()


class Rect(NamedTuple):
    """A rectangle on the ground with sides along x and y, metres."""

    west: float
    south: float
    east: float
    north: float

    def contains(self, x: float, y: float) -> bool:
        """Whether a point lies in it or on its edge, m."""
        return self.west <= x <= self.east and self.south <= y <= self.north


def angle_between(start: float, end: float) -> float:
    """Return the smallest turn from `start` to `end`, rad, in (-pi, pi], positive to the left."""
    return repeatable.wrap(end - start)


def nearest_heading(yaw: float) -> str:
    """Return the name of the heading nearest to a yaw: a key of HEADINGS."""
    return min(HEADINGS, key=lambda name: abs(angle_between(yaw, HEADINGS[name])))


def to_frame(pose: Pose, x: Number, y: Number) -> tuple[Number, Number]:
    """Convert a point, or arrays of points, from the orchard's frame to a pose's frame, m.

    Return the metres ahead, and the metres to the left.
    """
    sine, cosine = repeatable.sin_cos(pose.yaw)
    dx = x - pose.x
    dy = y - pose.y
    return cosine * dx + sine * dy, cosine * dy - sine * dx


def from_frame(pose: Pose, ahead: Number, left: Number) -> tuple[Number, Number]:
    """Convert a point, or arrays of points, from a pose's frame to the orchard's frame, m.

    `ahead`, `left`: metres in front of the pose, and to the left of it. Return x and y.
    """
    sine, cosine = repeatable.sin_cos(pose.yaw)
    x = pose.x + cosine * ahead - sine * left
    y = pose.y + sine * ahead + cosine * left
    return x, y


def yaw_of(z: float, w: float) -> float:
    """Return the yaw of an upright body, rad, from its quaternion (0, 0, z, w)."""
    return repeatable.wrap(2.0 * repeatable.atan2(z, w))
