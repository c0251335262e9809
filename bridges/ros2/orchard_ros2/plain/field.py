"""The map of an orchard: its fences, trunks and posts as an occupancy grid."""

from array import array
from collections.abc import Sequence
from math import ceil, floor

from . import messages
from .messages import Message

RESOLUTION = 0.1  # m, the side of a cell
OCCUPIED = 100
NOISE = 1e-6  # cells; a wall that ends on the border of a cell is not in the next one


def grid_of(walls: Sequence[Sequence[float]]) -> Message:
    """Return the map: a cell is occupied if a wall is in any part of it.

    `walls`: as in the Orchard's `layout`: x, y of the middle, half the length along x, half the
    width along y; m, in `map`.
    """
    west, south = min(x - half for x, _, half, _ in walls), min(y - half for _, y, _, half in walls)
    width = _cells(west, west, max(x + half for x, _, half, _ in walls)).stop
    height = _cells(south, south, max(y + half for _, y, _, half in walls)).stop
    cells = array("b", bytes(width * height))
    for x, y, half_x, half_y in walls:
        columns = _cells(west, x - half_x, x + half_x)
        for row in _cells(south, y - half_y, y + half_y):
            start = row * width + columns.start
            cells[start : start + len(columns)] = array("b", [OCCUPIED]) * len(columns)
    return messages.occupancy(cells, width, RESOLUTION, west, south)


def _cells(origin: float, low: float, high: float) -> range:
    """Return the numbers of the cells from `low` to `high`; cell 0 begins at `origin`."""
    return range(
        floor((low - origin) / RESOLUTION + NOISE), ceil((high - origin) / RESOLUTION - NOISE)
    )
