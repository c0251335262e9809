"""The inner loops of physics: limits and movement. `orchard.sim.physics` calls `advance`.

Arrays have one row for each body, in the order in which bodies move. Poses are in the orchard's
frame, velocities in the body's frame. SI units.
"""

from typing import NamedTuple

import numpy as np

from orchard.field.ticks import TIME_STEP
from orchard.sim.kernels.boxes import (
    COSINE,
    HALF_LENGTH,
    HALF_WIDTH,
    RADIUS,
    SINE,
    TOUCH,
    X,
    Y,
    circles_meet,
    overlap,
    place,
)
from orchard.sim.kernels.grid import ROWS, Grid, cell_of, column_and_row, sort_into_cells, strip
from orchard.sim.kernels.jit import allocating, inlined, jit, sin_cos, wrap
from orchard.sim.kernels.picking import NONE, Rows, full_bins, keep_pace, pick

# m. A robot cannot move to a pose where its coupled bin would be further than this from the
# coupling point. It is more than a bin, which learns a tick later that its robot turns or drives
# on, is off behind the fastest robot of a scenario: 0.344 m (2.5 m/s, 60 degrees/s).
BAR = 0.35


class Bodies(NamedTuple):
    """The n bodies, as `move_all` needs and changes them."""

    # (n, 3) m, m, rad.
    pose: np.ndarray
    # (n, 3) m/s, m/s, rad/s.
    twist: np.ndarray
    # (n,) index of the body at the other end of the bar, or NONE.
    coupled: np.ndarray
    # (n,) m from the centre back to the centre of the coupled bin; 0: it tows nothing.
    tows: np.ndarray
    # (n,) m that each has driven.
    distance: np.ndarray
    # (n,) number of collisions that each began.
    collisions: np.ndarray
    # (n,) number of steps that the coupled bin did not allow.
    refused: np.ndarray
    # (n,) whether the last step met an obstacle.
    blocked: np.ndarray
    # (n,) the obstacle with which a collision begins at this step: a body's index, n + a wall's
    # index, or NONE.
    met: np.ndarray


class Solids(NamedTuple):
    """Boxes, and the Grid that tells which of them are near a point."""

    # (k, 7).
    boxes: np.ndarray
    grid: Grid


@jit
def advance(
    wanted, twist, pose, stopped, coupled, fill, pickers, speed, turn, sideways, shapes, tows,
    solid, walls, wall_frame, wall_begin, wall_members, body_frame, bin_full, bin_least, row_share,
    row_west, row_length, row_y, stretch_begin, stretch_east, stretch_speed, row_ends, distance,
    collisions, refused, blocked, pick_from, boxes, cells, cell_begin, cell_members, met,
    picked_from, before, full,
):  # fmt: skip
    """Do one time step of all bodies: limit the wanted twists, (n, 3), move the bodies, and pick.

    It is one kernel, because each call of a kernel costs time. `boxes` begins as a copy of
    `shapes`, and gets the poses of all bodies in each step. `cells`, `cell_...`, `before` and
    `full` are space to work in. `pick_from`, (n,): x from which on a picker picks, or ANYWHERE.
    `move_all` and `pick` write `met` and `picked_from`.
    Return whether anything happened of which there may be an event: a collision began, a row is
    picked, a bin is full.
    """
    rows = Rows(
        bin_full,
        row_share,
        row_west,
        row_length,
        row_y,
        stretch_begin,
        stretch_east,
        stretch_speed,
        row_ends,
    )
    limit(wanted, stopped, speed, coupled, turn, sideways, twist)
    keep_pace(pickers, twist, pose, coupled, fill, rows, pick_from)
    for k in range(len(pickers)):
        before[k] = pose[pickers[k], 0]
    place(pose, boxes)
    body_grid = sort_into_cells(boxes, solid, body_frame, cells, cell_begin, cell_members)
    bodies = Bodies(pose, twist, coupled, tows, distance, collisions, refused, blocked, met)
    obstacles = Solids(walls, Grid(wall_frame, wall_begin, wall_members))
    is_eventful = move_all(bodies, Solids(boxes, body_grid), obstacles)
    is_eventful |= pick(pickers, before, pose, coupled, rows, fill, pick_from, picked_from)
    full_bins(fill, coupled, pickers, bin_full, bin_least, full)
    for is_full in full:
        is_eventful |= is_full
    return is_eventful


# -- movement


@inlined
def limit(wanted, stopped, speed, coupled, turn, sideways, twists):
    """Write into twists, (n, 3), the wanted twists within each body's limits.

    speed (n,) m/s; turn (n,) rad/s. A body that is stopped stands, as one that wants no number, and
    a bin that is not coupled. `sideways`, (n,) bool: bodies that can move to their left and right.
    """
    for i in range(len(wanted)):
        is_loose_bin = sideways[i] and coupled[i] == NONE
        if stopped[i] or is_loose_bin or not _is_finite(wanted[i]):
            twists[i, :] = 0.0
            continue
        forward = _clamp(wanted[i, 0], speed[i])
        left = 0.0
        if sideways[i]:
            left = _clamp(wanted[i, 1], speed[i])
        together = np.sqrt(forward * forward + left * left)
        share = 1.0
        if together > speed[i]:
            share = speed[i] / together
        twists[i, 0] = forward * share
        twists[i, 1] = left * share
        twists[i, 2] = _clamp(wanted[i, 2], turn[i])


@inlined
def _is_finite(twist):
    """Whether a twist consists of numbers."""
    return np.isfinite(twist[0]) and np.isfinite(twist[1]) and np.isfinite(twist[2])


@inlined
def _clamp(value, most):
    """Return the value between -most and most that is nearest to a value."""
    return min(max(value, -most), most)


@jit
def arc(x, y, yaw, forward, left, turn, seconds):
    """Return the pose (x, y, yaw) after a constant twist.

    This is the exponential of SE(2), by the chord of its arc.
    """
    half = 0.5 * turn * seconds
    s, c = sin_cos(yaw + half)
    length = seconds
    if half != 0.0:
        length = seconds * (sin_cos(half)[0] / half)
    return (
        x + length * (c * forward - s * left),
        y + length * (s * forward + c * left),
        wrap(yaw + turn * seconds),
    )


@inlined
def move_all(bodies, solids, walls):
    """Move the bodies for one time step, one after another, each if nothing solid is in its way.

    A body that cannot move gets the twist 0. `solids`: the Solids of the bodies at their poses;
    `walls`: those of the walls. Return whether a collision begins; bodies.met says which.
    """
    begins = False
    for i in range(len(bodies.pose)):
        obstacle = _move_one(i, bodies, solids, walls)
        # A body that was blocked by its last step is in the same collision still.
        bodies.met[i] = NONE if bodies.blocked[i] else obstacle
        bodies.collisions[i] += bodies.met[i] != NONE
        begins |= bodies.met[i] != NONE
        bodies.blocked[i] = obstacle != NONE
    return begins


@inlined
def _move_one(i, bodies, solids, walls):
    """Move one body, if it can; return its obstacle, or NONE."""
    pose = bodies.pose
    forward, left, turn = bodies.twist[i, 0], bodies.twist[i, 1], bodies.twist[i, 2]
    if forward == 0.0 and left == 0.0 and turn == 0.0:
        return NONE
    x, y, yaw = arc(pose[i, 0], pose[i, 1], pose[i, 2], forward, left, turn, TIME_STEP)
    boxes = solids.boxes
    moved = _put(boxes[i], x, y, yaw)
    if _leaves_its_bin(moved, i, bodies, boxes):
        bodies.refused[i] += 1
        bodies.twist[i, :] = 0.0
        return NONE
    obstacle = _obstacle_of(moved, i, solids, walls)
    if obstacle != NONE:
        bodies.twist[i, :] = 0.0
        return obstacle
    boxes[i, X] = x
    boxes[i, Y] = y
    boxes[i, COSINE] = moved[COSINE]
    boxes[i, SINE] = moved[SINE]
    pose[i, 0] = x
    pose[i, 1] = y
    pose[i, 2] = yaw
    bodies.distance[i] += np.sqrt(forward * forward + left * left) * TIME_STEP
    return NONE


@inlined
def _put(box, x, y, yaw):
    """Return a box at another pose, as a tuple: it stays in the processor's registers."""
    s, c = sin_cos(yaw)
    return x, y, box[HALF_LENGTH], box[HALF_WIDTH], c, s, box[RADIUS]


@inlined
def _leaves_its_bin(moved, i, bodies, boxes):
    """Whether a robot's move would leave its coupled bin too far from the coupling point.

    `moved`: the robot's box after the move.
    """
    tows = bodies.tows[i]
    bin_ = bodies.coupled[i]
    if tows == 0.0 or bin_ == NONE:
        return False
    off_x = boxes[bin_, X] - (moved[X] - tows * moved[COSINE])
    off_y = boxes[bin_, Y] - (moved[Y] - tows * moved[SINE])
    return off_x * off_x + off_y * off_y > BAR * BAR + TOUCH


@inlined
def _obstacle_of(moved, i, solids, walls):
    """Return the first obstacle that a moved body would overlap.

    That is a body's index, n + a wall's index, or NONE.
    """
    boxes = solids.boxes
    grid = solids.grid
    first = len(boxes)
    # The grid was made before any body moved. Its cells are large enough for one step.
    column, row = column_and_row(grid.frame, moved[X], moved[Y])
    for near in range(max(row - 1, 0), min(row + 2, int(grid.frame[ROWS]))):
        begin, end = strip(grid, column, near)
        for k in range(begin, end):
            j = grid.members[k]
            if j < first and j != i and circles_meet(moved, boxes, j) and overlap(moved, boxes[j]):
                first = j
    if first < len(boxes):
        return first
    wall = _wall_at(moved, walls)
    if wall == NONE:
        return NONE
    return len(boxes) + wall


@inlined
def _wall_at(box, walls):
    """Return the first wall that a box overlaps, or NONE."""
    grid = walls.grid
    cell = cell_of(grid, box[X], box[Y])
    for k in grid.members[grid.begin[cell] : grid.begin[cell + 1]]:
        if circles_meet(box, walls.boxes, k) and overlap(box, walls.boxes[k]):
            return k
    return NONE


@allocating
def overlaps(pose, shapes, solid, walls, wall_frame, wall_begin, wall_members):
    """Return each solid body with the first later body and the first wall that it overlaps.

    The pairs are (c, 2) int64; a wall is n + its index, as in `move_all`.
    """
    # At most one body and one wall for each of n bodies.
    n = len(pose)
    boxes = shapes.copy()
    place(pose, boxes)
    obstacles = Solids(walls, Grid(wall_frame, wall_begin, wall_members))
    pairs = np.empty((2 * n, 2), np.int64)
    count = 0
    for i in range(n):
        # np.flatnonzero would load numba's array functions, and with them SciPy: 0.2 s.
        if not solid[i]:
            continue
        body = _later_body_at(i, boxes, solid)
        if body != NONE:
            pairs[count, 0] = i
            pairs[count, 1] = body
            count += 1
        wall = _wall_at(boxes[i], obstacles)
        if wall != NONE:
            pairs[count, 0] = i
            pairs[count, 1] = n + wall
            count += 1
    return pairs[:count]


@inlined
def _later_body_at(i, boxes, solid):
    """Return the first solid body after body i that it overlaps, or NONE."""
    for j in range(i + 1, len(boxes)):
        if solid[j] and circles_meet(boxes[i], boxes, j) and overlap(boxes[i], boxes[j]):
            return j
    return NONE


@allocating
def quaternions(pose):
    """Return z and w of the quaternion of each pose, (n, 2); x and y are 0."""
    parts = np.empty((len(pose), 2))
    for i in range(len(pose)):
        s, c = sin_cos(0.5 * pose[i, 2])
        parts[i, 0] = s
        parts[i, 1] = c
    return parts
