"""Oriented boxes on the ground, as rows of an array, for the kernels of laser and physics.

A box has seven columns: its centre, its half sizes, cosine and sine of its heading, and the radius
of its circumscribed circle. Lengths are in m, in the orchard's frame. Bodies are boxes, and so are
walls: fences, trunks and posts.
"""

import numpy as np

from orchard.sim.kernels.jit import inlined, jit, sin_cos

X, Y, HALF_LENGTH, HALF_WIDTH, COSINE, SINE, RADIUS = range(7)
# m. Boxes that overlap by at most this only touch: far more than rounding, and far less than
# matters.
TOUCH = 1e-9


def boxes_of(centres: np.ndarray, halves: np.ndarray) -> np.ndarray:
    """Return (n, 7) boxes that face east, from their centres (n, 2) and half sizes (n, 2), m."""
    n = len(centres)
    radius = np.sqrt(halves[:, :1] * halves[:, :1] + halves[:, 1:] * halves[:, 1:])
    return np.hstack([centres, halves, np.ones((n, 1)), np.zeros((n, 1)), radius])


@inlined
def circles_meet(box, boxes, k):
    """Whether the circumscribed circles of `box` and boxes[k] overlap.

    If they do not, neither do the boxes.
    """
    dx = boxes[k, X] - box[X]
    dy = boxes[k, Y] - box[Y]
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
    dx = b[X] - a[X]
    dy = b[Y] - a[Y]
    cosine = abs(a[COSINE] * b[COSINE] + a[SINE] * b[SINE])
    sine = abs(a[COSINE] * b[SINE] - a[SINE] * b[COSINE])
    return _meet_along(a, b, dx, dy, cosine, sine) and _meet_along(b, a, dx, dy, cosine, sine)


@inlined
def _meet_along(a, b, dx, dy, cosine, sine):
    """Whether the projections of two boxes on both axes of `a` overlap.

    (dx, dy): from one centre to the other; its sign does not matter. cosine, sine: of the angle
    between the boxes, absolute.
    """
    gap_along = (
        abs(a[COSINE] * dx + a[SINE] * dy)
        - a[HALF_LENGTH]
        - cosine * b[HALF_LENGTH]
        - sine * b[HALF_WIDTH]
    )
    gap_across = (
        abs(a[COSINE] * dy - a[SINE] * dx)
        - a[HALF_WIDTH]
        - sine * b[HALF_LENGTH]
        - cosine * b[HALF_WIDTH]
    )
    return gap_along < -TOUCH and gap_across < -TOUCH


@jit
def gap(a, b):
    """Return the distance between two boxes, edge to edge, m; 0 if they overlap."""
    if overlap(a, b):
        return 0.0
    # The nearest point of one of them is a corner.
    return min(_corner_gap(a, b), _corner_gap(b, a))


@jit
def _corner_gap(a, b):
    """Return the distance of the nearest corner of `a` from box `b`, m; 0 if it is inside."""
    nearest = np.inf
    for along in (-a[HALF_LENGTH], a[HALF_LENGTH]):
        for across in (-a[HALF_WIDTH], a[HALF_WIDTH]):
            dx = a[X] + along * a[COSINE] - across * a[SINE] - b[X]
            dy = a[Y] + along * a[SINE] + across * a[COSINE] - b[Y]
            out_x = max(abs(b[COSINE] * dx + b[SINE] * dy) - b[HALF_LENGTH], 0.0)
            out_y = max(abs(b[COSINE] * dy - b[SINE] * dx) - b[HALF_WIDTH], 0.0)
            nearest = min(nearest, np.sqrt(out_x * out_x + out_y * out_y))
    return nearest
