"""The laser's inner loops: the ranges of many beams to many oriented boxes, exact to rounding.

Every quantity below is in the sensor's frame: the sensor at the origin, facing along +x.

One face of a box is a segment on the line {p : n.p = -gap}, where n is the face's outward normal and gap > 0 the
sensor's distance from that line, on its outer side. A beam of direction u meets the line at p = t u, so

    1 / t  =  -(n . u) / gap  =  a cos + b sin      with  a = -n_x / gap,  b = -n_y / gap,

which is linear in the beam's cosine and sine: two products a beam, no division. The nearest hit is the largest 1/t, so
each beam keeps a running maximum, 0 at first, and is turned into a range once, at the end.

Which beams meet a face: those between its right corner and its left corner. Two arc tangents give the first and the
last of them to within rounding, and the sign of a cross product decides the ends exactly. Two faces that share a
corner compute it by the same formula, so no beam slips through between them.

What is left out beforehand: boxes whose circumscribed circle is beyond the range or, for a laser that looks forward,
wholly behind it, and the faces that are turned away. From outside a box at most two faces remain. From inside, a beam
leaves by the face with the largest 1/t of all four, with no ends to look for. A sensor no deeper inside than boxes.TOUCH
is on the edge, and measures 0.
"""

from typing import NamedTuple

import numpy as np

from orchard.boxes import COSINE, HALF_LENGTH, HALF_WIDTH, RADIUS, SINE, TOUCH, X, Y, cell_of
from orchard.compiled import atan2, jit, log, sin_cos
from orchard.kinds import LASER_RANGE
from orchard.trig import TURN

_SLACK = 1e-6  # of a beam; far more than atan2 is wrong by


class Fan(NamedTuple):
    """A laser's beams."""

    cosine: np.ndarray  # (beams,)
    sine: np.ndarray  # (beams,)
    first: float  # rad, the angle of beam 0
    per_radian: float  # beams
    turn: float  # a full turn, in beams
    forward: bool  # nothing behind the sensor can be seen


class Sensors(NamedTuple):
    """Where the n lasers are mounted, and where their ranges go."""

    ahead: np.ndarray  # (n,) m from the body's centre
    fan: np.ndarray  # (n,) int64: which of the fans
    begin: np.ndarray  # (n + 1,) int64: body i's ranges are begin[i] to begin[i + 1] of all


@jit
def cast_all(bodies, solid, sees, walls, grid, sensors, fans, ranges):
    """Fill `ranges`, (all beams,) float64, with metres to the nearest return of every beam, +inf where there is none.

    bodies (n, 7) and walls (w, 7): boxes, columns as in boxes.py; solid (n,) bool: what can be seen; sees (n,) bool: who scans.
    """
    for i in range(len(bodies)):
        inverse = ranges[sensors.begin[i] : sensors.begin[i + 1]]
        inverse[:] = 0.0
        if sees[i]:
            x = bodies[i, X] + sensors.ahead[i] * bodies[i, COSINE]
            y = bodies[i, Y] + sensors.ahead[i] * bodies[i, SINE]
            _cast(i, x, y, bodies, solid, walls, grid, fans[sensors.fan[i]], inverse)
        for k in range(len(inverse)):
            inverse[k] = 1.0 / inverse[k]
            inverse[k] = inverse[k] if inverse[k] <= LASER_RANGE else np.inf


@jit
def _cast(me, x, y, bodies, solid, walls, grid, fan, inverse):
    """Raise the 1/t of the beams of one sensor, at (x, y) on body `me`, to those of all boxes around it."""
    c, s = bodies[me, COSINE], bodies[me, SINE]
    cell = cell_of(grid, x, y)
    for k in range(grid.begin[cell], grid.begin[cell + 1]):
        wall = grid.members[k]
        if _in_view(walls, wall, x, y, c, s, fan.forward):
            _paint_box(walls[wall], x, y, c, s, fan, inverse)
    for j in range(len(bodies)):
        if solid[j] and j != me and _in_view(bodies, j, x, y, c, s, fan.forward):
            _paint_box(bodies[j], x, y, c, s, fan, inverse)


@jit
def _in_view(boxes, k, x, y, c, s, forward):
    """Whether a box's circle is within range of a sensor at (x, y), and not behind one that looks forward along (c, s)."""
    dx, dy = boxes[k, X] - x, boxes[k, Y] - y
    radius = boxes[k, RADIUS]
    reach = LASER_RANGE + radius
    return dx * dx + dy * dy <= reach * reach and not (forward and c * dx + s * dy < -radius - TOUCH)


@jit
def _paint_box(box, x, y, c, s, fan, inverse):
    """Raise the beams' 1/t to those of one box; (x, y) is the sensor, (c, s) its direction, all in the orchard's frame."""
    dx, dy = box[X] - x, box[Y] - y
    at_x, at_y = c * dx + s * dy, c * dy - s * dx
    axis_x, axis_y = c * box[COSINE] + s * box[SINE], c * box[SINE] - s * box[COSINE]
    along, across = -(axis_x * at_x + axis_y * at_y), axis_y * at_x - axis_x * at_y  # the sensor in the box's frame
    gap_along, gap_across = abs(along) - box[HALF_LENGTH], abs(across) - box[HALF_WIDTH]
    if gap_along <= 0.0 and gap_across <= 0.0:
        _paint_inside(along, across, axis_x, axis_y, box, fan, inverse)
        return
    frame = (at_x, at_y, axis_x, axis_y)
    if gap_along > 0.0:
        side = 1.0 if along > 0.0 else -1.0
        h, w = side * box[HALF_LENGTH], side * box[HALF_WIDTH]
        _paint_face(_corner(frame, h, w), _corner(frame, h, -w), -side * axis_x / gap_along, -side * axis_y / gap_along, fan, inverse)
    if gap_across > 0.0:
        side = 1.0 if across > 0.0 else -1.0
        h, w = side * box[HALF_LENGTH], side * box[HALF_WIDTH]
        _paint_face(_corner(frame, -h, w), _corner(frame, h, w), side * axis_y / gap_across, -side * axis_x / gap_across, fan, inverse)


@jit
def _corner(frame, along, across):
    """A point of a box, given in the box's frame, in the sensor's."""
    at_x, at_y, axis_x, axis_y = frame
    return at_x + along * axis_x - across * axis_y, at_y + along * axis_y + across * axis_x


@jit
def _paint_face(right, left, a, b, fan, inverse):
    """Raise the 1/t of the beams between two corners to a cos + b sin."""
    low = (atan2(right[1], right[0]) - fan.first) * fan.per_radian
    width = (atan2(left[1], left[0]) - fan.first) * fan.per_radian - low
    if width < 0.0:
        width += fan.turn
    if width > 0.75 * fan.turn:  # seen exactly edge on, and rounding has swapped the corners
        return
    if low < 0.0:
        low += fan.turn
    last = len(inverse) - 1
    _paint_beams(int(np.ceil(low - _SLACK)), min(int(low + width + _SLACK), last), right, left, a, b, fan, inverse)
    over = low + width + _SLACK - fan.turn
    if over >= 0.0:
        _paint_beams(0, min(int(over), last), right, left, a, b, fan, inverse)


@jit
def _paint_beams(first, last, right, left, a, b, fan, inverse):
    """Raise the 1/t of beams `first` to `last`, less those at either end that pass the corner by."""
    while first <= last and right[0] * fan.sine[first] < right[1] * fan.cosine[first]:
        first += 1
    while last >= first and left[0] * fan.sine[last] > left[1] * fan.cosine[last]:
        last -= 1
    if first <= last:
        _raise(a, b, fan.cosine[first : last + 1], fan.sine[first : last + 1], inverse[first : last + 1])


@jit
def _raise(a, b, cosine, sine, inverse):
    for k in range(len(inverse)):
        found = a * cosine[k] + b * sine[k]
        inverse[k] = found if found > inverse[k] else inverse[k]


@jit
def _paint_inside(along, across, axis_x, axis_y, box, fan, inverse):
    """Raise the 1/t of all beams of a sensor inside a box to those of the faces by which they leave it."""
    ahead, behind = box[HALF_LENGTH] - along, box[HALF_LENGTH] + along
    on_left, on_right = box[HALF_WIDTH] - across, box[HALF_WIDTH] + across
    if min(min(ahead, behind), min(on_left, on_right)) <= TOUCH:
        inverse[:] = np.inf
        return
    _raise(axis_x / ahead, axis_y / ahead, fan.cosine, fan.sine, inverse)
    _raise(-axis_x / behind, -axis_y / behind, fan.cosine, fan.sine, inverse)
    _raise(-axis_y / on_left, axis_x / on_left, fan.cosine, fan.sine, inverse)
    _raise(axis_y / on_right, -axis_x / on_right, fan.cosine, fan.sine, inverse)


@jit
def _scramble(word):
    """The splitmix64 generator's output function (Steele, Lea and Flood 2014): 64 bits to 64 well mixed bits."""
    word = (word ^ (word >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    word = (word ^ (word >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return word ^ (word >> np.uint64(31))


@jit
def _normal(key):
    """A number of the standard normal distribution (Box and Muller 1958) that depends on the key alone."""
    first = _scramble(key + np.uint64(0x9E3779B97F4A7C15))
    second = _scramble(first + np.uint64(0x9E3779B97F4A7C15))
    radius = np.sqrt(-2.0 * log((np.float64(first >> np.uint64(11)) + 1.0) * 2.0**-53))
    return radius * sin_cos(np.float64(second >> np.uint64(11)) * 2.0**-53 * TURN)[1]


@jit
def add_noise(keys, tick, deviation, sensors, ranges):
    """Add Gaussian noise to every return; keys (n,) uint64: one a body; deviation in metres. Ranges stay in [0, 10]."""
    for i in range(len(keys)):
        at_tick = _scramble(keys[i] + np.uint64(tick))
        for k in range(sensors.begin[i], sensors.begin[i + 1]):
            if ranges[k] < np.inf:
                noisy = ranges[k] + deviation * _normal(at_tick + np.uint64(k - sensors.begin[i]))
                ranges[k] = min(max(noisy, 0.0), LASER_RANGE)
