"""The long-run rate of a harvest in closed form, from geometry and speeds alone. docs/bounds.md derives it.

Times in seconds, rates in bins per second. The form holds for the policy and the route of the scenario.
"""

from dataclasses import dataclass
from functools import cached_property
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
from orchard.report.delays import CROSSING, HOME, OUT, TrafficDelays, trip

TRAIN = 3.3 + 0.8  # m: a carrier with its bin, and the gap to the next one; at 1 m/s also the s in which the next one moves into the bay
HALVINGS = 40  # of the range in which the rate is looked for
ROUNDS = 2  # times that a picker picks its rows in the means: after two rounds each row has been left at the same ends again


@dataclass(frozen=True)
class Exchange:
    """A row of a picker, and the exchange of bins at its end: the time that each part takes without traffic, s."""

    lane: int
    next_lane: int  #: of the row that the picker picks after it
    side: Side
    picking: float  #: to pick the row
    leaving: float  #: from the end of the row until the picker has left the full bin
    coming_out: float  #: from there until it stands where it gets an empty bin
    going_on: float  #: from there, with the empty bin, to the head of the next row
    approach: float  #: from a carrier's departure at the queue's head until it stands there with the empty bin
    from_hold: float  #: for a carrier that came early and holds before the lane, the same from its hold
    cycle: float  #: of the carrier's whole job, back to the queue's head

    def wait(self, early: bool, delay: float = 0.0) -> float:
        """Return the time from the full bin that is left until the picker has an empty one, if a carrier is free at once.

        `early`: the carrier leaves as soon as the picker is in the row, or later, so that it arrives when the bin is left.
        `delay`: the time for which the carrier waits on its way for others.
        """
        way = self.approach + delay
        carrier = max(way - self.picking - self.leaving, self.from_hold) if early else way
        return max(carrier, self.coming_out)


def exchanges(route: OneWay, block: Block, rounds: int = 1) -> list[Exchange]:
    """Return the exchanges of a picker that picks its rows so many times."""
    rows = block.rows * rounds
    ends = [(row, after, route.side(i, block.start)) for i, (row, after) in enumerate(zip(rows, (*rows[1:], rows[0]), strict=True))]
    made = {end: _exchange(route, *end) for end in dict.fromkeys(ends)}
    return [made[end] for end in ends]


def _exchange(route: OneWay, row: int, next_row: int, side: Side) -> Exchange:
    layout = route.layout
    start = Pose(route.end(row, side), layout.lane(row).y, HEADINGS[side.heading("EAST")])
    way = route.crossing(row, next_row, side)
    leaving, out, whole = (duration(steps, start) for steps in (_until(LeaveBin, way), _until(FetchEmpty, way), way))
    approach, from_hold = approach_seconds(route, row, side), route.HOLD + route.STOP
    return Exchange(row, next_row, side, layout.picking_seconds(row), leaving, out - leaving, whole - out, approach, from_hold,
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
        scenario, route, self._early = layout.scenario, route_of(layout), is_early(dispatch_of(layout))
        self._each = [exchange for block in layout.blocks.values() for exchange in exchanges(route, block, ROUNDS)]
        self.pickers, self.carriers = scenario.pickers, scenario.carrier_count
        self.row_seconds = fmean(one.picking for one in self._each)  # T, to pick one row
        self.crossing_seconds = fmean(one.leaving + one.going_on for one in self._each)  # t_x, to leave a full bin and to go on
        self.wait_seconds = fmean(one.wait(self._early) for one in self._each)  # w, from the full bin to an empty one
        self.cycle_seconds = fmean(one.cycle for one in self._each)  # C, from the queue's head around the orchard and back
        self.bay_seconds = UNLOADING_SECONDS + TRAIN  # t_bay, for which one carrier occupies the bay
        made = {one: trip(route, one.lane, one.next_lane, one.side, one.approach, self.bay_seconds) for one in dict.fromkeys(self._each)}
        self._delays = TrafficDelays([made[one] for one in self._each], self.carriers)

    @cached_property
    def terms(self) -> dict[str, float]:
        """Bins per second that each part of the harvest allows in the long run, with the waits of the rate that all allow together."""
        most, least = min(self.terms_at(0.0).values()), 0.0
        for _ in range(HALVINGS):
            rate = (least + most) / 2.0
            least, most = (rate, most) if min(self.terms_at(rate).values()) > rate else (least, rate)
        return self.terms_at(most)

    def terms_at(self, rate: float) -> dict[str, float]:
        """Return the bins per second that each part allows, if robots wait for others as often as at a rate, bins/s."""
        waits = self._delays.at(rate)
        wait = fmean(one.wait(self._early, float(delay)) for one, delay in zip(self._each, waits[:, OUT], strict=True))
        pickers = self.row_seconds + self.crossing_seconds + wait + float(waits[:, CROSSING].mean())
        carriers = self.cycle_seconds + float((waits[:, OUT] + waits[:, HOME]).mean())
        return {"pickers": self.pickers / pickers, "carriers": self.carriers / carriers, "unloading": 1.0 / self.bay_seconds}

    @property
    def bottleneck(self) -> str:
        """The name of the part that allows least in the long run."""
        return min(self.terms, key=lambda name: self.terms[name])

    @property
    def bins_per_hour(self) -> float:
        """The long-run rate, bins per hour."""
        return 3600.0 * min(self.terms.values())
