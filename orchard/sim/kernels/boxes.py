"""Oriented boxes on the ground, as rows of an array, for the kernels of laser and physics."""
# DOC """The overlaps of bodies, for the check of the invariants. Arrays have one row per body; SI units."""

from typing import NamedTuple

import numpy as np

from orchard.sim.kernels.jit import inlined, jit, sin_cos

X, Y, HALF_LENGTH, HALF_WIDTH, COSINE, SINE, RADIUS = range(7)  # columns: centre, half sizes, heading, circumscribed circle; m
TOUCH = 1e-9  # m; boxes that overlap by at most this only touch


def boxes_of(centres: np.ndarray, halves: np.ndarray) -> np.ndarray:
    """Return (n, 7) boxes that face east, from their centres (n, 2) and half sizes (n, 2), m."""
    n = len(centres)
    radius = np.sqrt(halves[:, :1] * halves[:, :1] + halves[:, 1:] * halves[:, 1:])
    return np.hstack([centres, halves, np.ones((n, 1)), np.zeros((n, 1)), radius])


WEST, SOUTH, CELL, COLUMNS, ROWS = range(5)  # indices into a grid's frame


class Grid(NamedTuple):
    """Square cells over the ground, row by row from the south-west, and the boxes of each cell."""

    frame: np.ndarray  # (5,): west edge, south edge and side of a cell, m; number of columns, number of rows
    begin: np.ndarray  # (columns x rows + 1,) int64: the boxes of cell k are members[begin[k] : begin[k + 1]]
    members: np.ndarray  # int64: indices of boxes


def frame_of(walls: np.ndarray, cell: float) -> np.ndarray:
    """Return the frame of a grid that covers all walls, (w, 7) boxes that face east. `cell`: side of a cell, m."""
    x, y, hx, hy = walls[:, X], walls[:, Y], walls[:, HALF_LENGTH], walls[:, HALF_WIDTH]
    west, south = float((x - hx).min()), float((y - hy).min())
    return np.array([west, south, cell, int(((x + hx).max() - west) / cell) + 1, int(((y + hy).max() - south) / cell) + 1])


def grid_of(walls: np.ndarray, reach: float, cell: float = 5.0) -> Grid:
    """Return the Grid of the walls, (w, 7) boxes that face east. A cell holds each wall within `reach` (m) of a point in the cell."""
    frame = frame_of(walls, cell)
    x, y, hx, hy = walls[:, X], walls[:, Y], walls[:, HALF_LENGTH], walls[:, HALF_WIDTH]
    near = []
    for row in range(int(frame[ROWS])):
        for column in range(int(frame[COLUMNS])):
            dx = np.maximum(np.abs(x - frame[WEST] - (column + 0.5) * cell) - hx - cell / 2, 0.0)
            dy = np.maximum(np.abs(y - frame[SOUTH] - (row + 0.5) * cell) - hy - cell / 2, 0.0)
            near.append(np.flatnonzero(dx * dx + dy * dy <= reach * reach + TOUCH))
    begin = np.cumsum([0] + [len(members) for members in near], dtype=np.int64)
    return Grid(frame, begin, np.concatenate(near).astype(np.int64))


@inlined
def column_and_row(frame, x, y):
    """Return the column and row of the cell at a point (m). Points outside the grid are clamped to the nearest cell."""
    column = min(max(int((x - frame[WEST]) / frame[CELL]), 0), int(frame[COLUMNS]) - 1)
    row = min(max(int((y - frame[SOUTH]) / frame[CELL]), 0), int(frame[ROWS]) - 1)
    return column, row


@inlined
def cell_of(grid, x, y):
    """Return the index of the cell at a point (m).

    Points outside the grid are clamped to the nearest cell, which holds all boxes within its reach of them.
    """
    column, row = column_and_row(grid.frame, x, y)
    return row * int(grid.frame[COLUMNS]) + column


@jit
def sort_into_cells(boxes, solid, frame):
    """Return the Grid of the solid boxes by their centres, in ascending order within a cell (a counting sort).

    boxes (n, 7); solid (n,) bool. A centre within one cell side of a point is in the point's cell or in one of the eight cells
    around it. This also holds for points outside the grid: clamping to the nearest cell brings no two points further apart.
    """
    columns = int(frame[COLUMNS])
    cells = np.empty(len(boxes), np.int64)
    begin = np.zeros(columns * int(frame[ROWS]) + 2, np.int64)
    for i in range(len(boxes)):
        column, row = column_and_row(frame, boxes[i, X], boxes[i, Y])
        cells[i] = row * columns + column
        begin[cells[i] + 2] += solid[i]
    for cell in range(2, len(begin)):
        begin[cell] += begin[cell - 1]
    members = np.empty(begin[-1], np.int64)
    for i in range(len(boxes)):
        if solid[i]:
            members[begin[cells[i] + 1]] = i
            begin[cells[i] + 1] += 1
    return Grid(frame, begin[:-1], members)


@inlined
def strip(grid, column, row):
    """Return the range of `members`, first and last + 1, of a cell and its neighbours in the same row."""
    columns = int(grid.frame[COLUMNS])
    west, east = max(column - 1, 0), min(column + 1, columns - 1)
    return grid.begin[row * columns + west], grid.begin[row * columns + east + 1]


@inlined
def circles_meet(box, boxes, k):
    """Whether the circumscribed circles of `box` and boxes[k] overlap; if not, the boxes do not overlap either."""
    dx, dy = boxes[k, X] - box[X], boxes[k, Y] - box[Y]
    reach = box[RADIUS] + boxes[k, RADIUS]
    return dx * dx + dy * dy < reach * reach


@jit
def place(pose, boxes):
    """Write poses, (n, 3), m and rad, into boxes, (n, 7)."""
    for i in range(len(pose)):
        s, c = sin_cos(pose[i, 2])
        boxes[i, X] = pose[i, 0]
        boxes[i, Y] = pose[i, 1]
        boxes[i, COSINE] = c
        boxes[i, SINE] = s


@inlined
def overlap(a, b):
    """Whether two boxes overlap by more than TOUCH (separating axis test)."""
    dx, dy = b[X] - a[X], b[Y] - a[Y]
    cosine = abs(a[COSINE] * b[COSINE] + a[SINE] * b[SINE])
    sine = abs(a[COSINE] * b[SINE] - a[SINE] * b[COSINE])
    return _meet_along(a, b, dx, dy, cosine, sine) and _meet_along(b, a, dx, dy, cosine, sine)


@inlined
def _meet_along(a, b, dx, dy, cosine, sine):
    """Whether the projections of two boxes on both axes of `a` overlap; cosine and sine: of the angle between them, absolute."""
    ahead = abs(a[COSINE] * dx + a[SINE] * dy) - a[HALF_LENGTH] - cosine * b[HALF_LENGTH] - sine * b[HALF_WIDTH]
    aside = abs(a[COSINE] * dy - a[SINE] * dx) - a[HALF_WIDTH] - sine * b[HALF_LENGTH] - cosine * b[HALF_WIDTH]
    return ahead < -TOUCH and aside < -TOUCH


@jit
def gap(a, b):
    """Return the distance between two boxes, edge to edge, m; 0 if they overlap.

    For boxes that do not overlap, it is the distance of a corner of one box from the other box.
    """
    if overlap(a, b):
        return 0.0
    return min(_corner_gap(a, b), _corner_gap(b, a))


@jit
def _corner_gap(a, b):
    """The distance of the nearest corner of `a` from `b`, m."""
    nearest = np.inf
    for along in (-a[HALF_LENGTH], a[HALF_LENGTH]):
        for across in (-a[HALF_WIDTH], a[HALF_WIDTH]):
            dx = a[X] + along * a[COSINE] - across * a[SINE] - b[X]
            dy = a[Y] + along * a[SINE] + across * a[COSINE] - b[Y]
            out_x = max(abs(b[COSINE] * dx + b[SINE] * dy) - b[HALF_LENGTH], 0.0)
            out_y = max(abs(b[COSINE] * dy - b[SINE] * dx) - b[HALF_WIDTH], 0.0)
            nearest = min(nearest, np.sqrt(out_x * out_x + out_y * out_y))
    return nearest


@jit
def overlaps(pose, shapes, solid, walls, wall_frame, wall_begin, wall_members):
    """Return the overlaps of solid bodies with later bodies and with walls, (c, 2) int64: a body's index, and a body's or n + a wall's.

    pose (n, 3); shapes (n, 7) and walls (w, 7): boxes; wall_...: the fields of the walls' Grid.
    Of several bodies that overlap one body, only the first is returned; the same holds for walls.
    """
    n, boxes, grid = len(pose), shapes.copy(), Grid(wall_frame, wall_begin, wall_members)
    place(pose, boxes)
    found, count = np.empty((2 * n, 2), np.int64), 0
    for i in range(n):
        if not solid[i]:
            continue
        for j in range(i + 1, n):
            if solid[j] and circles_meet(boxes[i], boxes, j) and overlap(boxes[i], boxes[j]):
                found[count, 0], found[count, 1] = i, j
                count += 1
                break
        cell = cell_of(grid, boxes[i, X], boxes[i, Y])
        for k in grid.members[grid.begin[cell] : grid.begin[cell + 1]]:
            if circles_meet(boxes[i], walls, k) and overlap(boxes[i], walls[k]):
                found[count, 0], found[count, 1] = i, n + k
                count += 1
                break
    return found[:count]
