"""The places and roads of an orchard with one-way roads, written from docs/reference.md alone:
foreign_carrier.py drives by them. If a figure changes in the documents, it must change here.

The frame is `map`: x points east and y north, in metres. A heading is in radians: 0 faces east, and
it grows counter-clockwise. A row is called a lane; lanes count from 1 in the north. At both ends of
a lane a road of deliveries, D, and a road of full bins, F, run past it. Rows are 70 m long.
"""

import math

EAST = 0.0
NORTH = math.pi / 2
WEST = math.pi
SOUTH = -math.pi / 2

# y of the first line of trees.
FIRST_TREES = 13.5
# Side of a trunk: lanes are so much further apart than a row is wide.
TRUNK = 0.5
# Carriers in a line of the queue.
PLACES_OF_A_LINE = 12


def wrapped(angle):
    """Return an angle, rad, between -pi and pi."""
    return math.remainder(angle, 2 * math.pi)


class Side:
    """One side of the lanes. Carriers drive south on the east side, and north on the west side.

    The west side is the east side turned by half a turn about x = -1.5. So all figures are those of
    the east, and the methods turn them to this side.
    """

    def __init__(self, name, field):
        self.name = name
        self.field = field
        self.sign = 1 if name == "east" else -1

    def x(self, east):
        """Return where an x of the east is on this side."""
        if self.sign > 0:
            return east
        return -3.0 - east

    def y(self, lane, past):
        """Return the y that is so many metres past a lane, as carriers drive; before it if < 0."""
        return self.field.lane(lane) - self.sign * past

    def heading(self, east):
        """Return where a heading of the east leads on this side."""
        if self.sign > 0:
            return east
        return wrapped(east + math.pi)

    def lanes(self, first=None, last=None):
        """Return the lanes that a carrier passes on this side, in its order.

        `first`, `last`: between which, both included; None: from the beginning, to the end.
        """
        lanes = list(range(1, self.field.rows + 1))
        if self.sign < 0:
            lanes.reverse()
        if first is not None:
            lanes = lanes[lanes.index(first) :]
        if last is not None:
            lanes = lanes[: lanes.index(last) + 1]
        return lanes


class Field:
    """The places of an orchard, and of one carrier in it."""

    # On the east side, x of: the road of deliveries; that of full bins; the carrier when it couples
    # the full bin; the full bin in the lane's mouth; the picker that waits for its empty bin.
    D = 38.75
    F = 36.25
    COUPLES = 34.15
    FULL = 32.25
    PICKER = 41.0
    # On the road D, metres past the lane at which a carrier stops, metres before it where it waits
    # for the lane's place, and metres past it where its tail has left that.
    STOP = 1.9
    HOLD = 3.75
    CLEAR = 5.7
    # y of the road along the top; on it x at which a carrier unloads, and x at which it turns off
    # to its line of the queue; x of the heads of all lines.
    TOP_ROAD = 24.5
    BAY_STOP = -30.0
    TURN_OFF = -18.6
    HEAD = 35.4
    # Where places are given back, or waited for: x at which a carrier has left D at the lane of its
    # delivery; on D, x at which it waits for the south-west corner; on F, x at which it has left
    # the south-east corner, and metres north of F's bottom road at which it has left both places of
    # the south-west.
    LEFT_D = 36.8
    CORNER_HOLD = -35.5
    LEFT_EAST = 34.7
    LEFT_CORNER = 1.4
    LEFT_TURN = 3.75
    # y of the lines of the queue, in the order in which they fill.
    LINES = (24.5, 21.5, 18.5, 27.5, 30.5, 33.5, 36.5, 39.5, 42.5, 45.5)

    def __init__(self, scenario, name):
        """`scenario`: as physics replies to the query `scenario`. `name`: of the carrier."""
        self.rows = scenario["rows"]
        # From one lane to the next.
        self.pitch = scenario["row_width"] + TRUNK
        # Seven carriers for ten pickers, if the scenario sets none.
        carriers = scenario["carriers"] or math.ceil(scenario["pickers"] * 7 / 10)
        last_trees = FIRST_TREES - self.rows * self.pitch
        # y of both roads along the bottom.
        self.bottom_d = last_trees - 5.6
        self.bottom_f = last_trees - 3.5
        number = int(name.rsplit("_", 1)[1])
        # y of this carrier's line of the queue.
        self.line = self.LINES[(number - 1) // PLACES_OF_A_LINE]
        # With more lines than one a carrier that leaves them needs the place `top`, and gives it
        # back south of the southernmost line in use.
        has_lines = carriers > PLACES_OF_A_LINE
        self.top = ["top"] if has_lines else []
        lines_in_use = self.LINES[: (carriers - 1) // PLACES_OF_A_LINE + 1]
        self.top_clear = min(lines_in_use) - 3.75
        self.east = Side("east", self)
        self.west = Side("west", self)

    def lane(self, number):
        """Return the y of a lane's centre line."""
        return FIRST_TREES - (number - 0.5) * self.pitch

    def side(self, name):
        """Return a side: 'east' or 'west'."""
        if name == "east":
            return self.east
        return self.west

    def along(self, side, road, lanes):
        """Return two lists for the places of some lanes on a road: (place, the y at which a carrier
        waits for it), and (place, the y at which it gives the place back).
        """
        needs = []
        frees = []
        for lane in lanes:
            place = f"{side.name}/{road}/{lane}"
            needs.append((place, side.y(lane, -self.HOLD)))
            frees.append((place, side.y(lane, self.CLEAR)))
        return needs, frees

    def distance(self, x, y, lane, side):
        """Return the metres by road from a place in the queue, (x, y), to the stop at a lane."""
        stop = side.y(lane, self.STOP)
        to_d = self.D - x
        if side is self.east:
            return to_d + y - stop
        along_bottom = self.D - self.west.x(self.D)
        return to_d + (y - self.bottom_d) + along_bottom + (stop - self.bottom_d)
