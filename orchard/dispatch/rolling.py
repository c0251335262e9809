"""The dispatch policy `rolling`: before it sends a carrier, it does the next jobs of all pickers in
advance, for each bin to choose from.

Terms: a "plan" is here such a computation (`RollOut` of rollout.py): which carrier gets which bin,
and how long it takes. The "course" of a job is what its picker and its carrier do, tick by tick
(`JobCourse`). Bins of a picker are numbered from 0, in the order in which it fills them. A plan
takes as long as it takes until all planned bins are home: in the queue, after the bay.

It knows the orchard, the steps that robots will do, and what bins and carriers report. Where no
choice gains enough it decides as `predictive`. So it does on a route of the user's own, with many
pickers, and in the long run, in which pickers pick their rows again: there it gained 0.2 %.
"""

from collections.abc import Mapping, Sequence
from functools import cached_property
from math import inf
from typing import NamedTuple

from orchard.dispatch.policy import Assignment, BinReport, CarrierReport
from orchard.dispatch.ranking import Predictive, PredictiveMemory, free_carriers
from orchard.dispatch.rollout import JobCourse, RollOut, courses_of
from orchard.field.kinds import number_of
from orchard.field.layout import Layout
from orchard.plans.routes import ROUTES

# The figures up to WAIT are chosen; docs/bounds.md tells what the policy gains with them.

# Bins of each picker that are planned, from that of the picker on that has filled fewest. So a
# picker that is far ahead waits, and none is left out for longer.
AHEAD = 4
# Ticks by which a plan must be shorter than that with the choice of `predictive`, to be taken.
GAIN = 25.0
# The same if all bins get a carrier at once: then the choice is only which one leaves first.
GAIN_OF_ORDER = 100.0
# By how many ticks a plan counts as longer for each tick that a picker waits.
WAIT = 0.02
# Bins that are compared: the first ones by the rank of `predictive`.
MOST = 5
# With so many pickers a decision takes 30 ms. With 50 it takes a second, and gains 1 %.
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

    # Carrier that was sent -> its trip, until it is back and free.
    trips: dict[str, Trip] = {}
    # Picker -> the bin after the one for which a carrier was sent; when it is full, if roads are
    # free.
    after: dict[str, NextBin] = {}


class Rolling(Predictive):
    """Of the bins that are due, a carrier leaves for the one with which the next bins of all
    pickers are home first. Ties as `predictive`.
    """

    Memory: type = RollingMemory

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        # Carrier -> its line of the queue, from 0.
        self.lines = {}
        for start in layout.starts:
            if start.kind == "carrier":
                self.lines[start.name] = (number_of(start.name) - 1) // layout.queue.places

    @cached_property
    def courses(self) -> dict[str, list[JobCourse]]:
        """Picker -> the courses of its jobs; none where it decides as `predictive`.

        They are computed when they are first needed: that takes half of a second, and for the bound
        without traffic (orchard/report/bounds.py) a policy is made that never decides.
        """
        is_known = self.layout.scenario.route in ROUTES and not self.layout.is_picked_again
        plans = is_known and len(self.layout.blocks) <= MOST_PICKERS
        if not plans:
            return {}
        return courses_of(self.layout)

    @cached_property
    def starts(self) -> dict[str, NextBin]:
        """Picker -> its first bin."""
        starts = {}
        for picker, courses in self.courses.items():
            starts[picker] = NextBin(0, courses[0].job.ready)
        return starts

    def assign(
        self,
        now: int,
        bins: Sequence[BinReport],
        carriers: Sequence[CarrierReport],
        memory: RollingMemory,
    ) -> list[Assignment]:
        for report in bins:
            memory.note(now, report)
        due = self.due(bins, memory)
        free = free_carriers(carriers)
        reported = self.reported(bins, memory)
        has_unknown_bins = len(reported) < len(bins)
        has_unknown_carriers = any(carrier.name not in self.lines for carrier in free)
        if not due or has_unknown_bins or has_unknown_carriers:
            return super().assign(now, bins, carriers, memory)
        if not free:
            return []
        return self.orders(now, due, free, reported, memory)

    def reported(self, bins: Sequence[BinReport], memory: RollingMemory) -> dict[str, NextBin]:
        """Return the bin of each picker that reports, by the lane and side of the report.

        A report of a bin that is not expected there is left out.
        """
        reported = dict[str, NextBin]()
        expected = self.starts | memory.after
        for report in bins:
            courses = self.courses.get(report.picker, [])
            if not courses:
                continue
            # The bin before the expected one reports again if its carrier does not come.
            first = max(0, expected[report.picker].number - 1)
            for number in range(first, len(courses)):
                job = courses[number].job
                if (job.lane, job.side) == (report.lane, report.side):
                    stop = memory.full[report.name] + job.clearing
                    reported.setdefault(report.picker, NextBin(number, stop))
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
        # A carrier that is free has done its trip.
        for carrier in free:
            memory.trips.pop(carrier.name, None)
        plan = self.plan(now, reported, memory)
        plan.go_on({self.lines[carrier.name] for carrier in free})
        orders = []
        for carrier in free[: len(due)]:
            line = self.lines[carrier.name]
            best = self.best(due, line, plan)
            # `due` is a list of this decision, and not the caller's.
            due.remove(best)
            orders.append(Assignment(best.name, carrier.name))
            plan.send(best.picker, line, now)
            self.remember(Trip(best.picker, reported[best.picker], now), carrier.name, memory)
        return orders

    def remember(self, trip: Trip, carrier: str, memory: RollingMemory) -> None:
        """Remember that a carrier was sent, and when its picker will have the bin after that."""
        courses = self.courses[trip.picker]
        job = courses[trip.bin.number].job
        stop = max(trip.bin.stop, trip.sent + job.approach)
        following = trip.bin.number + 1
        # After the last bin there is none to be ready.
        ready = courses[following].job.ready if following < len(courses) else 0
        memory.trips[carrier] = trip
        memory.after[trip.picker] = NextBin(following, stop + job.going_on + ready)

    def plan(self, now: int, reported: dict[str, NextBin], memory: RollingMemory) -> RollOut:
        """Return where all robots are now, as far as can be known, and up to which bins
        they go on.
        """
        expected = self.starts | memory.after | reported
        plan = RollOut(self.courses, self.lines.values(), now, self.ends(expected))
        # First the trips whose picker has gone on to a later bin.
        for carrier, trip in memory.trips.items():
            if trip.bin.number < expected[trip.picker].number:
                plan.come_out(trip.picker, trip.bin.number, trip.bin.stop)
                plan.send(trip.picker, self.lines[carrier], trip.sent)
        under_way = {trip.picker for trip in memory.trips.values()}
        for picker, next_bin in expected.items():
            is_planned = picker not in under_way and next_bin.number < plan.ends[picker]
            if picker in reported or is_planned:
                plan.come_out(picker, next_bin.number, next_bin.stop)
        plan.run(now)
        return plan

    def ends(self, expected: Mapping[str, NextBin]) -> dict[str, int]:
        """Return of each picker the number of its first bin that is not planned."""
        # Picker -> how many bins it fills in all.
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
        """Return the bin for which the next carrier of a line leaves.

        A bin of a picker that is far ahead of another one is chosen only if there is no other one.
        """
        behind = [
            report for report in due if plan.number[report.picker] < plan.ends[report.picker]
        ] or due
        if len(behind) == 1:
            return behind[0]
        # The first bin is the choice of `predictive`. Any other one must be better by `gain`.
        values = [self.value(behind[0], line, plan)]
        gain = GAIN if plan.home.total() < len(due) else GAIN_OF_ORDER
        for report in behind[1:MOST]:
            values.append(self.value(report, line, plan) + gain)
        return behind[values.index(min(values))]

    def value(self, report: BinReport, line: int, plan: RollOut) -> float:
        """Return how long the plan takes if the next carrier of a line leaves for a bin, in
        ticks.
        """
        plan = plan.fork()
        plan.send(report.picker, line, plan.now)
        plan.run(inf)
        if plan.is_over:
            return plan.end + WAIT * plan.waited
        return inf
