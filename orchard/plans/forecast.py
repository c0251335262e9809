"""A bin's forecast: where and when will it stand full, while a picker still fills it?"""

from functools import lru_cache
from typing import NamedTuple

from orchard.contract.agent import Hitch, Observation
from orchard.contract.messages import LeftAt
from orchard.field.geometry import EAST, WEST, angle_between
from orchard.field.layout import KEPT_LAYOUTS, Layout
from orchard.field.scenario import TIME_STEP
from orchard.plans.routes import route_of, way_to

# Rad and m: a picker whose heading, or place, is nearer than this to that of a row faces along it,
# or is in it.
ALONG = 0.01
LEAST_SPEED = 0.001  # m/s: a picker that is slower does not pick, but stands, or is about to
EARLIER = 30.0  # s before a carrier would have to leave for the farthest lane


class Ripening(NamedTuple):
    """Where and when a bin will be full."""

    lane: int
    # End of the lane.
    side: str
    # Until it is full, and at the furthest end of a row there; 0 once it is.
    seconds: float
    # m that its picker still has to drive, and does not pick.
    before: float


def _side_ahead(yaw: float) -> str:
    """Return the side to which a picker drives along rows, east or west; '' if it is aslant.

    `yaw`: of the picker, rad.
    """
    for side, along in (("east", EAST), ("west", WEST)):
        if abs(angle_between(along, yaw)) < ALONG:
            return side
    return ""


class Forecast:
    """Tells where and when the bins of a layout will stand full."""

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self.horizon = horizon(layout)

    def of(
        self, seen: Observation, picker: Hitch, picking_speed: float, left_at: LeftAt | None = None
    ) -> Ripening | None:
        """Return the forecast for a bin on a picker; None unless the picker is in a row that is not
        picked, or drives into one.

        `picking_speed`: m/s in this row. `left_at`: where the bin will be left, unless each row
        fills one. A picker that stands before a row may have to wait for roads that early carriers
        block.
        """
        side = _side_ahead(picker.pose.yaw)
        if not side:
            return None
        lane = min(self.layout.lanes, key=lambda lane: abs(lane.y - picker.y))
        if side == "east":
            ahead = lane.east - picker.x
        else:
            ahead = picker.x - lane.west
        if ahead < -ALONG:
            return None
        if self.layout.scenario.bin_metres is None:
            room = max(0.0, self.layout.row_length - seen.fill)
            remaining = room * (lane.length / self.layout.row_length)
        elif left_at is None or (left_at.lane, left_at.side) != (lane.number, side):
            return None
        else:
            remaining = max(0.0, left_at.fill - seen.fill)
        before = max(0.0, ahead - remaining)
        if before > ALONG and picker.twist.x <= 0.0:
            return None
        picking = remaining / picking_speed
        seconds = until_full(self.layout, lane.number, side, picking, before)
        return Ripening(lane.number, side, seconds, before)

    def ticks(self, ripening: Ripening) -> int:
        """Return the ticks until the bin must look again, if its picker keeps its velocity."""
        ticks = int((ripening.seconds - self.horizon) / TIME_STEP)
        if ripening.before:
            metres_a_tick = self.layout.machines["picker"].speed * TIME_STEP
            ticks = min(ticks, int(ripening.before / metres_a_tick))
        return max(1, ticks)


def until_full(layout: Layout, row: int, side: str, picking: float, before: float) -> float:
    """Return the seconds until a bin is full and at the furthest end of a row: after `picking`, s,
    and `before`, m driven.
    """
    return picking + (before + layout.beyond(row, side)) / layout.machines["picker"].speed


@lru_cache(maxsize=KEPT_LAYOUTS)
def horizon(layout: Layout) -> float:
    """Return how long before it is full a bin begins to call, s: a carrier for the farthest lane
    then comes in time.
    """
    route = route_of(layout)
    longest = 0.0
    for lane in layout.lanes:
        for side in route.sides.values():
            _, seconds = way_to(route, lane.number, side)
            longest = max(longest, seconds)
    return longest + EARLIER
