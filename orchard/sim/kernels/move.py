"""The inner loops of physics: limits, movement, picking. Arrays have one row per body, in the order in which bodies move; SI units."""

from typing import NamedTuple

import numpy as np

from orchard.field.passes import FULL_WITHIN
from orchard.field.scenario import TIME_STEP
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

NONE = -1  # as an index: none
BAR = 0.3  # m; a robot cannot move to a pose where its coupled bin would be further than this from the coupling point
LANE_REACH = 1.0  # m; a picker is in a row if it is this near to the lane's centre line
PICK_REACH = 0.2  # m; picking begins within this of a row's end, and continues within this of its last point; a step is at most half of it
ANYWHERE = 1e9  # as x from which on a picker picks, m: wherever it is
_FRONTIER = 1e-9  # m


class Rows(NamedTuple):
    """The r rows, and how far each is picked."""

    full: float  # m: what fills a bin
    share: np.ndarray  # (r,) m in a bin for each metre of the row
    west: np.ndarray  # (r,) m: x of the rows' west ends
    length: np.ndarray  # (r,) m
    y: np.ndarray  # (r,) m: the lanes' centre lines
    picking_speed: np.ndarray  # (r,) m/s
    picked: np.ndarray  # (r, 4) m: from the west end, from the east end, and as far as a part inside is picked from each; 0: none


@inlined
def limit(wanted, stopped, speed, coupled, turn, sideways, twists):
    """Write into twists, (n, 3), the wanted twists within each body's limits: speed (n,) m/s, turn (n,) rad/s."""
    for i in range(len(wanted)):
        is_finite = (
            np.isfinite(wanted[i, 0]) and np.isfinite(wanted[i, 1]) and np.isfinite(wanted[i, 2])
        )
        if stopped[i] or not is_finite or (sideways[i] and coupled[i] == NONE):
            twists[i, :] = 0.0
            continue
        forward = min(max(wanted[i, 0], -speed[i]), speed[i])
        left = min(max(wanted[i, 1], -speed[i]), speed[i]) if sideways[i] else 0.0
        together = np.sqrt(forward * forward + left * left)
        share = speed[i] / together if together > speed[i] else 1.0
        twists[i, 0], twists[i, 1], twists[i, 2] = (
            forward * share,
            left * share,
            min(max(wanted[i, 2], -turn[i]), turn[i]),
        )


@jit
def arc(x, y, yaw, forward, left, turn, seconds):
    """Return the pose (x, y, yaw) after a constant twist: the exponential of SE(2), by the chord of its arc."""
    half = 0.5 * turn * seconds
    s, c = sin_cos(yaw + half)
    length = seconds if half == 0.0 else seconds * (sin_cos(half)[0] / half)
    return (
        x + length * (c * forward - s * left),
        y + length * (s * forward + c * left),
        wrap(yaw + turn * seconds),
    )


@jit
def advance(
    wanted, twist, pose, stopped, coupled, fill, pickers, speed, turn, sideways, shapes, tows, solid, walls, wall_frame, wall_begin,
    wall_members, body_frame, bin_full, bin_least, row_share, row_west, row_length, row_y, row_speed, row_ends, distance, collisions,
    refused, blocked, pick_from, boxes, cells, cell_begin, cell_members, met, picked_from, before, full,
):  # fmt: skip
    """Do one time step of all bodies: limit the wanted twists, (n, 3), move the bodies, and pick. It is one kernel to save calls.

    boxes, cells, cell_..., before, full: space to work in; `met` and `picked_from` are written by `move_all` and `pick`. Returns whether
    anything happened of which there may be an event: a collision began, a row is picked, a bin is full.
    """
    rows = Rows(bin_full, row_share, row_west, row_length, row_y, row_speed, row_ends)
    walls_near = Grid(wall_frame, wall_begin, wall_members)
    limit(wanted, stopped, speed, coupled, turn, sideways, twist)
    keep_pace(pickers, twist, pose, coupled, fill, rows, pick_from)
    for k in range(len(pickers)):
        before[k] = pose[pickers[k], 0]
    place(pose, boxes)
    bodies_near = sort_into_cells(boxes, solid, body_frame, cells, cell_begin, cell_members)
    is_eventful = move_all(
        twist,
        pose,
        coupled,
        tows,
        walls,
        walls_near,
        boxes,
        bodies_near,
        distance,
        collisions,
        refused,
        blocked,
        met,
    )
    is_eventful |= pick(pickers, before, pose, coupled, rows, fill, pick_from, picked_from)
    full_bins(fill, coupled, pickers, bin_full, bin_least, full)
    for is_full in full:
        is_eventful |= is_full
    return is_eventful


@jit
def full_bins(fill, coupled, pickers, bin_full, bin_least, full):
    """Write into `full`, (n,) bool, which bins are full: they hold `bin_full` m, or `bin_least` if no picker has them any more."""
    for i in range(len(fill)):
        full[i] = fill[i] >= bin_least
    for i in pickers:
        if coupled[i] != NONE:
            full[coupled[i]] = fill[coupled[i]] >= bin_full


@inlined
def move_all(
    twist,
    pose,
    coupled,
    tows,
    walls,
    wall_grid,
    boxes,
    body_grid,
    distance,
    collisions,
    refused,
    blocked,
    met,
):
    """Move each body with its twist for one time step, one after another, if nothing solid is in the way: else its twist becomes 0.

    boxes (n, 7) and walls (w, 7): the bodies at their poses, and the walls; body_grid, wall_grid: their Grids. Return whether a collision
    begins, with the obstacle in `met`, (n,) int64: a body's index, n + a wall's index, or NONE.
    """
    begins = False
    for i in range(len(pose)):
        obstacle = _move_one(
            i, twist, pose, coupled, tows, walls, wall_grid, boxes, body_grid, distance, refused
        )
        met[i] = NONE if blocked[i] else obstacle
        collisions[i] += met[i] != NONE
        begins |= met[i] != NONE
        blocked[i] = obstacle != NONE
    return begins


@inlined
def _move_one(i, twist, pose, coupled, tows, walls, wall_grid, boxes, body_grid, distance, refused):
    """Move one body, if it can; return its obstacle, or NONE."""
    forward, left, turn = twist[i, 0], twist[i, 1], twist[i, 2]
    if forward == 0.0 and left == 0.0 and turn == 0.0:
        return NONE
    x, y, yaw = arc(pose[i, 0], pose[i, 1], pose[i, 2], forward, left, turn, TIME_STEP)
    moved = _put(boxes[i], x, y, yaw)
    if _leaves_its_bin(moved, i, coupled, tows, boxes):
        refused[i] += 1
        twist[i, :] = 0.0
        return NONE
    obstacle = _in_the_way(moved, i, boxes, body_grid, walls, wall_grid)
    if obstacle != NONE:
        twist[i, :] = 0.0
        return obstacle
    boxes[i, X], boxes[i, Y], boxes[i, COSINE], boxes[i, SINE] = x, y, moved[COSINE], moved[SINE]
    pose[i, 0], pose[i, 1], pose[i, 2] = x, y, yaw
    distance[i] += np.sqrt(forward * forward + left * left) * TIME_STEP
    return NONE


@inlined
def _put(box, x, y, yaw):
    """Return a box at another pose, as a tuple: it stays in the processor's registers."""
    s, c = sin_cos(yaw)
    return x, y, box[HALF_LENGTH], box[HALF_WIDTH], c, s, box[RADIUS]


@inlined
def _leaves_its_bin(moved, me, coupled, tows, boxes):
    """Whether a robot's move would leave its coupled bin too far from the coupling point."""
    if tows[me] == 0.0 or coupled[me] == NONE:
        return False
    off_x = boxes[coupled[me], X] - (moved[X] - tows[me] * moved[COSINE])
    off_y = boxes[coupled[me], Y] - (moved[Y] - tows[me] * moved[SINE])
    return off_x * off_x + off_y * off_y > BAR * BAR + TOUCH


@inlined
def _in_the_way(moved, me, boxes, body_grid, walls, wall_grid):
    """Return the first obstacle that a moved body would overlap: a body's index, n + a wall's index, or NONE."""
    first = len(
        boxes
    )  # the bodies' grid was made before any body moved; its cells are large enough for one step
    column, row = column_and_row(body_grid.frame, moved[X], moved[Y])
    for near in range(max(row - 1, 0), min(row + 2, int(body_grid.frame[ROWS]))):
        begin, end = strip(body_grid, column, near)
        for k in range(begin, end):
            j = body_grid.members[k]
            if j < first and j != me and circles_meet(moved, boxes, j) and overlap(moved, boxes[j]):
                first = j
    if first < len(boxes):
        return first
    wall = _wall_at(moved, walls, wall_grid)
    return NONE if wall == NONE else len(boxes) + wall


@inlined
def _wall_at(box, walls, grid):
    """Return the first wall that a box overlaps, or NONE."""
    cell = cell_of(grid, box[X], box[Y])
    for k in grid.members[grid.begin[cell] : grid.begin[cell + 1]]:
        if circles_meet(box, walls, k) and overlap(box, walls[k]):
            return k
    return NONE


@allocating
def overlaps(pose, shapes, solid, walls, wall_frame, wall_begin, wall_members):
    """Return each solid body with the first later body and the first wall that it overlaps, (c, 2) int64: as `move_all` does."""
    n, boxes, count, found = len(pose), shapes.copy(), 0, np.empty((2 * len(pose), 2), np.int64)
    place(pose, boxes)
    for i in range(n):
        if not solid[
            i
        ]:  # np.flatnonzero would load numba's array functions, and with them SciPy: 0.2 s
            continue
        for j in range(i + 1, n):
            if solid[j] and circles_meet(boxes[i], boxes, j) and overlap(boxes[i], boxes[j]):
                found[count, 0], found[count, 1] = i, j
                count += 1
                break
        wall = _wall_at(boxes[i], walls, Grid(wall_frame, wall_begin, wall_members))
        if wall != NONE:
            found[count, 0], found[count, 1] = i, n + wall
            count += 1
    return found[:count]


@inlined
def row_at(y, rows):
    """Return the index of the row with y in its lane, or NONE."""
    for r in range(len(rows.y)):
        if abs(y - rows.y[r]) <= LANE_REACH:
            return r
    return NONE


@inlined
def keep_pace(pickers, twist, pose, coupled, fill, rows, pick_from):
    """Limit the twist of a picker in an unpicked part of a row, with a bin that is not full, to the row's picking speed."""
    for i in pickers:
        if coupled[i] == NONE or fill[coupled[i]] >= rows.full or pick_from[i] != ANYWHERE:
            continue
        r = row_at(pose[i, 1], rows)
        if r == NONE or is_done(r, rows):
            continue
        from_west, from_east = pose[i, 0] - rows.west[r], rows.west[r] + rows.length[r] - pose[i, 0]
        west, east = rows.picked[r, 0], rows.picked[r, 1]
        is_inside = min(from_west, from_east) >= 0.0
        if is_inside and from_west >= west - _FRONTIER and from_east >= east - _FRONTIER:
            twist[i, 0] = min(max(twist[i, 0], -rows.picking_speed[r]), rows.picking_speed[r])


@inlined
def pick(pickers, before, pose, coupled, rows, fill, pick_from, picked_from):
    """Pick what the pickers drove over since x = `before`, (p,) m, from the rows `picked_from`, (p,). Return whether one is done."""
    is_any_done = False
    for k in range(len(pickers)):
        i, picked_from[k] = pickers[k], NONE
        start, end, r = before[k], pose[i, 0], row_at(pose[i, 1], rows)
        if coupled[i] == NONE or r == NONE:
            continue
        west, east = rows.west[r], rows.west[r] + rows.length[r]
        if max(start, end) < west or min(start, end) > east:
            continue
        if pick_from[i] != ANYWHERE:
            if not min(start, end) <= pick_from[i] <= max(start, end):
                continue
            _begin_inside(r, pick_from[i] - west, rows)
            pick_from[i] = ANYWHERE
        done = min(max(end, west), east) - west if end > start else east - min(max(end, west), east)
        if end != start and _pick_row(r, 0 if end > start else 1, done, coupled[i], rows, fill):
            picked_from[k] = r
            is_any_done |= is_done(r, rows)
    return is_any_done


@jit
def picked_metres(row_ends, row_length, metres):
    """Write into metres, (r,), how much of each row is picked. `row_ends`: as `Rows.picked`."""
    for r in range(len(row_length)):
        inside = row_ends[r, 2] + row_ends[r, 3] - row_length[r]
        metres[r] = row_ends[r, 0] + row_ends[r, 1] + max(0.0, inside)


@inlined
def is_done(r, rows):
    """Whether a row is picked to the end."""
    return rows.picked[r, 0] + rows.picked[r, 1] >= rows.length[r] - FULL_WITHIN


@inlined
def _begin_inside(r, from_west, rows):
    """Begin to pick a row inside what is unpicked of it, so many metres from its west end, if no part inside is begun."""
    picked, length = rows.picked[r], rows.length[r]
    if picked[0] < from_west < length - picked[1] and picked[2] + picked[3] == 0.0:
        picked[2], picked[3] = from_west, length - from_west


@inlined
def _pick_row(r, end, done, a_bin, rows, fill):
    """Pick a row up to `done` m from an end (0 west, 1 east) into a bin, if that continues the part that is picked from there.

    Return whether anything was picked. What a row or a bin lacks at most in the end is picked too, so each metre picked is in a bin.
    """
    ripe, room = rows.length[r] - rows.picked[r, 1 - end], (rows.full - fill[a_bin]) / rows.share[r]
    part = end if rows.picked[r, 2] == 0.0 else 2 + end
    was = rows.picked[r, part]
    left = min(ripe - was, room)
    grows = min(done - was, left)
    if grows <= 0.0 or done - was > PICK_REACH:
        return False
    if left - grows <= FULL_WITHIN:
        grows, done = left, was + left
    rows.picked[r, part] = _or_full(min(was + grows, done), ripe, FULL_WITHIN)
    if part >= 2 and rows.picked[r, part] == ripe:  # it has come to the edge
        rows.picked[r, 1 - end] = rows.picked[r, 3 - end]
        rows.picked[r, 2:] = 0.0
    fill[a_bin] = _or_full(
        fill[a_bin] + grows * rows.share[r], rows.full, FULL_WITHIN * rows.share[r]
    )
    return True


@inlined
def _or_full(metres, length, within):
    return length if metres >= length - within else metres


@allocating
def quaternions(pose):
    """Return z and w of the quaternion of each pose, (n, 2); x and y are 0."""
    parts = np.empty((len(pose), 2))
    for i in range(len(pose)):
        parts[i, 0], parts[i, 1] = sin_cos(0.5 * pose[i, 2])
    return parts
