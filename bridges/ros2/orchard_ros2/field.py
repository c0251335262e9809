"""The map of an orchard: its fences, trunks and posts as an occupancy grid. Figures: docs/reference.md, "The field"."""

from array import array
from collections.abc import Iterable, Mapping
from math import ceil, floor
from typing import Any

from orchard_ros2 import messages
from orchard_ros2.messages import Message

Wall = tuple[float, float, float, float]  # x, y of its middle; half its length along x, half its width along y; m, in `map`

RESOLUTION = 0.1  # m, the side of a cell
OCCUPIED = 100
NOISE = 1e-6  # cells; a wall that ends on the border of a cell is not in the next one

WEST, TOP, USUAL_EAST, USUAL_ROW = -50.0, 34.0, 50.0, 70.0  # centre lines of fences; the eastern one with rows of the usual length
HALF_FENCE, HALF_TRUNK = 0.5, 0.25
TREE_TOP_LINE, FIRST_TREE, BETWEEN, ROW_WEST, LAST_TREE = 13.5, -34.5, 3.0, -35.5, 3.0  # from a tree to the next post; to the row's end
BELOW = 21.0  # from the last line of trees to the bottom fence


def walls_of(scenario: Mapping[str, Any]) -> list[Wall]:
    """Return all that is solid and never moves, from the scenario in the reply to the scenario query."""
    length, pitch = float(scenario["row_length"]), float(scenario["row_width"]) + 2 * HALF_TRUNK
    lines = [TREE_TOP_LINE - line * pitch for line in range(int(scenario["rows"]) + 1)]
    trees = int((ROW_WEST + length - LAST_TREE - FIRST_TREE) / (2 * BETWEEN) + 1e-9) + 1
    places = [FIRST_TREE + BETWEEN * i for i in range(2 * trees - 1)]
    trunks = [(x, y, HALF_TRUNK, HALF_TRUNK) for y in lines for x in places]
    return _fences(WEST, lines[-1] - BELOW, USUAL_EAST + length - USUAL_ROW, TOP) + trunks


def _fences(west: float, south: float, east: float, north: float) -> list[Wall]:
    x, half_x = (west + east) / 2, (east - west) / 2 + HALF_FENCE
    y, half_y = (south + north) / 2, (north - south) / 2 + HALF_FENCE
    return [(x, line, half_x, HALF_FENCE) for line in (south, north)] + [(line, y, HALF_FENCE, half_y) for line in (west, east)]


def grid_of(walls: Iterable[Wall]) -> Message:
    """Return the map: a cell is occupied if a wall is in any part of it."""
    walls = list(walls)
    west, south = min(x - half for x, _, half, _ in walls), min(y - half for _, y, _, half in walls)
    width, height = (
        _cells(west, max(x + half for x, _, half, _ in walls)).stop,
        _cells(south, max(y + half for _, y, _, half in walls)).stop,
    )
    cells = array("b", bytes(width * height))
    for x, y, half_x, half_y in walls:
        columns = _cells(west, x + half_x, x - half_x)
        for row in _cells(south, y + half_y, y - half_y):
            start = row * width + columns.start
            cells[start : start + len(columns)] = array("b", [OCCUPIED]) * len(columns)
    return messages.occupancy(cells, width, RESOLUTION, west, south)


def _cells(origin: float, high: float, low: float | None = None) -> range:
    """Return the numbers of the cells from `low` to `high`, of those that begin at `origin`."""
    first = 0 if low is None else floor((low - origin) / RESOLUTION + NOISE)
    return range(first, ceil((high - origin) / RESOLUTION - NOISE))
