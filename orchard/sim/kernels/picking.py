"""The inner loops of picking: how fast pickers may drive in their rows, what they pick, and which
bins are full. `orchard.sim.kernels.move` calls them once a tick. SI units.
"""

from typing import NamedTuple

import numpy as np

from orchard.field.passes import FULL_WITHIN
from orchard.sim.kernels.jit import inlined, jit

# As an index: none.
NONE = -1
# m. A picker is in a row if it is this near to the lane's centre line.
LANE_REACH = 1.0
# m. Picking begins within this of a row's end, and continues within this of its last point. A step
# is at most half of it.
PICK_REACH = 0.2
# m. As x from which on a picker picks: wherever it is.
ANYWHERE = 1e9
# m. So far within its picked part a row still counts as unpicked, so that a picker that stands at
# the edge of that part keeps the picking speed.
_FRONTIER = 1e-9

# Columns of `Rows.picked`. The code counts on their order: for an end, _WEST or _EAST, `1 - end` is
# the other end, `_INSIDE_WEST + end` the column of the part inside that belongs to the end, and
# `_INSIDE_WEST + 1 - end` that of the part inside that belongs to the other end.
_WEST, _EAST, _INSIDE_WEST, _INSIDE_EAST = range(4)


class Rows(NamedTuple):
    """The r rows, and how far each is picked."""

    # m: what fills a bin.
    full: float
    # (r,) m in a bin for each metre of the row.
    share: np.ndarray
    # (r,) m: x of the rows' west ends.
    west: np.ndarray
    # (r,) m.
    length: np.ndarray
    # (r,) m: the lanes' centre lines.
    y: np.ndarray
    # (r + 1,) the stretches of row i, from the west, are those from `stretch_begin[i]` on.
    stretch_begin: np.ndarray
    # (s,) m: x of the east ends of the stretches; those of row i are before `stretch_begin[i + 1]`.
    stretch_east: np.ndarray
    # (s,) m/s: how fast each stretch is picked.
    stretch_speed: np.ndarray
    # (r, 4) m: picked from the west end, and from the east end. Then, of a part inside that touches
    # neither of them: up to where it is picked, from the west end, and from the east end. Its
    # length is their sum less that of the row. Both are 0 if there is no such part.
    picked: np.ndarray


@jit
def full_bins(fill, coupled, pickers, bin_full, bin_least, full):
    """Write into `full`, (n,) bool, which bins are full.

    A bin is full with `bin_full` m, and with `bin_least` m if no picker has it any more.
    """
    for i in range(len(fill)):
        full[i] = fill[i] >= bin_least
    for i in pickers:
        if coupled[i] != NONE:
            full[coupled[i]] = fill[coupled[i]] >= bin_full


@inlined
def row_at(y, rows):
    """Return the index of the row with y in its lane, or NONE."""
    for r in range(len(rows.y)):
        if abs(y - rows.y[r]) <= LANE_REACH:
            return r
    return NONE


@inlined
def keep_pace(pickers, twist, pose, coupled, fill, rows, pick_from):
    """Limit the speed of a picker that picks to that at which the stretch of row is picked.

    It picks in an unpicked part of the row, with a bin that is not full.
    """
    for i in pickers:
        # Until it comes to the x from which on it picks, it only drives.
        if coupled[i] == NONE or fill[coupled[i]] >= rows.full or pick_from[i] != ANYWHERE:
            continue
        r = row_at(pose[i, 1], rows)
        if r != NONE and not is_done(r, rows) and _is_unpicked(r, pose[i, 0], rows):
            most = rows.stretch_speed[_stretch_ahead(r, pose[i], rows)]
            twist[i, 0] = min(max(twist[i, 0], -most), most)


@inlined
def _stretch_ahead(r, pose, rows):
    """Return the index of the stretch of row r that a picker picks next.

    At the edge between two stretches it is the one to which the picker looks.
    """
    # A picker that stands at an edge may have stopped a rounding error before it.
    x = pose[0]
    if abs(pose[2]) < 0.5 * np.pi:
        x += _FRONTIER
    else:
        x -= _FRONTIER
    stretch = rows.stretch_begin[r]
    while stretch + 1 < rows.stretch_begin[r + 1] and rows.stretch_east[stretch] <= x:
        stretch += 1
    return stretch


@inlined
def _is_unpicked(r, x, rows):
    """Whether x, m, lies in the part of a row that is picked from neither end."""
    from_west = x - rows.west[r]
    from_east = rows.west[r] + rows.length[r] - x
    is_beside = min(from_west, from_east) >= 0.0
    is_past_west = from_west >= rows.picked[r, _WEST] - _FRONTIER
    is_past_east = from_east >= rows.picked[r, _EAST] - _FRONTIER
    return is_beside and is_past_west and is_past_east


@inlined
def pick(pickers, before, pose, coupled, rows, fill, pick_from, picked_from):
    """Pick what the pickers drove over since x = `before`, (p,) m. Return whether a row is done.

    `picked_from`, (p,), gets the row from which each has picked, or NONE.
    """
    is_any_done = False
    for k in range(len(pickers)):
        i = pickers[k]
        start = before[k]
        end = pose[i, 0]
        picked_from[k] = NONE
        r = row_at(pose[i, 1], rows)
        if coupled[i] == NONE or r == NONE or not _is_beside(r, start, end, rows):
            continue
        if pick_from[i] != ANYWHERE:
            has_reached_it = min(start, end) <= pick_from[i] <= max(start, end)
            if not has_reached_it:
                continue
            _begin_inside(r, pick_from[i] - rows.west[r], rows)
            pick_from[i] = ANYWHERE
        if end != start and _pick_up_to(r, end, end > start, coupled[i], rows, fill):
            picked_from[k] = r
            is_any_done |= is_done(r, rows)
    return is_any_done


@inlined
def _is_beside(r, start, end, rows):
    """Whether a part of the way from x = start to x = end lies between the ends of a row."""
    west = rows.west[r]
    east = west + rows.length[r]
    return max(start, end) >= west and min(start, end) <= east


@inlined
def _pick_up_to(r, x, is_eastward, a_bin, rows, fill):
    """Pick a row up to x, m, from the end from which the picker comes. Return as `_pick_row`."""
    west = rows.west[r]
    east = west + rows.length[r]
    reached = min(max(x, west), east)
    if is_eastward:
        return _pick_row(r, _WEST, reached - west, a_bin, rows, fill)
    return _pick_row(r, _EAST, east - reached, a_bin, rows, fill)


@jit
def picked_metres(row_ends, row_length, metres):
    """Write into metres, (r,), how much of each row is picked. `row_ends`: as `Rows.picked`."""
    for r in range(len(row_length)):
        # Negative if there is no part inside.
        inside = row_ends[r, _INSIDE_WEST] + row_ends[r, _INSIDE_EAST] - row_length[r]
        metres[r] = row_ends[r, _WEST] + row_ends[r, _EAST] + max(0.0, inside)


@inlined
def is_done(r, rows):
    """Whether a row is picked to the end."""
    return rows.picked[r, _WEST] + rows.picked[r, _EAST] >= rows.length[r] - FULL_WITHIN


@inlined
def _begin_inside(r, from_west, rows):
    """Begin to pick a row inside what is unpicked of it, `from_west` m from its west end.

    Nothing happens if a part inside is begun.
    """
    picked = rows.picked[r]
    length = rows.length[r]
    is_inside = picked[_WEST] < from_west < length - picked[_EAST]
    if is_inside and picked[_INSIDE_WEST] + picked[_INSIDE_EAST] == 0.0:
        picked[_INSIDE_WEST] = from_west
        picked[_INSIDE_EAST] = length - from_west


@inlined
def _pick_row(r, end, done, a_bin, rows, fill):
    """Pick a row up to `done` m from an end, _WEST or _EAST, into a bin. Return whether the bin got
    more.

    It gets more if the picker continues a part that is picked: the part inside, if there is one,
    else that from the end. The last FULL_WITHIN m that a row or a bin would lack are picked too, so
    each metre picked is in a bin.

    An example: a row of 70 m is picked from the west up to 20 m, and inside from 40 to 60 m. Then
    `picked` is (20, 0, 60, 30). A picker that comes from the west at 60 m continues the part
    inside. At 70 m this has come to the east end, and is the part that is picked from there:
    `picked` is (20, 30, 0, 0).
    """
    picked = rows.picked[r]
    share = rows.share[r]
    # m from the end to the edge of what is picked from the other end.
    ripe = rows.length[r] - picked[1 - end]
    # m of this row for which the bin has room.
    room = (rows.full - fill[a_bin]) / share
    part = end
    if picked[_INSIDE_WEST] != 0.0:
        part = _INSIDE_WEST + end
    was = picked[part]
    remaining = min(ripe - was, room)
    grows = min(done - was, remaining)
    if grows <= 0.0 or done - was > PICK_REACH:
        return False
    if remaining - grows <= FULL_WITHIN:
        grows = remaining
        done = was + remaining
    picked[part] = _or_full(min(was + grows, done), ripe, FULL_WITHIN)
    has_come_to_the_edge = part >= _INSIDE_WEST and picked[part] == ripe
    if has_come_to_the_edge:
        # The part inside and that from the other end are one from now on.
        picked[1 - end] = picked[_INSIDE_WEST + 1 - end]
        picked[_INSIDE_WEST:] = 0.0
    fill[a_bin] = _or_full(fill[a_bin] + grows * share, rows.full, FULL_WITHIN * share)
    return True


@inlined
def _or_full(metres, full, within):
    """Return `full` if less than `within` is lacking, else `metres`; m."""
    if metres >= full - within:
        return full
    return metres
