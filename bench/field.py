"""The field in which all simulators are measured, and the velocities of its robots.

It needs only numpy: the peers' drivers import it.

The field of issue 6: 100 x 64 m, fenced, 5 lines of 12 trees with 11 posts between them, N robots
with 180-beam lasers. Units are metres, seconds and radians; the origin is in the middle of the
field.
"""

import math
from typing import NamedTuple

import numpy as np

LENGTH, WIDTH = 100.0, 64.0  # m, between the centre lines of the fences
FENCE = 1.0  # m, thickness
LINES, TREES = (
    5,
    12,
)  # lines of trees, and trees in a line; a post stands between neighbouring trees
LINE_PITCH, TREE_PITCH = 5.5, 6.0  # m
TRUNK = 0.5  # m, side of the square trunk of a tree, and of a post
ROBOT_LENGTH, ROBOT_WIDTH = 1.0, 0.8  # m; the laser is at the middle of the front side
SPEED, TURN = 1.0, 1.0  # m/s and rad/s, the limits
BEAMS, RANGE, STEP = 180, 10.0, 0.1  # beams over half a turn; m; s
KEEP = 20  # steps, after which each robot gets a new velocity
SEED = 6


class Field(NamedTuple):
    """The state of the field at the beginning."""

    length: float  # m along x, between the centre lines of the fences
    width: float  # m along y
    walls: (
        np.ndarray
    )  # (w, 4), m: x, y, half length along x, half width along y; the four fences first
    starts: np.ndarray  # (n, 3): x, y (m) and yaw (rad) of each robot


def field(robots: int, scale: float = 1.0) -> Field:
    """Return the field with robots at random poses.

    `scale` multiplies the sides of the field and the numbers of lines and of trees.
    """
    length, width = LENGTH * scale, WIDTH * scale
    walls = np.array(_fences(length, width) + _trunks(round(LINES * scale), round(TREES * scale)))
    return Field(length, width, walls, _places(robots, length, width, walls))


def growing(robots: int) -> Field:
    """Return a field whose area grows with the robots: it is as crowded as the normal field with 30
    robots.
    """
    return field(robots, math.sqrt(robots / 30))


def velocities(robots: int, steps: int) -> np.ndarray:
    """Return forward speeds, m/s, and turning speeds, rad/s, of the robots: (steps, robots, 2).

    They change every two seconds.
    """
    random = np.random.default_rng(SEED + 1)
    drawn = random.uniform((-SPEED, -TURN), (SPEED, TURN), (steps // KEEP + 1, robots, 2))
    return np.repeat(drawn, KEEP, axis=0)[:steps]


def _fences(length: float, width: float) -> list[tuple[float, float, float, float]]:
    half, long, high = FENCE / 2, length / 2, width / 2
    return [
        (0.0, high, long + half, half),
        (0.0, -high, long + half, half),
        (-long, 0.0, half, high),
        (long, 0.0, half, high),
    ]


def _trunks(lines: int, trees: int) -> list[tuple[float, float, float, float]]:
    """The trees, and the posts half-way between two trees of a line."""
    columns = [(i - (trees - 1)) * TREE_PITCH / 2 for i in range(2 * trees - 1)]
    rows = [(i - (lines - 1) / 2) * LINE_PITCH for i in range(lines)]
    return [(x, y, TRUNK / 2, TRUNK / 2) for y in rows for x in columns]


def _places(robots: int, length: float, width: float, walls: np.ndarray) -> np.ndarray:
    """Random poses whose circumscribed circles touch no wall and no other robot."""
    random, radius = np.random.default_rng(SEED), math.hypot(ROBOT_LENGTH, ROBOT_WIDTH) / 2
    centres = np.empty((robots, 2))
    placed = 0
    while placed < robots:
        x, y = random.uniform((-length / 2, -width / 2), (length / 2, width / 2))
        to_walls = np.maximum(np.abs(walls[:, :2] - (x, y)) - walls[:, 2:], 0.0)
        to_others = centres[:placed] - (x, y)
        if np.all((to_walls**2).sum(axis=1) > radius**2) and np.all(
            (to_others**2).sum(axis=1) > 4 * radius**2
        ):
            centres[placed] = x, y
            placed += 1
    return np.column_stack([centres, random.uniform(-math.pi, math.pi, robots)])
