"""The inner loops of those who watch: what each robot is doing, and who stands in whom. Arrays have one row per body."""

import numpy as np

from orchard.field.layout import ROW_LENGTH
from orchard.sim.kernels.boxes import Grid, X, Y, cell_of, circles_meet, overlap, place
from orchard.sim.kernels.jit import jit
from orchard.sim.kernels.move import NOBODY

STATES = ("stopped", "picking", "driving", "unloading", "waiting", "at a picker", "on a carrier", "standing")
_STOPPED, _PICKING, _DRIVING, _UNLOADING, _WAITING, _AT_PICKER, _ON_CARRIER, _STANDING = range(len(STATES))
ROBOTS = ("picker", "carrier", "tractor", "bin")  # the kinds of those whose states are counted, by number
_PICKER, _CARRIER, _TRACTOR, _BIN = range(len(ROBOTS))


@jit
def count_states(kinds, twist, coupled, fill, fill_before, bay_ticks, stopped, ticks):
    """Add the step that has just ended to everybody's ticks, (n, states) int64; kinds (n,): numbers in ROBOTS, or NOBODY."""
    for i in range(len(kinds)):
        if kinds[i] == NOBODY:
            continue
        other = coupled[i]
        if stopped[i]:
            state = _STOPPED
        elif kinds[i] == _BIN:
            state = _state_of_bin(i, other, kinds, fill, fill_before, bay_ticks)
        elif kinds[i] == _PICKER and other != NOBODY and fill[other] > fill_before[other]:
            state = _PICKING
        elif twist[i, 0] != 0.0 or twist[i, 1] != 0.0 or twist[i, 2] != 0.0:
            state = _DRIVING
        elif other != NOBODY and _is_unloaded(other, fill, fill_before, bay_ticks):
            state = _UNLOADING
        else:
            state = _WAITING
        ticks[i, state] += 1


@jit
def _state_of_bin(i, other, kinds, fill, fill_before, bay_ticks):
    if _is_unloaded(i, fill, fill_before, bay_ticks):
        return _UNLOADING
    if other == NOBODY:
        return _STANDING
    return _AT_PICKER if kinds[other] == _PICKER else _ON_CARRIER


@jit
def _is_unloaded(i, fill, fill_before, bay_ticks):
    """Whether the bay works on a bin; in the last step of it the bin became empty."""
    return bay_ticks[i] > 0 or (fill_before[i] >= ROW_LENGTH and fill[i] < ROW_LENGTH)


@jit
def who_stands_in_whom(pose, shapes, solid, walls, wall_frame, wall_begin, wall_members):
    """(c, 2) int64: of each solid body that overlaps another after it in the order of bodies, both indices; and n + a wall's index.

    shapes (n, 7) and walls (w, 7): boxes; wall_...: the Grid of the walls that are near. Of several in one, the first is told.
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
