"""The dispatch policy `rolling`: before it sends a carrier, it does the next jobs of all pickers in
advance, for each bin to choose from.

It knows the orchard, the plans of robots, and what bins and carriers report. Where no choice gains
enough it decides as `predictive`. So it does on a route of the user's own, with many pickers, and
in the long run, in which pickers pick their rows again: there it gained 0.2 %.
"""

from collections.abc import Mapping, Sequence
from math import inf
from typing import NamedTuple

from orchard.dispatch.policy import Assignment, BinReport, CarrierReport
from orchard.dispatch.ranking import Predictive, PredictiveMemory, free_carriers
from orchard.dispatch.rollout import RollOut, courses_of
from orchard.field.kinds import number_of
from orchard.field.layout import Layout
from orchard.plans.routes import ROUTES

# Bins of each picker, from the one with fewest on, that are planned: none is left out for longer.
AHEAD = 4
# Ticks by which a plan must be better than that of `predictive`; if all bins get a carrier at once.
GAIN, GAIN_OF_ORDER = (25.0, 100.0)
WAIT = 0.02  # ticks of a plan's length for each tick that a picker waits
# Bins, the latest ones, that may be first.
MOST = 5
# Of which a decision takes 30 ms; of 50, it takes a second, and gains 1 %.
MOST_PICKERS = 20


class NextBin(NamedTuple):
    """A bin that a picker fills, or has left."""

    # Of the picker's bins, from 0.
    number: int
    # Tick from which on a carrier can stop at the lane.
    stop: int


class Trip(NamedTuple):
    """A carrier that was sent for a bin."""

    picker: str
    bin: NextBin
    # Tick of the decision.
    sent: int


class RollingMemory(PredictiveMemory):
    """When bins are full, and what was decided."""

    # Carrier under way.
    trips: dict[str, Trip] = {}
    after: dict[
        str, NextBin
    ] = {}  # picker -> the bin after the one to which a carrier was sent, if roads are free


class Rolling(Predictive):
    """Of the bins for which it is time, the one with which the next bins of all pickers are home
    first. Ties as `predictive`.
    """

    Memory: type = RollingMemory

    def __init__(self, layout: Layout) -> None:
        plans = (
            layout.scenario.route in ROUTES
            and len(layout.blocks) <= MOST_PICKERS
            and not layout.is_picked_again
        )
        self.courses = courses_of(layout) if plans else {}  # of none: it decides as `predictive`
        self.starts = {}
        for picker, courses in self.courses.items():
            self.starts[picker] = NextBin(0, courses[0].job.ready)
        # Of the queue, by the carriers' names.
        self.lines = {}
        for start in layout.starts:
            if start.kind == "carrier":
                self.lines[start.name] = (number_of(start.name) - 1) // layout.queue.places

    def assign(
        self,
        now: int,
        bins: Sequence[BinReport],
        carriers: Sequence[CarrierReport],
        memory: RollingMemory,
    ) -> list[Assignment]:
        for report in bins:
            memory.note(now, report)
        due, free, reported = (
            self.due(bins, memory),
            free_carriers(carriers),
            self.reported(bins, memory),
        )
        if (
            not due
            or len(reported) < len(bins)
            or any(carrier.name not in self.lines for carrier in free)
        ):
            return super().assign(now, bins, carriers, memory)
        return self.orders(now, due, free, reported, memory) if free else []

    def reported(self, bins: Sequence[BinReport], memory: RollingMemory) -> dict[str, NextBin]:
        """Return the bin of each picker that reports.

        One that is not expected there is left out.
        """
        reported, expected = dict[str, NextBin](), self.starts | memory.after
        for report in bins:
            courses = self.courses.get(report.picker, [])
            first = (
                max(0, expected[report.picker].number - 1) if courses else 0
            )  # it reports again if its carrier does not come
            for number in range(first, len(courses)):
                job = courses[number].job
                if (job.lane, job.side) == (report.lane, report.side):
                    reported.setdefault(
                        report.picker, NextBin(number, memory.full[report.name] + job.clearing)
                    )
                    break
        return reported

    def orders(
        self,
        now: int,
        due: list[BinReport],
        free: Sequence[CarrierReport],
        reported: dict[str, NextBin],
        memory: RollingMemory,
    ) -> list[Assignment]:
        """Send each free carrier for the bin that is best, and remember it."""
        for carrier in free:
            memory.trips.pop(carrier.name, None)
        plan, orders = self.plan(now, reported, memory), list[Assignment]()
        plan.go_on({self.lines[carrier.name] for carrier in free})
        for carrier in free[: len(due)]:
            best = self.best(due, self.lines[carrier.name], plan)
            due.remove(best)
            orders.append(Assignment(best.name, carrier.name))
            plan.send(best.picker, self.lines[carrier.name], now)
            self.remember(Trip(best.picker, reported[best.picker], now), carrier.name, memory)
        return orders

    def remember(self, trip: Trip, carrier: str, memory: RollingMemory) -> None:
        job, *following = (course.job for course in self.courses[trip.picker][trip.bin.number :])
        stop, ready = (
            max(trip.bin.stop, trip.sent + job.approach),
            following[0].ready if following else 0,
        )  # of no bin after the last one
        memory.trips[carrier] = trip
        memory.after[trip.picker] = NextBin(trip.bin.number + 1, stop + job.going_on + ready)

    def plan(self, now: int, reported: dict[str, NextBin], memory: RollingMemory) -> RollOut:
        """Return where all robots are now, as far as can be known, and up to which bins
        they go on.
        """
        expected = self.starts | memory.after | reported
        plan = RollOut(self.courses, self.lines.values(), now, self.ends(expected))
        for carrier, trip in memory.trips.items():
            if trip.bin.number < expected[trip.picker].number:
                plan.come_out(trip.picker, *trip.bin)
                plan.send(trip.picker, self.lines[carrier], trip.sent)
        under_way = {trip.picker for trip in memory.trips.values()}
        for picker, one in expected.items():
            if picker in reported or (picker not in under_way and one.number < plan.ends[picker]):
                plan.come_out(picker, *one)
        plan.run(now)
        return plan

    def ends(self, expected: Mapping[str, NextBin]) -> dict[str, int]:
        """Return how many bins of each picker are planned."""
        total = {}
        for picker, courses in self.courses.items():
            total[picker] = len(courses)
        numbers = []
        for picker, next_bin in expected.items():
            if next_bin.number < total[picker]:
                numbers.append(next_bin.number)
        level = AHEAD + min(numbers, default=0)
        return {picker: min(level, total[picker]) for picker in total}

    def best(self, due: Sequence[BinReport], line: int, plan: RollOut) -> BinReport:
        """Return the bin for which the next carrier of a line leaves: none of a picker that is far
        ahead of another one.
        """
        behind = [
            report for report in due if plan.number[report.picker] < plan.ends[report.picker]
        ] or due
        if len(behind) == 1:
            return behind[0]
        gain = GAIN if plan.home.total() < len(due) else GAIN_OF_ORDER
        values = [
            self.value(report, line, plan) + (gain if number else 0.0)
            for number, report in enumerate(behind[:MOST])
        ]
        return behind[values.index(min(values))]

    def value(self, report: BinReport, line: int, plan: RollOut) -> float:
        """Return how long the plan takes if the next carrier of a line leaves for a bin, in
        ticks.
        """
        plan = plan.fork()
        plan.send(report.picker, line, plan.now)
        plan.run(inf)
        return plan.end + WAIT * plan.waited if plan.is_over else inf
