"""What stands still in an orchard: fences around it, and trees and posts in their lines.

Metres, in the frame `map`.
"""

from functools import lru_cache

import numpy as np

from orchard.field.geometry import Rect
from orchard.field.lanes import TreeLine
from orchard.field.survey import TRUNK

FENCE_THICKNESS = 1.0
FENCE_HEIGHT = 2.5
# Orchards whose walls are kept. All seeds of an orchard have the same ones.
KEPT_WALLS = 8

# x, y of the centre, half length along x, half width along y, m.
Box = tuple[float, float, float, float]


@lru_cache(maxsize=KEPT_WALLS)
def walls_of(lines: tuple[TreeLine, ...], fences: Rect) -> np.ndarray:
    """Return all fences, trees and posts as boxes, (n, 4), the columns of `Box`; read-only.

    `lines`: of trees. `fences`: the rectangle of their centre lines.
    """
    walls = np.array(_fences(fences) + _trunks_and_posts(lines))
    walls.setflags(write=False)
    return walls


def _fences(along: Rect) -> list[Box]:
    """Return the fences in the north, south, west and east."""
    half = FENCE_THICKNESS / 2
    middle_x = (along.west + along.east) / 2
    middle_y = (along.north + along.south) / 2
    half_width = (along.east - along.west) / 2 + half
    half_height = (along.north - along.south) / 2 + half
    return [
        (middle_x, along.north, half_width, half),
        (middle_x, along.south, half_width, half),
        (along.west, middle_y, half, half_height),
        (along.east, middle_y, half, half_height),
    ]


def _trunks_and_posts(lines: tuple[TreeLine, ...]) -> list[Box]:
    """Return the trees and posts of all lines, line by line from the west."""
    boxes = []
    for line in lines:
        for x in sorted(line.trees_x + line.posts_x):
            boxes.append((x, line.y, TRUNK / 2, TRUNK / 2))
    return boxes
