"""The laser's inner loops: the ranges of many beams to many oriented boxes, exact to rounding.

Every quantity below is in the sensor's frame: the sensor at the origin, facing along +x. One face of a box is a segment on the line
{p : n.p = -gap}, where n is the face's outward normal and gap > 0 the sensor's distance from that line, on its outer side. A beam of
direction u meets the line at p = t u, so

    1 / t  =  -(n . u) / gap  =  a cos + b sin      with  a = -n_x / gap,  b = -n_y / gap:

two products a beam, no division. The nearest hit is the largest 1/t, so each beam keeps a running maximum, 0 at first, and is turned into
a range once, at the end.

The beams that meet a face are those between its right corner and its left corner. The sign of a cross product decides exactly whether a
beam passes a corner on its right or left, so an approximate first beam is enough. This needs no arc tangent: y / (|x| + |y|), quarter by
quarter, grows with the angle from 0 to 4 (the angle on a diamond instead of a circle). A table gives the fractional beam index at each
small step of this angle; linear interpolation between two steps is right to a third of a thousandth of a beam. Two faces that share a
corner use the same result for it, so no beam passes between them.

Boxes are skipped if their circumscribed circle is beyond the range or, for a forward laser, wholly behind the sensor; faces that point
away are skipped too, so at most two remain. From inside a box, a beam leaves by the face with the largest 1/t of all four, so no corners
are needed. A sensor at most boxes.TOUCH inside a box is on its edge, and measures 0.
"""

from typing import NamedTuple

import numpy as np

from orchard.field.kinds import LASER_RANGE
from orchard.field.repeatable import TURN
from orchard.sim.kernels.boxes import (
    COSINE,
    HALF_LENGTH,
    HALF_WIDTH,
    RADIUS,
    SINE,
    TOUCH,
    X,
    Y,
    place,
)
from orchard.sim.kernels.grid import ROWS, Grid, cell_of, column_and_row, sort_into_cells, strip
from orchard.sim.kernels.jit import inlined, jit, log, sin_cos

STEPS = 256  # table steps for each quarter of the diamond
SLACK = 1e-3  # of a beam; three times the error of the table


class Fan(NamedTuple):
    """The beams of a laser."""

    cosine: np.ndarray  # (beams,)
    sine: np.ndarray  # (beams,)
    table: np.ndarray  # (4 STEPS + 2,): fractional beam index at each step of the diamond; the first entry is beam 0
    turn: float  # number of beams in a full turn
    forward: bool  # whether the sensor sees nothing behind itself


@jit
def cast_all(
    pose, sees, ranges, rounded, bodies, solid, walls, wall_frame, wall_begin, wall_members, body_frame,
    cells, cell_begin, cell_members, ahead, around, begin, front_beams, front_table, round_beams, round_table,
):  # fmt: skip
    """Fill `ranges`, (all beams,) float64, with the distance to the nearest return of each beam, m; +inf without a return.

    rounded (all beams,): the same as float32.
    pose (n, 3): written into `bodies` first. bodies (n, 7) and walls (w, 7): boxes, columns as in boxes.py.
    solid (n,) bool: bodies that lasers see; sees (n,) bool: bodies that scan. wall_...: the fields of the walls' Grid.
    body_frame: frame of the bodies' grid, with cells as large as a laser's range plus a body's radius. cells, cell_...: space for it.
    ahead (n,) m: distance of the laser ahead of the centre; around (n,) bool: whether the laser has the Fan round_ instead of front_.
    ..._beams: cosine and sine of the Fan's beams. begin (n + 1,) int64: the ranges of body i are begin[i] to begin[i + 1].

    The parameters are arrays because numba takes a quarter of a microsecond to unpack each field of a named tuple from Python.
    """
    place(pose, bodies)
    wall_grid = Grid(wall_frame, wall_begin, wall_members)
    body_grid = sort_into_cells(bodies, solid, body_frame, cells, cell_begin, cell_members)
    front = Fan(front_beams[0], front_beams[1], front_table, front_table[4 * STEPS], True)
    round_ = Fan(round_beams[0], round_beams[1], round_table, round_table[4 * STEPS], False)
    for i in range(len(bodies)):
        inverse, nearest = ranges[begin[i] : begin[i + 1]], rounded[begin[i] : begin[i + 1]]
        inverse[:] = 0.0
        if sees[i]:
            x = bodies[i, X] + ahead[i] * bodies[i, COSINE]
            y = bodies[i, Y] + ahead[i] * bodies[i, SINE]
            _cast(
                i,
                x,
                y,
                bodies,
                body_grid,
                walls,
                wall_grid,
                round_ if around[i] else front,
                inverse,
            )
        for k in range(len(inverse)):
            inverse[k] = 1.0 / inverse[k]
            inverse[k] = inverse[k] if inverse[k] <= LASER_RANGE else np.inf
            nearest[k] = inverse[k]


@inlined
def _cast(me, x, y, bodies, body_grid, walls, wall_grid, fan, inverse):
    """Raise the 1/t of the beams of one sensor, at (x, y) on body `me`, to the 1/t of all boxes in range."""
    c, s = bodies[me, COSINE], bodies[me, SINE]
    cell = cell_of(wall_grid, x, y)
    for k in range(wall_grid.begin[cell], wall_grid.begin[cell + 1]):
        wall = wall_grid.members[k]
        if _in_view(walls, wall, x, y, c, s, fan.forward):
            _paint_box(walls[wall], x, y, c, s, fan, inverse)
    column, row = column_and_row(body_grid.frame, x, y)
    for near in range(max(row - 1, 0), min(row + 2, int(body_grid.frame[ROWS]))):
        first, end = strip(body_grid, column, near)
        for k in range(first, end):
            j = body_grid.members[k]
            if j != me and _in_view(bodies, j, x, y, c, s, fan.forward):
                _paint_box(bodies[j], x, y, c, s, fan, inverse)


@inlined
def _in_view(boxes, k, x, y, c, s, forward):
    """Whether a box's circle is within range of a sensor at (x, y) and, for a forward sensor, not behind it; (c, s): heading."""
    dx, dy = boxes[k, X] - x, boxes[k, Y] - y
    radius = boxes[k, RADIUS]
    reach = LASER_RANGE + radius
    return dx * dx + dy * dy <= reach * reach and not (
        forward and c * dx + s * dy < -radius - TOUCH
    )


@inlined
def _paint_box(box, x, y, c, s, fan, inverse):
    """Raise the beams' 1/t to the 1/t of one box; (x, y): the sensor, (c, s): its heading, in the orchard's frame."""
    dx, dy = box[X] - x, box[Y] - y
    at_x, at_y = c * dx + s * dy, c * dy - s * dx
    axis_x, axis_y = c * box[COSINE] + s * box[SINE], c * box[SINE] - s * box[COSINE]
    along, across = (
        -(axis_x * at_x + axis_y * at_y),
        axis_y * at_x - axis_x * at_y,
    )  # the sensor in the box's frame
    gap_along, gap_across = abs(along) - box[HALF_LENGTH], abs(across) - box[HALF_WIDTH]
    if gap_along <= 0.0 and gap_across <= 0.0:
        _paint_inside(along, across, axis_x, axis_y, box, fan, inverse)
        return
    end = 1.0 if along > 0.0 else -1.0  # the end of the box that faces the sensor
    flank = 1.0 if across > 0.0 else -1.0  # the side of the box that faces the sensor
    frame, h, w = (at_x, at_y, axis_x, axis_y), end * box[HALF_LENGTH], flank * box[HALF_WIDTH]
    near = _corner(frame, h, w, fan)
    if gap_along > 0.0:
        other = _corner(frame, h, -w, fan)
        right, left = (near, other) if end == flank else (other, near)
        _paint_face(right, left, -end * axis_x / gap_along, -end * axis_y / gap_along, fan, inverse)
    if gap_across > 0.0:
        other = _corner(frame, -h, w, fan)
        right, left = (other, near) if end == flank else (near, other)
        _paint_face(
            right, left, flank * axis_y / gap_across, -flank * axis_x / gap_across, fan, inverse
        )


@inlined
def _corner(frame, along, across, fan):
    """Convert a corner from the box's frame: return x and y in the sensor's frame, and its fractional beam index."""
    at_x, at_y, axis_x, axis_y = frame
    x, y = at_x + along * axis_x - across * axis_y, at_y + along * axis_y + across * axis_x
    return x, y, _beam_at(diamond(x, y, fan.cosine[0], fan.sine[0]), fan.table)


@inlined
def _beam_at(place, table):
    """Return the fractional index of the beam at an angle on the diamond; the error is less than SLACK."""
    step = int(place * STEPS)
    return table[step] + (place * STEPS - step) * (table[step + 1] - table[step])


@inlined
def diamond(x, y, cosine, sine):
    """Return a number from 0 to 4 that grows with the angle of (x, y), counter-clockwise from (cosine, sine); nan for the zero vector."""
    ahead, left = x * cosine + y * sine, y * cosine - x * sine
    share = left / (abs(ahead) + abs(left))
    if ahead < 0.0:
        return 2.0 - share
    return share if left >= 0.0 else 4.0 + share


@inlined
def _paint_face(right, left, a, b, fan, inverse):
    """Raise the 1/t of the beams between two corners to a cos + b sin."""
    width = left[2] - right[2]
    if width < 0.0:
        width += fan.turn
    if width > 0.75 * fan.turn:  # the face is seen edge on, and rounding has swapped its corners
        return
    last = len(inverse) - 1
    end = right[2] + width + SLACK
    _paint_beams(
        int(np.ceil(right[2] - SLACK)), min(int(end), last), right, left, a, b, fan, inverse
    )
    if end >= fan.turn:
        _paint_beams(0, min(int(end - fan.turn), last), right, left, a, b, fan, inverse)


@inlined
def _paint_beams(first, last, right, left, a, b, fan, inverse):
    """Raise the 1/t of beams `first` to `last`, without the beams at either end that miss the corner."""
    while first <= last and right[0] * fan.sine[first] < right[1] * fan.cosine[first]:
        first += 1
    while last >= first and left[0] * fan.sine[last] > left[1] * fan.cosine[last]:
        last -= 1
    if first <= last:
        _raise(first, last, a, b, fan, inverse)


@inlined
def _raise(first, last, a, b, fan, inverse):
    """Raise the 1/t of beams `first` to `last`. Unsigned indices cannot count from an array's end: so it is vectorized."""
    for k in range(np.uint64(first), np.uint64(last + 1)):
        found = a * fan.cosine[k] + b * fan.sine[k]
        inverse[k] = found if found > inverse[k] else inverse[k]


@inlined
def _paint_inside(along, across, axis_x, axis_y, box, fan, inverse):
    """Raise the 1/t of all beams of a sensor inside a box to the 1/t of the faces by which they leave the box."""
    ahead, behind = box[HALF_LENGTH] - along, box[HALF_LENGTH] + along
    on_left, on_right = box[HALF_WIDTH] - across, box[HALF_WIDTH] + across
    if min(min(ahead, behind), min(on_left, on_right)) <= TOUCH:
        inverse[:] = np.inf
        return
    for k in range(len(inverse)):
        c, s = fan.cosine[k], fan.sine[k]
        by_an_end = max(
            axis_x / ahead * c + axis_y / ahead * s, -axis_x / behind * c - axis_y / behind * s
        )
        by_a_side = max(
            axis_x / on_left * s - axis_y / on_left * c,
            axis_y / on_right * c - axis_x / on_right * s,
        )
        inverse[k] = max(inverse[k], max(by_an_end, by_a_side))


@jit
def _scramble(word):
    """Return 64 well mixed bits: the output function of splitmix64 (Steele, Lea and Flood 2014)."""
    word = (word ^ (word >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    word = (word ^ (word >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return word ^ (word >> np.uint64(31))


@jit
def _normal(key):
    """Return a number of the standard normal distribution (Box and Muller 1958) that depends only on the key."""
    first = _scramble(key + np.uint64(0x9E3779B97F4A7C15))
    second = _scramble(first + np.uint64(0x9E3779B97F4A7C15))
    radius = np.sqrt(-2.0 * log((np.float64(first >> np.uint64(11)) + 1.0) * 2.0**-53))
    return radius * sin_cos(np.float64(second >> np.uint64(11)) * 2.0**-53 * TURN)[1]


@jit
def add_noise(keys, tick, deviation, begin, ranges, rounded):
    """Add Gaussian noise to every return; a range beyond 10 m is no return. keys (n,) uint64: one for each body; deviation: m."""
    for i in range(len(keys)):
        at_tick = _scramble(keys[i] + np.uint64(tick))
        for k in range(begin[i], begin[i + 1]):
            if ranges[k] < np.inf:
                noisy = ranges[k] + deviation * _normal(at_tick + np.uint64(k - begin[i]))
                ranges[k] = max(noisy, 0.0) if noisy <= LASER_RANGE else np.inf
                rounded[k] = ranges[k]
