"""The field in which all simulators are measured, and the velocities of its robots.

It needs only numpy: the peers' drivers import it.

The field of issue 6: 100 x 64 m, fenced, 5 lines of 12 trees with 11 posts between them, N robots
with 180-beam lasers. Units are metres, seconds and radians; the origin is in the middle of the
field.
"""

import math
from typing import NamedTuple

import numpy as np

# m, between the centre lines of the fences.
LENGTH = 100.0
WIDTH = 64.0
FENCE = 1.0  # m, thickness
# Lines of trees, and trees in a line. A post stands between two trees of a line.
LINES = 5
TREES = 12
# m from a line of trees to the next, and from a tree to the next.
LINE_PITCH = 5.5
TREE_PITCH = 6.0
TRUNK = 0.5  # m, side of the square trunk of a tree, and of a post
# m, of a robot. Its laser is at the middle of the front side.
ROBOT_LENGTH = 1.0
ROBOT_WIDTH = 0.8
SPEED = 1.0  # m/s, the limit
TURN = 1.0  # rad/s, the limit
BEAMS = 180  # of a laser, over half a turn
RANGE = 10.0  # m
STEP = 0.1  # s
KEEP = 20  # steps, after which each robot gets a new velocity
SEED = 6
USUAL_ROBOTS = 30


class Field(NamedTuple):
    """The state of the field at the beginning."""

    length: float  # m along x, between the centre lines of the fences
    width: float  # m along y
    # (w, 4), m: x, y, half length along x, half width along y; the four fences first.
    walls: np.ndarray
    starts: np.ndarray  # (n, 3): x, y (m) and yaw (rad) of each robot


def field(robots: int, scale: float = 1.0) -> Field:
    """Return the field with robots at random poses.

    `scale` multiplies the sides of the field and the numbers of lines and of trees.
    """
    length = LENGTH * scale
    width = WIDTH * scale
    walls = np.array(_fences(length, width) + _trunks(round(LINES * scale), round(TREES * scale)))
    return Field(length, width, walls, _places(robots, length, width, walls))


def growing(robots: int) -> Field:
    """Return a field whose area grows with the robots: it is as crowded as the normal field with 30
    robots.
    """
    return field(robots, math.sqrt(robots / USUAL_ROBOTS))


def velocities(robots: int, steps: int) -> np.ndarray:
    """Return forward speeds, m/s, and turning speeds, rad/s, of the robots: (steps, robots, 2).

    They change every two seconds. The speeds and rates are drawn evenly between their limits.
    """
    random = np.random.default_rng(SEED + 1)
    drawn = random.uniform((-SPEED, -TURN), (SPEED, TURN), (steps // KEEP + 1, robots, 2))
    return np.repeat(drawn, KEEP, axis=0)[:steps]


def _fences(length: float, width: float) -> list[tuple[float, float, float, float]]:
    """Return the fences in the north, south, west and east, as in `Field.walls`."""
    thick = FENCE / 2
    east = length / 2
    north = width / 2
    return [
        (0.0, north, east + thick, thick),
        (0.0, -north, east + thick, thick),
        (-east, 0.0, thick, north),
        (east, 0.0, thick, north),
    ]


def _trunks(lines: int, trees: int) -> list[tuple[float, float, float, float]]:
    """Return the trees, and the posts half-way between two trees of a line."""
    # Around the middle of the field: x of trees and posts in turns, and y of the lines.
    columns = [(i - (trees - 1)) * TREE_PITCH / 2 for i in range(2 * trees - 1)]
    rows = [(i - (lines - 1) / 2) * LINE_PITCH for i in range(lines)]
    return [(x, y, TRUNK / 2, TRUNK / 2) for y in rows for x in columns]


def _places(robots: int, length: float, width: float, walls: np.ndarray) -> np.ndarray:
    """Return random poses, (robots, 3), at which the circle around a robot touches no wall and no
    circle of another robot.
    """
    random = np.random.default_rng(SEED)
    radius = math.hypot(ROBOT_LENGTH, ROBOT_WIDTH) / 2
    centres = np.empty((robots, 2))
    placed = 0
    while placed < robots:
        x, y = random.uniform((-length / 2, -width / 2), (length / 2, width / 2))
        to_walls = np.maximum(np.abs(walls[:, :2] - (x, y)) - walls[:, 2:], 0.0)
        to_others = centres[:placed] - (x, y)
        is_off_walls = np.all((to_walls**2).sum(axis=1) > radius**2)
        is_off_others = np.all((to_others**2).sum(axis=1) > (2 * radius) ** 2)
        if is_off_walls and is_off_others:
            centres[placed] = x, y
            placed += 1
    return np.column_stack([centres, random.uniform(-math.pi, math.pi, robots)])
