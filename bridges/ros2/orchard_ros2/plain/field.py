"""The map of an orchard: its fences, trunks and posts as an occupancy grid."""

from array import array
from collections.abc import Sequence
from math import ceil, floor

from . import messages
from .messages import Message

# Side of a cell, m.
RESOLUTION = 0.1
OCCUPIED = 100
# Cells by which a wall may pass the border of a cell without being in the next one.
NOISE = 1e-6


def grid_of(walls: Sequence[Sequence[float]]) -> Message:
    """Return the map: a cell is occupied if a wall is in any part of it.

    `walls`: as in the Orchard's `layout`: x, y of the middle, half the length along x, half the
    width along y; m, in `map`.
    """
    west = min(x - half_x for x, _, half_x, _ in walls)
    east = max(x + half_x for x, _, half_x, _ in walls)
    south = min(y - half_y for _, y, _, half_y in walls)
    north = max(y + half_y for _, y, _, half_y in walls)
    width = _cells(west, west, east).stop
    height = _cells(south, south, north).stop
    cells = array("b", bytes(width * height))
    for x, y, half_x, half_y in walls:
        columns = _cells(west, x - half_x, x + half_x)
        for row in _cells(south, y - half_y, y + half_y):
            start = row * width + columns.start
            cells[start : start + len(columns)] = array("b", [OCCUPIED]) * len(columns)
    return messages.occupancy(cells, width, RESOLUTION, west, south)


def _cells(origin: float, low: float, high: float) -> range:
    """Return the numbers of the cells from `low` to `high`; cell 0 begins at `origin`."""
    first = floor((low - origin) / RESOLUTION + NOISE)
    stop = ceil((high - origin) / RESOLUTION - NOISE)
    return range(first, stop)
