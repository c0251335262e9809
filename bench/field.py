"""The field that every simulator is measured in, and what its robots do. Needs nothing but numpy: the peers' drivers read it too.

The issue's field: 100 x 64 m, fenced, 5 lines of 12 trees with 11 posts between them, N robots with 180-beam lasers.
Metres, seconds, radians; the origin is in the middle.
"""

import math
from typing import NamedTuple

import numpy as np

LENGTH, WIDTH = 100.0, 64.0  # m, between the fences' centre lines
FENCE = 1.0  # m thick
LINES, TREES = 5, 12  # lines of trees, and trees in a line; a post between every two
LINE_PITCH, TREE_PITCH = 5.5, 6.0  # m
TRUNK = 0.5  # m square, posts too
ROBOT_LENGTH, ROBOT_WIDTH = 1.0, 0.8  # m; half of the length ahead of its centre is the laser
SPEED, TURN = 1.0, 1.0  # m/s and rad/s, the most
BEAMS, RANGE, STEP = 180, 10.0, 0.1  # rays over half a turn; m; s
KEEP = 20  # steps for which a robot keeps its velocity
SEED = 6


class Field(NamedTuple):
    """Where everything is at the beginning."""

    length: float  # m along x, between the fences' centre lines
    width: float  # m along y
    walls: np.ndarray  # (w, 4): x, y, half length along x, half width along y; the four fences first
    starts: np.ndarray  # (n, 3): x, y, yaw of every robot


def field(robots: int, scale: float = 1.0) -> Field:
    """The field with so many robots at random places; `scale` stretches its sides, and trees are added as it grows."""
    length, width = LENGTH * scale, WIDTH * scale
    walls = np.array(_fences(length, width) + _trunks(round(LINES * scale), round(TREES * scale)))
    return Field(length, width, walls, _places(robots, length, width, walls))


def growing(robots: int) -> Field:
    """A field with room in proportion: as crowded as the issue's with 30 robots."""
    return field(robots, math.sqrt(robots / 30))


def velocities(robots: int, steps: int) -> np.ndarray:
    """(steps, robots, 2): the forward speeds, m/s, and turning speeds, rad/s, that robots drive with; new ones every two seconds."""
    random = np.random.default_rng(SEED + 1)
    drawn = random.uniform((-SPEED, -TURN), (SPEED, TURN), (steps // KEEP + 1, robots, 2))
    return np.repeat(drawn, KEEP, axis=0)[:steps]


def _fences(length: float, width: float) -> list[tuple[float, float, float, float]]:
    half, long, high = FENCE / 2, length / 2, width / 2
    return [(0.0, high, long + half, half), (0.0, -high, long + half, half), (-long, 0.0, half, high), (long, 0.0, half, high)]


def _trunks(lines: int, trees: int) -> list[tuple[float, float, float, float]]:
    """Trees, and posts half-way between those of a line."""
    stand = [(i - (trees - 1)) * TREE_PITCH / 2 for i in range(2 * trees - 1)]
    rows = [(i - (lines - 1) / 2) * LINE_PITCH for i in range(lines)]
    return [(x, y, TRUNK / 2, TRUNK / 2) for y in rows for x in stand]


def _places(robots: int, length: float, width: float, walls: np.ndarray) -> np.ndarray:
    """Poses whose circumscribed circles touch nothing, drawn one after another."""
    random, radius = np.random.default_rng(SEED), math.hypot(ROBOT_LENGTH, ROBOT_WIDTH) / 2
    taken = np.empty((robots, 2))
    placed = 0
    while placed < robots:
        x, y = random.uniform((-length / 2, -width / 2), (length / 2, width / 2))
        beside = np.maximum(np.abs(walls[:, :2] - (x, y)) - walls[:, 2:], 0.0)
        apart = taken[:placed] - (x, y)
        if np.all((beside**2).sum(axis=1) > radius**2) and np.all((apart**2).sum(axis=1) > 4 * radius**2):
            taken[placed] = x, y
            placed += 1
    return np.column_stack([taken, random.uniform(-math.pi, math.pi, robots)])
