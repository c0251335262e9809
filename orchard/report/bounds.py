"""What each part of a harvest allows in the long run without traffic, from geometry and speeds alone. docs/bounds.md derives it.

Times in seconds, rates in bins per second. They hold for the policy and the route of the scenario.
"""

from collections.abc import Callable
from dataclasses import dataclass
from statistics import fmean

from orchard.agents.dispatch import dispatch_of, is_early
from orchard.agents.robot import ASK, Step
from orchard.agents.route import OneWay, Side
from orchard.agents.routes import route_of
from orchard.agents.steps import Deliver, DriveTo, FetchEmpty, LeaveBin, Unload
from orchard.agents.timing import duration, timetable, way_to
from orchard.field.geometry import HEADINGS, Pose
from orchard.field.layout import Layout
from orchard.field.rows import Block
from orchard.field.scenario import TIME_STEP

TRAIN = 3.3 + 0.8  # m: a carrier with its bin, and the gap to the next one; at 1 m/s also the s in which the next one moves into the bay
ROUNDS = 2  # times that a picker picks its rows in the means: after two rounds each row has been left at the same ends again
HANDOVER = (Deliver.handles + FetchEmpty.handles + ASK) * TIME_STEP  # s from a carrier's stop until its bin and place are the picker's


@dataclass(frozen=True)
class Exchange:
    """A row of a picker, and the exchange of bins at its end: the time that each part takes without traffic, s."""

    picking: float  #: to pick the row
    leaving: float  #: from the end of the row until the picker has left the full bin
    coming_out: float  #: from there until it stands where it gets an empty bin, and gives the lane's place back
    going_on: float  #: from there, with the empty bin, to the head of the next row
    approach: float  #: from a carrier's departure at the queue's head until it stands there with the empty bin
    from_hold: float  #: for a carrier that came early and holds before the lane's place, the same from its hold
    cycle: float  #: of the carrier's whole job, back to the queue's head

    def wait(self, early: bool) -> float:
        """Return the time from the full bin that is left until the picker has an empty one, if a carrier is free at once.

        `early`: the carrier leaves as soon as the picker is in the row, or later, so that it arrives when the picker has come out.
        """
        way = self.approach - (self.picking + self.leaving if early else 0.0)
        return max(way, self.coming_out + self.from_hold) + HANDOVER


class Bounds:
    """The terms for one orchard, in which each picker picks its rows again and again: `terms`, bins/s that each part allows."""

    def __init__(self, layout: Layout) -> None:
        scenario, route, early = layout.scenario, route_of(layout), is_early(dispatch_of(layout))
        blocks = [_exchanges(route, block) for block in layout.blocks.values()]

        def mean(seconds: Callable[[Exchange], float]) -> float:
            """The mean over the bins of the harvest: each picker delivers as many as another."""
            return fmean(fmean(map(seconds, some)) for some in blocks)

        self.row_seconds = mean(lambda one: one.picking)  # T, to pick one row
        self.crossing_seconds = mean(lambda one: one.leaving + one.going_on)  # t_x, to leave a full bin and to go on
        self.wait_seconds = mean(lambda one: one.wait(early))  # w, from the full bin to an empty one
        self.cycle_seconds = mean(lambda one: one.cycle)  # C, from the queue's head around the orchard and back
        self.bay_seconds = handling([Unload()]) + TRAIN  # t_bay, for which one carrier occupies the bay
        self.terms = {
            "pickers": scenario.pickers / (self.row_seconds + self.crossing_seconds + self.wait_seconds),
            "carriers": scenario.carrier_count / self.cycle_seconds,
            "unloading": 1.0 / self.bay_seconds,
        }

    @property
    def bottleneck(self) -> str:
        """The name of the part that allows least."""
        return min(self.terms, key=lambda name: self.terms[name])

    @property
    def bins_per_hour(self) -> float:
        """The bins per hour that all parts allow together, without traffic: the least of them."""
        return 3600.0 * min(self.terms.values())


def _exchanges(route: OneWay, block: Block) -> list[Exchange]:
    """The exchanges of a picker that picks its rows `ROUNDS` times."""
    rows = block.rows * ROUNDS
    ends = zip(rows, (*rows[1:], rows[0]), strict=True)
    return [_exchange(route, row, after, route.side(count, block.start)) for count, (row, after) in enumerate(ends)]


def _exchange(route: OneWay, row: int, next_row: int, side: Side) -> Exchange:
    layout, job, way = route.layout, route.fetch(1, row, side, "", ""), route.crossing(row, next_row, side)
    start = Pose(route.end(row, side), layout.lane(row).y, HEADINGS[side.heading("EAST")])
    before, out = _until(LeaveBin, way), _until(FetchEmpty, way)
    left, came_out, approach = duration(before, start), duration(out, start), way_to(route, row, side)[1]
    return Exchange(
        picking=layout.picking_seconds(row),
        leaving=left + handling([*before, LeaveBin()]),
        coming_out=came_out - left,
        going_on=duration(way, start) - came_out + handling(way[len(out) :]),
        approach=approach,
        from_hold=approach - _needs(side.place("D", row), job, route.queue.place(0), approach),
        cycle=duration(job, route.queue.place(0)) + handling(job),
    )


def _until(kind: type[Step], steps: list[Step]) -> list[Step]:
    """Return the steps up to the first one of a kind."""
    return steps[: next(i for i, step in enumerate(steps) if isinstance(step, kind))]


def _needs(place: str, steps: list[Step], start: Pose, never: float) -> float:
    """Return the time at which a robot must have a place, s; `never` if it needs none."""
    for step, pose, begins, _ in timetable(steps, start):
        for gate in step.needs if isinstance(step, DriveTo) else []:
            if place in gate.places:
                here = pose.x if isinstance(step, DriveTo) and step.x is not None else pose.y
                return begins + abs(gate.at - here)
    return never


def handling(steps: list[Step]) -> float:
    """Return the time that steps take beside all drives and turns, s: for bins, and for answers."""
    return sum(step.ticks for step in steps) * TIME_STEP
