"""How far a carrier with its bin reaches back along its line while it turns off that line.

The robot behind it sees that with its laser, and drives on as the bin swings out of its way. Here
the same follows from the boxes of carrier and bin. The line is the x axis, the carrier faces along
it at first, and its centre is at 0. `kernel/roads.py` uses the two tables that are made from this.
"""

from math import inf

from orchard.field.geometry import Pose, from_frame
from orchard.field.kinds import EIGHTH, KINDS
from orchard.field.repeatable import PI
from orchard.field.scenario import TIME_STEP
from orchard.plans.sense import SIDE_MARGIN

CARRIER = KINDS["carrier"]
BIN = KINDS["bin"]
# m to either side of the line that a robot behind watches.
CORRIDOR = CARRIER.width / 2 + SIDE_MARGIN
# m by which a corner seems nearer than it is, because it is between two beams of a laser.
GRAIN = 0.01
# m from the top road to the lines of the queue beside it.
ASIDE = 3.0


def reaches_back(aside: float = 0.0, first: float = 0.0) -> tuple[float, ...]:
    """Return how far back a carrier reaches after each tick of a half turn, m from its centre.

    Only what is in the way of a robot behind counts; -inf: nothing is. `aside`: how far the carrier
    is from the line, m; `first`: where it faces before, rad from the line to the left.
    """
    reaches = []
    for tick in range(round(PI / (EIGHTH * TIME_STEP)) + 1):
        carrier = Pose(0.0, -aside, first + tick * EIGHTH * TIME_STEP)
        x, y = from_frame(carrier, -CARRIER.tows, 0.0)
        train = [
            *_edges(carrier, CARRIER.length / 2, CARRIER.width / 2),
            *_edges(Pose(x, y, carrier.yaw), BIN.length / 2, BIN.width / 2),
        ]
        reach = max(_reach(start, end) for start, end in train)
        reaches.append(reach - GRAIN if tick else reach)
    return tuple(reaches)


Point = tuple[float, float]


def _edges(pose: Pose, half_length: float, half_width: float) -> list[tuple[Point, Point]]:
    """Return the four edges of a box, each by its ends."""
    corners = []
    for ahead, left in ((1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)):
        corners.append(from_frame(pose, ahead * half_length, left * half_width))
    return [*zip(corners, [*corners[1:], corners[0]], strict=True)]


def _reach(start: Point, end: Point) -> float:
    """Return how far back the part of an edge reaches that is in the corridor, m."""
    x, y = start
    along = end[0] - x
    across = end[1] - y
    first = 0.0
    last = 1.0
    if across == 0.0 and abs(y) > CORRIDOR:
        return -inf
    if across != 0.0:
        shares = sorted([(-CORRIDOR - y) / across, (CORRIDOR - y) / across])
        first = max(first, shares[0])
        last = min(last, shares[1])
    if first > last:
        return -inf
    return max(-x - first * along, -x - last * along)
