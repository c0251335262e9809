"""The laser's inner loops: the ranges of many beams to many oriented boxes, exact to rounding.

Theory of operation. Every quantity below is in the sensor's frame: the sensor at the origin, facing
along +x. One face of a box is a segment on the line {p : n.p = -gap}, where n is the face's outward
normal and gap > 0 the sensor's distance from that line, on its outer side. A beam of direction u
meets the line at p = t u, so

    1 / t  =  -(n . u) / gap  =  a cos + b sin      with  a = -n_x / gap,  b = -n_y / gap:

two products a beam, no division. The nearest hit is the largest 1/t, so each beam keeps a running
maximum, 0 at first, and is turned into a range once, at the end.

The beams that meet a face are those between its right corner and its left corner. The sign of a
cross product decides exactly whether a beam passes a corner on its right or left, so an approximate
first beam is enough. This needs no arc tangent: y / (|x| + |y|), quarter by quarter, grows with the
angle from 0 to 4 (the angle on a diamond instead of a circle). A table gives the fractional beam
index at each small step of this angle; linear interpolation between two steps is right to a third
of a thousandth of a beam. Two faces that share a corner use the same result for it, so no beam
passes between them.

Boxes are skipped if their circumscribed circle is beyond the range or, for a forward laser, wholly
behind the sensor. Faces that point away are skipped too, so at most two remain. From inside a box,
a beam leaves by the face with the largest 1/t of all four, so no corners are needed. A sensor at
most boxes.TOUCH inside a box is on its edge, and measures 0.
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

# 2 to the power of -53: a float holds each multiple of it from 0 to 1.
UNIT = 2.0**-53
# What the generator splitmix64 adds to come to its next number.
GAMMA = 0x9E3779B97F4A7C15
# Steps of the table for each quarter of the diamond.
STEPS = 256
# Beams: three times the error of the table.
SLACK = 1e-3
# Share of a full turn. From outside a box a face is less than half a turn wide. One that seems to
# be wider than this is seen edge on, and rounding has swapped its corners.
WIDEST = 0.75


class Fan(NamedTuple):
    """The beams of a laser."""

    # (beams,).
    cosine: np.ndarray
    # (beams,).
    sine: np.ndarray
    # (4 STEPS + 2,): fractional beam index at each step of the diamond. The first entry is beam 0.
    table: np.ndarray
    # Number of beams in a full turn.
    turn: float
    # Whether the sensor sees nothing behind itself.
    forward: bool


@jit
def cast_all(
    pose, sees, ranges, rounded, bodies, solid, walls, wall_frame, wall_begin, wall_members,
    body_frame, cells, cell_begin, cell_members, ahead, around, begin, front_beams, front_table,
    round_beams, round_table,
):  # fmt: skip
    """Fill `ranges`, (all beams,) float64, with the distance to the nearest return of each beam, m.

    A beam without a return gets +inf. The parameters are arrays, because numba takes a quarter of a
    microsecond to unpack each field of a named tuple from Python.

    rounded (all beams,): gets the same as float32.
    pose (n, 3): written into `bodies` first.
    bodies (n, 7), walls (w, 7): boxes, columns as in boxes.py.
    solid (n,) bool: bodies that lasers see.
    sees (n,) bool: bodies that scan.
    wall_...: the fields of the walls' Grid.
    body_frame: frame of the bodies' grid. A cell's side is a laser's range plus a body's radius.
    cells, cell_...: space for that grid.
    ahead (n,) m: distance of the laser ahead of the centre.
    around (n,) bool: whether the laser has the Fan round_... instead of front_...
    ..._beams: cosine and sine of the Fan's beams.
    begin (n + 1,) int64: the ranges of body i are begin[i] to begin[i + 1].
    """
    place(pose, bodies)
    wall_grid = Grid(wall_frame, wall_begin, wall_members)
    body_grid = sort_into_cells(bodies, solid, body_frame, cells, cell_begin, cell_members)
    front = Fan(front_beams[0], front_beams[1], front_table, front_table[4 * STEPS], True)
    round_ = Fan(round_beams[0], round_beams[1], round_table, round_table[4 * STEPS], False)
    for i in range(len(bodies)):
        inverse = ranges[begin[i] : begin[i + 1]]
        inverse[:] = 0.0
        if sees[i]:
            x = bodies[i, X] + ahead[i] * bodies[i, COSINE]
            y = bodies[i, Y] + ahead[i] * bodies[i, SINE]
            fan = round_ if around[i] else front
            _cast(i, x, y, bodies, body_grid, walls, wall_grid, fan, inverse)
        _to_ranges(inverse, rounded[begin[i] : begin[i + 1]])


@inlined
def _to_ranges(inverse, rounded):
    """Turn the 1/t of one sensor into ranges, m, in place, and write them into `rounded` too."""
    for k in range(len(inverse)):
        inverse[k] = 1.0 / inverse[k]
        inverse[k] = inverse[k] if inverse[k] <= LASER_RANGE else np.inf
        rounded[k] = inverse[k]


@inlined
def _cast(me, x, y, bodies, body_grid, walls, wall_grid, fan, inverse):
    """Raise the 1/t of the beams of one sensor to those of all boxes in range.

    (x, y): the sensor, m, on body `me`.
    """
    c, s = bodies[me, COSINE], bodies[me, SINE]
    cell = cell_of(wall_grid, x, y)
    for k in range(wall_grid.begin[cell], wall_grid.begin[cell + 1]):
        wall = wall_grid.members[k]
        if _is_in_view(walls, wall, x, y, c, s, fan.forward):
            _paint_box(walls[wall], x, y, c, s, fan, inverse)
    column, row = column_and_row(body_grid.frame, x, y)
    for near in range(max(row - 1, 0), min(row + 2, int(body_grid.frame[ROWS]))):
        first, end = strip(body_grid, column, near)
        for k in range(first, end):
            j = body_grid.members[k]
            if j != me and _is_in_view(bodies, j, x, y, c, s, fan.forward):
                _paint_box(bodies[j], x, y, c, s, fan, inverse)


@inlined
def _is_in_view(boxes, k, x, y, c, s, forward):
    """Whether a box's circle is within range of a sensor and, for a forward sensor, not behind it.

    (x, y): the sensor, m. (c, s): cosine and sine of its heading.
    """
    dx = boxes[k, X] - x
    dy = boxes[k, Y] - y
    radius = boxes[k, RADIUS]
    reach = LASER_RANGE + radius
    is_behind = forward and c * dx + s * dy < -radius - TOUCH
    return dx * dx + dy * dy <= reach * reach and not is_behind


@inlined
def _paint_box(box, x, y, c, s, fan, inverse):
    """Raise the beams' 1/t to those of one box.

    (x, y): the sensor, m; (c, s): cosine and sine of its heading; both in the orchard's frame.
    """
    frame = _in_sensor_frame(box, x, y, c, s)
    at_x, at_y, axis_x, axis_y = frame
    # The sensor in the box's frame, m: ahead of its centre, and on its left.
    along = -(axis_x * at_x + axis_y * at_y)
    across = axis_y * at_x - axis_x * at_y
    gap_along = abs(along) - box[HALF_LENGTH]
    gap_across = abs(across) - box[HALF_WIDTH]
    if gap_along <= 0.0 and gap_across <= 0.0:
        _paint_inside(along, across, axis_x, axis_y, box, fan, inverse)
        return
    # The end and the flank of the box that face the sensor. They meet in the nearest corner.
    end = _side_of(along)
    flank = _side_of(across)
    h = end * box[HALF_LENGTH]
    w = flank * box[HALF_WIDTH]
    nearest = _corner(frame, h, w, fan)
    # Right and left are as the sensor sees them. Ahead of the box and on its left, or behind it and
    # on its right, the nearest corner is the right one of the end and the left one of the flank;
    # elsewhere it is the other way about.
    if gap_along > 0.0:
        right, left = _ordered(_corner(frame, h, -w, fan), nearest, end == flank)
        a = -end * axis_x / gap_along
        b = -end * axis_y / gap_along
        _paint_face(right, left, a, b, fan, inverse)
    if gap_across > 0.0:
        right, left = _ordered(nearest, _corner(frame, -h, w, fan), end == flank)
        a = flank * axis_y / gap_across
        b = -flank * axis_x / gap_across
        _paint_face(right, left, a, b, fan, inverse)


@inlined
def _in_sensor_frame(box, x, y, c, s):
    """Return centre and axis of a box, (x, y, axis_x, axis_y), in the frame of a sensor.

    (x, y): the sensor, m; (c, s): cosine and sine of its heading. The axis is a unit vector.
    """
    dx = box[X] - x
    dy = box[Y] - y
    axis_x = c * box[COSINE] + s * box[SINE]
    axis_y = c * box[SINE] - s * box[COSINE]
    return c * dx + s * dy, c * dy - s * dx, axis_x, axis_y


@inlined
def _side_of(value):
    """Return 1 for a positive number, else -1."""
    if value > 0.0:
        return 1.0
    return -1.0


@inlined
def _ordered(a, b, is_swapped):
    """Return two corners as (right, left): (a, b) or, if they are swapped, (b, a)."""
    if is_swapped:
        return b, a
    return a, b


@inlined
def _corner(frame, along, across, fan):
    """Return x and y of a box's corner in the sensor's frame, m, and its fractional beam index.

    frame: as `_in_sensor_frame` returns it. along, across: the corner in the box's frame, m.
    """
    at_x, at_y, axis_x, axis_y = frame
    x = at_x + along * axis_x - across * axis_y
    y = at_y + along * axis_y + across * axis_x
    return x, y, _beam_at(diamond(x, y, fan.cosine[0], fan.sine[0]), fan.table)


@inlined
def _beam_at(angle, table):
    """Return the fractional index of the beam at an angle on the diamond.

    The error is less than SLACK.
    """
    step = int(angle * STEPS)
    return table[step] + (angle * STEPS - step) * (table[step + 1] - table[step])


@inlined
def diamond(x, y, cosine, sine):
    """Return a number from 0 to 4 that grows with the angle of (x, y), counter-clockwise.

    It is 0 in the direction (cosine, sine), and nan for the zero vector.
    """
    ahead = x * cosine + y * sine
    left = y * cosine - x * sine
    share = left / (abs(ahead) + abs(left))
    if ahead < 0.0:
        return 2.0 - share
    if left < 0.0:
        return 4.0 + share
    return share


@inlined
def _paint_face(right, left, a, b, fan, inverse):
    """Raise the 1/t of the beams between two corners to a cos + b sin."""
    width = left[2] - right[2]
    if width < 0.0:
        width += fan.turn
    if width > WIDEST * fan.turn:
        return
    last = len(inverse) - 1
    first = int(np.ceil(right[2] - SLACK))
    end = right[2] + width + SLACK
    _paint_beams(first, min(int(end), last), right, left, a, b, fan, inverse)
    if end >= fan.turn:
        # The face goes on behind beam 0.
        _paint_beams(0, min(int(end - fan.turn), last), right, left, a, b, fan, inverse)


@inlined
def _paint_beams(first, last, right, left, a, b, fan, inverse):
    """Raise the 1/t of beams `first` to `last`, but of those at the ends that miss the corner."""
    while first <= last and right[0] * fan.sine[first] < right[1] * fan.cosine[first]:
        first += 1
    while last >= first and left[0] * fan.sine[last] > left[1] * fan.cosine[last]:
        last -= 1
    if first <= last:
        _raise(first, last, a, b, fan, inverse)


@inlined
def _raise(first, last, a, b, fan, inverse):
    """Raise the 1/t of beams `first` to `last` to a cos + b sin."""
    # Unsigned indices cannot count from an array's end, so the loop is vectorized.
    for k in range(np.uint64(first), np.uint64(last + 1)):
        value = a * fan.cosine[k] + b * fan.sine[k]
        inverse[k] = value if value > inverse[k] else inverse[k]


@inlined
def _paint_inside(along, across, axis_x, axis_y, box, fan, inverse):
    """Raise the 1/t of all beams of a sensor inside a box.

    Each gets that of the face by which it leaves the box. (along, across): the sensor in the box's
    frame, m. (axis_x, axis_y): the box's axis in the sensor's frame.
    """
    ahead = box[HALF_LENGTH] - along
    behind = box[HALF_LENGTH] + along
    on_left = box[HALF_WIDTH] - across
    on_right = box[HALF_WIDTH] + across
    if min(min(ahead, behind), min(on_left, on_right)) <= TOUCH:
        inverse[:] = np.inf
        return
    for k in range(len(inverse)):
        c, s = fan.cosine[k], fan.sine[k]
        by_front = axis_x / ahead * c + axis_y / ahead * s
        by_back = -axis_x / behind * c - axis_y / behind * s
        by_left = axis_x / on_left * s - axis_y / on_left * c
        by_right = axis_y / on_right * c - axis_x / on_right * s
        inverse[k] = max(inverse[k], max(max(by_front, by_back), max(by_left, by_right)))


@jit
def _scramble(word):
    """Return 64 well mixed bits: the output function of splitmix64 (Steele, Lea and Flood 2014)."""
    word = (word ^ (word >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    word = (word ^ (word >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return word ^ (word >> np.uint64(31))


@jit
def _normal(key):
    """Return a number of the standard normal distribution (Box and Muller 1958).

    It depends only on the key.
    """
    first = _scramble(key + np.uint64(GAMMA))
    second = _scramble(first + np.uint64(GAMMA))
    # The upper 53 of 64 bits. One is added to the first number, because 0 has no logarithm.
    radius = np.sqrt(-2.0 * log((np.float64(first >> np.uint64(11)) + 1.0) * UNIT))
    angle = np.float64(second >> np.uint64(11)) * UNIT * TURN
    _, cosine = sin_cos(angle)
    return radius * cosine


@jit
def add_noise(keys, tick, deviation, begin, ranges, rounded):
    """Add Gaussian noise to every return. A range beyond LASER_RANGE is no return.

    keys (n,) uint64: one for each body. deviation: m. begin, ranges, rounded: as in `cast_all`.
    """
    for i in range(len(keys)):
        at_tick = _scramble(keys[i] + np.uint64(tick))
        for k in range(begin[i], begin[i + 1]):
            if ranges[k] < np.inf:
                noisy = ranges[k] + deviation * _normal(at_tick + np.uint64(k - begin[i]))
                ranges[k] = max(noisy, 0.0) if noisy <= LASER_RANGE else np.inf
                rounded[k] = ranges[k]
