"""Oriented boxes on the ground, as rows of an array, for the compiled kernels of laser and physics."""

import numpy as np

from orchard.compiled import jit, sin_cos

X, Y, HALF_LENGTH, HALF_WIDTH, COSINE, SINE, RADIUS = range(7)  # the columns: centre, half sizes, direction, circumscribed circle; m
TOUCH = 1e-9  # m; boxes that overlap by no more than this only touch


def boxes_of(centres: np.ndarray, halves: np.ndarray) -> np.ndarray:
    """(n, 7) boxes that face east, from their centres (n, 2) and half sizes (n, 2), m."""
    n = len(centres)
    radius = np.sqrt(halves[:, :1] * halves[:, :1] + halves[:, 1:] * halves[:, 1:])
    return np.hstack([centres, halves, np.ones((n, 1)), np.zeros((n, 1)), radius])


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
    reach = a[RADIUS] + b[RADIUS]
    if dx * dx + dy * dy >= reach * reach:
        return False
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
