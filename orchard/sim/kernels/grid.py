"""Grids of square cells over the ground, which tell the kernels which boxes are near a point."""

from typing import NamedTuple

import numpy as np

from orchard.sim.kernels.boxes import HALF_LENGTH, HALF_WIDTH, TOUCH, X, Y
from orchard.sim.kernels.jit import inlined, jit

# Indices into a grid's frame.
WEST, SOUTH, CELL, COLUMNS, ROWS = range(5)


class Grid(NamedTuple):
    """Square cells over the ground, row by row from the south-west, and the boxes of each cell."""

    # (5,): west edge, south edge and side of a cell, m; number of columns, number of rows.
    frame: np.ndarray
    # (columns x rows + 1,) int64: the boxes of cell k are members[begin[k] : begin[k + 1]].
    begin: np.ndarray
    # int64: indices of boxes.
    members: np.ndarray


def frame_of(walls: np.ndarray, cell: float) -> np.ndarray:
    """Return the frame of a grid that covers all walls, (w, 7) boxes that face east.

    `cell`: side of a cell, m.
    """
    x, y, half_x, half_y = _extents(walls)
    west = float((x - half_x).min())
    south = float((y - half_y).min())
    columns = int(((x + half_x).max() - west) / cell) + 1
    rows = int(((y + half_y).max() - south) / cell) + 1
    return np.array([west, south, cell, columns, rows])


def grid_of(walls: np.ndarray, reach: float, cell: float = 5.0) -> Grid:
    """Return the Grid of the walls, (w, 7) boxes that face east.

    A cell holds each wall within `reach` (m) of a point in the cell. `cell`: side of a cell, m;
    chosen, it changes no result.
    """
    frame = frame_of(walls, cell)
    x, y, half_x, half_y = _extents(walls)
    columns = np.arange(int(frame[COLUMNS]))[:, None]
    rows = np.arange(int(frame[ROWS]))[:, None]
    # The gaps between cells and walls, edge to edge: (columns, w) and (rows, w).
    dx = np.maximum(np.abs(x - frame[WEST] - (columns + 0.5) * cell) - half_x - cell / 2, 0.0)
    dy = np.maximum(np.abs(y - frame[SOUTH] - (rows + 0.5) * cell) - half_y - cell / 2, 0.0)
    counts = [np.zeros(1, dtype=np.int64)]
    members = []
    for gap in dy:
        column, near = np.nonzero(dx * dx + gap * gap <= reach * reach + TOUCH)
        counts.append(np.bincount(column, minlength=len(columns)))
        members.append(near)
    begin = np.cumsum(np.concatenate(counts), dtype=np.int64)
    return Grid(frame, begin, np.concatenate(members).astype(np.int64))


def _extents(walls: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return x, y and their half sizes, m, (w,) each, of boxes that face east."""
    return walls[:, X], walls[:, Y], walls[:, HALF_LENGTH], walls[:, HALF_WIDTH]


@inlined
def column_and_row(frame, x, y):
    """Return the column and row of the cell at a point (m).

    Points outside the grid are clamped to the nearest cell.
    """
    column = min(max(int((x - frame[WEST]) / frame[CELL]), 0), int(frame[COLUMNS]) - 1)
    row = min(max(int((y - frame[SOUTH]) / frame[CELL]), 0), int(frame[ROWS]) - 1)
    return column, row


@inlined
def cell_of(grid, x, y):
    """Return the index of the cell at a point (m), or of the nearest cell.

    The cell holds all boxes within its reach of the point.
    """
    column, row = column_and_row(grid.frame, x, y)
    return row * int(grid.frame[COLUMNS]) + column


def space_for(bodies: int, frame: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the arrays in which `sort_into_cells` sorts so many bodies.

    They are `cells`, `begin` and `members`.
    """
    cells = np.empty(bodies, dtype=np.int64)
    begin = np.empty(int(frame[COLUMNS]) * int(frame[ROWS]) + 2, dtype=np.int64)
    members = np.empty(bodies, dtype=np.int64)
    return cells, begin, members


@jit
def sort_into_cells(boxes, solid, frame, cells, begin, members):
    """Return the Grid of the solid boxes by their centres, in ascending order within a cell.

    boxes (n, 7); solid (n,) bool; cells, begin, members: from `space_for`, written anew. It is a
    counting sort.

    A centre within one cell side of a point is in the point's cell or in one of the eight cells
    around it. This also holds for points outside the grid: clamping to the nearest cell brings no
    two points further apart.
    """
    columns = int(frame[COLUMNS])
    # First begin[c + 2] counts the boxes of cell c. Their sums make begin[c + 1] the place of the
    # first box of cell c. Each box that is entered there moves it on, so in the end it is where
    # cell c + 1 begins, as `Grid.begin` has it.
    begin[:] = 0
    for i in range(len(boxes)):
        column, row = column_and_row(frame, boxes[i, X], boxes[i, Y])
        cells[i] = row * columns + column
        begin[cells[i] + 2] += solid[i]
    for cell in range(2, len(begin)):
        begin[cell] += begin[cell - 1]
    for i in range(len(boxes)):
        if solid[i]:
            members[begin[cells[i] + 1]] = i
            begin[cells[i] + 1] += 1
    return Grid(frame, begin[:-1], members)


@inlined
def strip(grid, column, row):
    """Return the range of `members` of a cell and its neighbours in the same row.

    It goes from the first to before the second number.
    """
    columns = int(grid.frame[COLUMNS])
    west = max(column - 1, 0)
    east = min(column + 1, columns - 1)
    return grid.begin[row * columns + west], grid.begin[row * columns + east + 1]
