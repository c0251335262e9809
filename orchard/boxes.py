"""Oriented boxes on the ground, as rows of an array, for the compiled kernels of laser and physics."""

from typing import NamedTuple

import numpy as np

from orchard.compiled import jit, sin_cos

X, Y, HALF_LENGTH, HALF_WIDTH, COSINE, SINE, RADIUS = range(7)  # the columns: centre, half sizes, direction, circumscribed circle; m
TOUCH = 1e-9  # m; boxes that overlap by no more than this only touch


def boxes_of(centres: np.ndarray, halves: np.ndarray) -> np.ndarray:
    """(n, 7) boxes that face east, from their centres (n, 2) and half sizes (n, 2), m."""
    n = len(centres)
    radius = np.sqrt(halves[:, :1] * halves[:, :1] + halves[:, 1:] * halves[:, 1:])
    return np.hstack([centres, halves, np.ones((n, 1)), np.zeros((n, 1)), radius])


class Grid(NamedTuple):
    """For every cell of the ground, the walls that are within a certain reach of a point in it."""

    west: float
    south: float
    cell: float  # m
    columns: int
    rows: int
    begin: np.ndarray  # (columns x rows + 1,) int64: cell k's walls are begin[k] to begin[k + 1] of `members`
    members: np.ndarray  # int64: indices of walls


def grid_of(walls: np.ndarray, reach: float, cell: float = 5.0) -> Grid:
    """The grid over walls, (w, 7) boxes that face east; it covers the ground between the outermost of them. Metres."""
    x, y, hx, hy = walls[:, X], walls[:, Y], walls[:, HALF_LENGTH], walls[:, HALF_WIDTH]
    west, south = float((x - hx).min()), float((y - hy).min())
    columns, rows = int(((x + hx).max() - west) / cell) + 1, int(((y + hy).max() - south) / cell) + 1
    near = []
    for row in range(rows):
        for column in range(columns):
            dx = np.maximum(np.abs(x - west - (column + 0.5) * cell) - hx - cell / 2, 0.0)
            dy = np.maximum(np.abs(y - south - (row + 0.5) * cell) - hy - cell / 2, 0.0)
            near.append(np.flatnonzero(dx * dx + dy * dy <= reach * reach + TOUCH))
    begin = np.cumsum([0] + [len(members) for members in near], dtype=np.int64)
    return Grid(west, south, cell, columns, rows, begin, np.concatenate(near).astype(np.int64))


@jit
def cell_of(grid, x, y):
    """The grid's cell at a point; of a point outside, the nearest cell, which holds all that is within its reach."""
    column = min(max(int((x - grid.west) / grid.cell), 0), grid.columns - 1)
    row = min(max(int((y - grid.south) / grid.cell), 0), grid.rows - 1)
    return row * grid.columns + column


@jit
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


@jit
def overlap(a, b):
    """Whether two boxes overlap by more than TOUCH: no side of either has the whole other box beyond it (separating axes)."""
    dx, dy = b[X] - a[X], b[Y] - a[Y]
    cosine = abs(a[COSINE] * b[COSINE] + a[SINE] * b[SINE])
    sine = abs(a[COSINE] * b[SINE] - a[SINE] * b[COSINE])
    return _meet_along(a, b, dx, dy, cosine, sine) and _meet_along(b, a, dx, dy, cosine, sine)


@jit
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
