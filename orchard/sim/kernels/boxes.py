"""Oriented boxes on the ground, as rows of an array, for the compiled kernels of laser and physics."""

from typing import NamedTuple

import numpy as np

from orchard.sim.kernels.jit import inlined, jit, sin_cos

X, Y, HALF_LENGTH, HALF_WIDTH, COSINE, SINE, RADIUS = range(7)  # the columns: centre, half sizes, direction, circumscribed circle; m
TOUCH = 1e-9  # m; boxes that overlap by no more than this only touch


def boxes_of(centres: np.ndarray, halves: np.ndarray) -> np.ndarray:
    """(n, 7) boxes that face east, from their centres (n, 2) and half sizes (n, 2), m."""
    n = len(centres)
    radius = np.sqrt(halves[:, :1] * halves[:, :1] + halves[:, 1:] * halves[:, 1:])
    return np.hstack([centres, halves, np.ones((n, 1)), np.zeros((n, 1)), radius])


WEST, SOUTH, CELL, COLUMNS, ROWS = range(5)  # the numbers of a grid's frame


class Grid(NamedTuple):
    """Square cells over the ground, row by row from the south-west, and what belongs to each."""

    frame: np.ndarray  # (5,): west and south edge and a cell's side, m; how many columns and rows
    begin: np.ndarray  # (columns x rows + 1,) int64: cell k's boxes are begin[k] to begin[k + 1] of `members`
    members: np.ndarray  # int64: indices of boxes


def frame_of(walls: np.ndarray, cell: float) -> np.ndarray:
    """The frame of a grid that covers the ground between the outermost of walls, (w, 7) boxes that face east. Metres."""
    x, y, hx, hy = walls[:, X], walls[:, Y], walls[:, HALF_LENGTH], walls[:, HALF_WIDTH]
    west, south = float((x - hx).min()), float((y - hy).min())
    return np.array([west, south, cell, int(((x + hx).max() - west) / cell) + 1, int(((y + hy).max() - south) / cell) + 1])


def grid_of(walls: np.ndarray, reach: float, cell: float = 5.0) -> Grid:
    """For every cell the walls, (w, 7) boxes that face east, that are within a reach of some point in it. Metres."""
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
    """Where in a grid a point is; a point outside counts to the nearest cell."""
    column = min(max(int((x - frame[WEST]) / frame[CELL]), 0), int(frame[COLUMNS]) - 1)
    row = min(max(int((y - frame[SOUTH]) / frame[CELL]), 0), int(frame[ROWS]) - 1)
    return column, row


@inlined
def cell_of(grid, x, y):
    """The grid's cell at a point; of a point outside, the nearest cell, which holds all that is within its reach."""
    column, row = column_and_row(grid.frame, x, y)
    return row * int(grid.frame[COLUMNS]) + column


@jit
def sort_into_cells(boxes, solid, frame):
    """The Grid of the solid boxes by their centres, in ascending order within a cell (a counting sort).

    What is within a cell's side of a point is in the point's cell or in one of the eight around it, for whoever is outside, too:
    moving a point to the nearest cell brings no two further apart.
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
    """First and last + 1 of the members in a cell and the two beside it in its row."""
    columns = int(grid.frame[COLUMNS])
    west, east = max(column - 1, 0), min(column + 1, columns - 1)
    return grid.begin[row * columns + west], grid.begin[row * columns + east + 1]


@inlined
def circles_meet(box, boxes, k):
    """Whether the circumscribed circles of a box and of the k-th of others meet: if not, nor do the boxes."""
    dx, dy = boxes[k, X] - box[X], boxes[k, Y] - box[Y]
    reach = box[RADIUS] + boxes[k, RADIUS]
    return dx * dx + dy * dy < reach * reach


@jit
def place(pose, boxes):
    """Write poses, (n, 3), into boxes, (n, 7)."""
    for i in range(len(pose)):
        s, c = sin_cos(pose[i, 2])
        boxes[i, X] = pose[i, 0]
        boxes[i, Y] = pose[i, 1]
        boxes[i, COSINE] = c
        boxes[i, SINE] = s


@inlined
def overlap(a, b):
    """Whether two boxes overlap by more than TOUCH: no side of either has the whole other box beyond it (separating axes)."""
    dx, dy = b[X] - a[X], b[Y] - a[Y]
    cosine = abs(a[COSINE] * b[COSINE] + a[SINE] * b[SINE])
    sine = abs(a[COSINE] * b[SINE] - a[SINE] * b[COSINE])
    return _meet_along(a, b, dx, dy, cosine, sine) and _meet_along(b, a, dx, dy, cosine, sine)


@inlined
def _meet_along(a, b, dx, dy, cosine, sine):
    """Whether the shadows of two boxes on both axes of the first overlap; cosine and sine are those between them, positive."""
    ahead = abs(a[COSINE] * dx + a[SINE] * dy) - a[HALF_LENGTH] - cosine * b[HALF_LENGTH] - sine * b[HALF_WIDTH]
    aside = abs(a[COSINE] * dy - a[SINE] * dx) - a[HALF_WIDTH] - sine * b[HALF_LENGTH] - cosine * b[HALF_WIDTH]
    return ahead < -TOUCH and aside < -TOUCH


@jit
def gap(a, b):
    """Metres between two boxes, edge to edge; 0 where they overlap. Of two that do not, a corner of one is nearest to the other."""
    if overlap(a, b):
        return 0.0
    return min(_corner_gap(a, b), _corner_gap(b, a))


@jit
def _corner_gap(a, b):
    """Metres from the nearest corner of one box to another box."""
    nearest = np.inf
    for along in (-a[HALF_LENGTH], a[HALF_LENGTH]):
        for across in (-a[HALF_WIDTH], a[HALF_WIDTH]):
            dx = a[X] + along * a[COSINE] - across * a[SINE] - b[X]
            dy = a[Y] + along * a[SINE] + across * a[COSINE] - b[Y]
            out_x = max(abs(b[COSINE] * dx + b[SINE] * dy) - b[HALF_LENGTH], 0.0)
            out_y = max(abs(b[COSINE] * dy - b[SINE] * dx) - b[HALF_WIDTH], 0.0)
            nearest = min(nearest, np.sqrt(out_x * out_x + out_y * out_y))
    return nearest
