"""A bin's forecast: where and when it will stand full, while a picker still fills it.

Bins report it to the agent `dispatch`, so that a carrier can come in time. They see their picker's
pose and velocity, and their own fill. The event model uses the same rules.
"""

from functools import lru_cache
from typing import NamedTuple

from orchard.contract.agent import Hitch, Observation
from orchard.contract.messages import LeftAt
from orchard.field.geometry import EAST, WEST, angle_between
from orchard.field.layout import KEPT_LAYOUTS, Layout
from orchard.field.scenario import TIME_STEP
from orchard.plans.routes import route_of, way_to

# A picker whose heading differs from that of a row by less than so many rad faces along it. A point
# that is past another one by less than so many m is not past it.
ALONG = 0.01
# m/s. A picker that is slower does not pick: it stands, or is about to.
LEAST_SPEED = 0.001
# A bin begins to report so long before a carrier would have to leave for the farthest lane, s.
EARLIER = 30.0


class Ripening(NamedTuple):
    """Where and when a bin will be full."""

    lane: int
    # The end of the lane to which the picker drives: 'east' or 'west'.
    side: str
    # s until the bin is full, and has been driven to the outermost end of all rows on that side; 0
    # once it is so.
    seconds: float
    # m that its picker still drives in the row without picking.
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
        """Return the forecast for a bin on a picker.

        None unless the picker is in a row that is not picked yet, or drives into such a row. A
        picker that stands before a row has none: it may have to wait for roads that carriers block
        which come early.

        `seen`: by the bin. `picker`: as the bin sees it. `picking_speed`: in this row, m/s.
        `left_at`: what the picker announced, where it will leave the bin. It is not needed if each
        row fills one bin.
        """
        side = _side_ahead(picker.pose.yaw)
        if not side:
            return None
        lane = min(self.layout.lanes, key=lambda lane: abs(lane.y - picker.y))
        # m to the end of the row.
        if side == "east":
            ahead = lane.east - picker.x
        else:
            ahead = picker.x - lane.west
        if ahead < -ALONG:
            return None
        # m of this row that the picker still picks.
        if self.layout.scenario.bin_metres is None:
            # Each row fills one bin. Its fill is counted as if all rows had the full length.
            room = max(0.0, self.layout.row_length - seen.fill)
            remaining = room * (lane.length / self.layout.row_length)
        elif left_at is None or (left_at.lane, left_at.side) != (lane.number, side):
            return None
        else:
            remaining = max(0.0, left_at.fill - seen.fill)
        before = max(0.0, ahead - remaining)
        # The picker stands before its row, or before the part that it picks.
        if before > ALONG and picker.twist.x <= 0.0:
            return None
        picking = remaining / picking_speed
        seconds = until_full(self.layout, lane.number, side, picking, before)
        return Ripening(lane.number, side, seconds, before)

    def ticks(self, ripening: Ripening) -> int:
        """Return the ticks until the bin must look again, if its picker keeps its velocity.

        That is when it begins to report, or when its picker begins to pick.
        """
        ticks = int((ripening.seconds - self.horizon) / TIME_STEP)
        if ripening.before:
            metres_a_tick = self.layout.machines["picker"].speed * TIME_STEP
            ticks = min(ticks, int(ripening.before / metres_a_tick))
        return max(1, ticks)


def until_full(layout: Layout, row: int, side: str, picking: float, before: float) -> float:
    """Return the seconds until a bin is full, and at the outermost end of all rows on its side.

    `row`, `side`: where its picker drives out. `picking`: the time for which the picker still
    picks, s. `before`: how far it drives in the row without picking, m.
    """
    return picking + (before + layout.beyond(row, side)) / layout.machines["picker"].speed


@lru_cache(maxsize=KEPT_LAYOUTS)
def horizon(layout: Layout) -> float:
    """Return how long before it is full a bin begins to report, s.

    A carrier for the farthest lane then comes in time.
    """
    route = route_of(layout)
    longest = 0.0
    for lane in layout.lanes:
        for side in route.sides.values():
            _, seconds = way_to(route, lane.number, side)
            longest = max(longest, seconds)
    return longest + EARLIER
