"""The long-run rate of a harvest in closed form, from geometry and speeds alone. docs/bounds.md derives it.

Times in seconds, rates in bins per second. The forms hold for the built-in policy, in which a bin calls when it is full: another policy may
be faster. They assume that the drives of the traffic plan are driven without a stop.
"""

from orchard.agents.route import OneWay, Side
from orchard.agents.routes import route_of
from orchard.agents.timing import approach_seconds, duration, head
from orchard.field.geometry import HEADINGS, Pose
from orchard.field.layout import ROW_WEST, UNLOADING_SECONDS, Layout

TRAIN = 3.3 + 0.8  # m: a carrier with its bin, and the gap to the next one; at 1 m/s also the s in which the next one moves into the bay


class Bounds:
    """The terms of the closed forms for one orchard on its route, and the long-run rate that follows. A mean is over all rows."""

    def __init__(self, layout: Layout) -> None:
        route, scenario = route_of(layout), layout.scenario
        exchanges = [(row, route.side(i, block.start)) for block in layout.blocks.values() for i, row in enumerate(block.rows)]
        crossings = [_crossing(route, row, side) for row, side in exchanges if row < scenario.rows]
        approaches = [approach_seconds(route, row, side) for row, side in exchanges]
        cycles = [cycle_seconds(route, row, side) for row, side in exchanges]
        self.pickers, self.carriers = scenario.pickers, scenario.carrier_count
        self.row_seconds = sum(layout.picking_seconds(row) for row, _ in exchanges) / scenario.rows  # T, to pick one row, mean
        self.crossing_seconds = sum(crossings) / len(crossings)  # t_x, from the end of a row to the head of the next, mean
        self.approach_seconds = sum(approaches) / len(approaches)  # A, from the queue's head until the picker has its empty bin, mean
        self.cycle_seconds = sum(cycles) / len(cycles)  # C, from the queue's head around the orchard and back, mean
        self.bay_seconds = UNLOADING_SECONDS + TRAIN  # t_bay, for which one carrier occupies the bay

    @property
    def terms(self) -> dict[str, float]:
        """Bins per second that each part of the harvest allows in the long run."""
        cycle = self.row_seconds + self.crossing_seconds + self.approach_seconds
        return {"pickers": self.pickers / cycle, "carriers": self.carriers / self.cycle_seconds, "unloading": 1.0 / self.bay_seconds}

    @property
    def bottleneck(self) -> str:
        """The name of the part that allows least in the long run."""
        return min(self.terms, key=lambda name: self.terms[name])

    @property
    def bins_per_hour(self) -> float:
        """The long-run rate, bins per hour."""
        return 3600.0 * min(self.terms.values())


def cycle_seconds(route: OneWay, row: int, side: Side) -> float:
    """Return the time of a carrier's whole job at a row, from the queue's head and back, s."""
    return duration(route.fetch(1, row, side, "", ""), head(route)) + UNLOADING_SECONDS


def _crossing(route: OneWay, row: int, side: Side) -> float:
    start = Pose(route.layout.row_east if side is route.east else ROW_WEST, route.layout.lane(row).y, HEADINGS[side.heading("EAST")])
    return duration(route.crossing(row, row + 1, side), start)
