"""The long-run rate of a harvest in closed form, from geometry and speeds alone. docs/bounds.md derives it.

Times in seconds, rates in bins per second. The form holds for the policy and the route of the scenario. It assumes that the drives of the
plans are driven without a stop.
"""

from dataclasses import dataclass
from statistics import fmean

from orchard.agents.dispatch import dispatch_of, is_early
from orchard.agents.robot import Step
from orchard.agents.route import OneWay, Side
from orchard.agents.routes import route_of
from orchard.agents.steps import FetchEmpty, LeaveBin
from orchard.agents.timing import approach_seconds, duration, head
from orchard.field.geometry import HEADINGS, Pose
from orchard.field.layout import UNLOADING_SECONDS, Layout
from orchard.field.rows import Block

TRAIN = 3.3 + 0.8  # m: a carrier with its bin, and the gap to the next one; at 1 m/s also the s in which the next one moves into the bay
ROUNDS = 2  # times that a picker picks its rows in the means: after two rounds each row has been left at the same ends again


@dataclass(frozen=True)
class Exchange:
    """A row of a picker, and the exchange of bins at its end: the time that each part takes without traffic, s."""

    lane: int
    side: Side
    picking: float  #: to pick the row
    leaving: float  #: from the end of the row until the picker has left the full bin
    coming_out: float  #: from there until it stands where it gets an empty bin
    going_on: float  #: from there, with the empty bin, to the head of the next row
    approach: float  #: from a carrier's departure at the queue's head until it stands there with the empty bin
    from_hold: float  #: for a carrier that came early and holds before the lane, the same from its hold
    cycle: float  #: of the carrier's whole job, back to the queue's head

    def wait(self, early: bool) -> float:
        """Return the time from the full bin that is left until the picker has an empty one, if a carrier is free at once.

        `early`: the carrier leaves as soon as the picker is in the row, or later, so that it arrives when the bin is left.
        """
        carrier = max(self.approach - self.picking - self.leaving, self.from_hold) if early else self.approach
        return max(carrier, self.coming_out)


def exchanges(layout: Layout, block: Block, rounds: int = 1) -> list[Exchange]:
    """Return the exchanges of a picker that picks its rows so many times."""
    route, rows = route_of(layout), block.rows * rounds
    onward = (*rows[1:], block.rows[0])
    return [_exchange(route, row, after, route.side(i, block.start)) for i, (row, after) in enumerate(zip(rows, onward, strict=True))]


def _exchange(route: OneWay, row: int, next_row: int, side: Side) -> Exchange:
    layout = route.layout
    start = Pose(route.end(row, side), layout.lane(row).y, HEADINGS[side.heading("EAST")])
    way = route.crossing(row, next_row, side)
    leaving, out, whole = (duration(steps, start) for steps in (_until(LeaveBin, way), _until(FetchEmpty, way), way))
    approach = approach_seconds(route, row, side)
    return Exchange(row, side, layout.picking_seconds(row), leaving, out - leaving, whole - out, approach, route.HOLD + route.STOP,
                    cycle_seconds(route, row, side))  # fmt: skip


def _until(kind: type[Step], steps: list[Step]) -> list[Step]:
    """Return the steps up to the first one of a kind."""
    return steps[: next(i for i, step in enumerate(steps) if isinstance(step, kind))]


def cycle_seconds(route: OneWay, row: int, side: Side) -> float:
    """Return the time of a carrier's whole job at a row, from the queue's head and back, s."""
    return duration(route.fetch(1, row, side, "", ""), head(route)) + UNLOADING_SECONDS


class Bounds:
    """The terms of the closed form for one orchard, and the long-run rate that follows: each picker picks its rows again and again."""

    def __init__(self, layout: Layout) -> None:
        scenario, early = layout.scenario, is_early(dispatch_of(layout))
        each = [exchange for block in layout.blocks.values() for exchange in exchanges(layout, block, ROUNDS)]
        self.pickers, self.carriers = scenario.pickers, scenario.carrier_count
        self.row_seconds = fmean(one.picking for one in each)  # T, to pick one row
        self.crossing_seconds = fmean(one.leaving + one.going_on for one in each)  # t_x, to leave a full bin and to go on
        self.wait_seconds = fmean(one.wait(early) for one in each)  # w, from the full bin to an empty one, if a carrier is free at once
        self.cycle_seconds = fmean(one.cycle for one in each)  # C, from the queue's head around the orchard and back
        self.bay_seconds = UNLOADING_SECONDS + TRAIN  # t_bay, for which one carrier occupies the bay

    @property
    def terms(self) -> dict[str, float]:
        """Bins per second that each part of the harvest allows in the long run."""
        cycle = self.row_seconds + self.crossing_seconds + self.wait_seconds
        return {"pickers": self.pickers / cycle, "carriers": self.carriers / self.cycle_seconds, "unloading": 1.0 / self.bay_seconds}

    @property
    def bottleneck(self) -> str:
        """The name of the part that allows least in the long run."""
        return min(self.terms, key=lambda name: self.terms[name])

    @property
    def bins_per_hour(self) -> float:
        """The long-run rate, bins per hour."""
        return 3600.0 * min(self.terms.values())
