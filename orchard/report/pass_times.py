"""The times of a picker's passes, and of the bins that it leaves at their ends, without traffic.

Limits are made of them (`orchard.report.bounds`), and the long run compares with them what it
measures. docs/bounds.md has their symbols. A pass is one drive of a picker through a row
(`orchard.field.passes`).
"""

from collections.abc import Sequence
from functools import cache
from math import inf
from typing import NamedTuple

from orchard.dispatch.policies import dispatch_of
from orchard.dispatch.policy import is_early
from orchard.field.geometry import HEADINGS, Pose
from orchard.field.layout import Layout
from orchard.field.passes import UNKNOWN, Pass
from orchard.field.scenario import TIME_STEP
from orchard.plans.jobs import TimedStep, begin_of, handover_seconds, timed_steps
from orchard.plans.route import OneWay, Side
from orchard.plans.routes import route_of, way_to
from orchard.plans.steps import Deliver, DriveTo, FetchEmpty, LeaveBin


class BinTimes(NamedTuple):
    """Mean times of a bin without traffic, or the times of one pass through a row, s."""

    #: T: the picker picks what fills the bin.
    picking: float
    #: t_x: the picker leaves a full bin and goes on, without the wait for an empty one.
    crossing: float
    #: w: the picker waits for an empty bin, if a carrier is free at once.
    waiting: float
    #: C: the carrier drives from the queue's head around the orchard and back.
    cycle: float
    #: The part of t_x that a bin costs because it fills inside a row, and must be driven to the
    #: row's end.
    row_end: float
    #: The carrier charges what a cycle takes out of its battery.
    charging: float

    @property
    def of_picker(self) -> float:
        """The whole time of the picker, s."""
        return self.picking + self.crossing + self.waiting


class PassTimes:
    """The times of the passes of one orchard. The same ones come again and again, so each is
    computed once.
    """

    def __init__(self, layout: Layout) -> None:
        self._route = route_of(layout)
        # Whether a carrier leaves before the bin is full.
        self._leaves_early = is_early(dispatch_of(layout))
        self._bins_differ = layout.scenario.picking.spread_of_bins.distribution != "none"
        self._times = cache(self._times_of)
        self._going_on = cache(self._going_on_from)
        self._job = cache(self._job_of)

    def of(self, current: Pass, after: Pass) -> BinTimes:
        """Return the times of one pass through a row, and of the exchange at its end, if any.

        `after`: the next pass of the same picker.
        """
        return self._times(self._alike(current), _any_bin(after))

    def going_on(self, current: Pass, after: Pass) -> float:
        """Return the time from a picker's exchange until it is at the head of its next row, s."""
        return self._going_on(_any_bin(current), _any_bin(after))

    def _alike(self, current: Pass) -> Pass:
        """Return the same pass as all that have its times: where bins do not differ, for any."""
        if self._bins_differ:
            return current
        return _any_bin(current)

    def _going_on_from(self, current: Pass, after: Pass) -> float:
        plan = plan_of_pass(self._route, current, after)
        return plan[-1].ends - begin_of(FetchEmpty, plan)

    def _job_of(self, row: int, end: str) -> list[TimedStep]:
        """Return a carrier's job at an end of a row."""
        layout = self._route.layout
        # Carrier 1 stands for all. The names of the picker and of the bin are empty: they take no
        # time.
        fetch = self._route.fetch(1, row, self._route.sides[end], "", "")
        return list(timed_steps(fetch, self._route.queue.place(0), layout.machines["carrier"]))

    def _times_of(self, current: Pass, after: Pass) -> BinTimes:
        route = self._route
        layout = route.layout
        lane = layout.lane(current.row)
        plan = plan_of_pass(route, current, after)
        # In the plan the picked part is a drive without stops. It is taken out, and picking put in.
        driving = current.metres / layout.speed_on(current)
        picking = layout.seconds_on(current)
        beside_picking = plan[-1].ends - driving
        # The driving that exchanges inside rows would save: if the pass picks the rest of its row,
        # that through the part that was picked before; else all driving beside picking.
        if current.ends_row:
            row_end = (lane.length - current.metres) / layout.machines["picker"].speed
        else:
            row_end = beside_picking - _handling(plan)
        if not current.leaves_bin:
            return BinTimes(
                picking=picking,
                crossing=beside_picking,
                waiting=0.0,
                cycle=0.0,
                row_end=row_end,
                charging=0.0,
            )
        side = route.sides[current.end]
        job = self._job(current.row, current.end)
        # From the head of the row until the full bin is left, without picking.
        leaving = next(timed.ends for timed in plan if isinstance(timed.step, LeaveBin)) - driving
        # From the full bin until the picker is out of the carrier's way, and fetches the empty one.
        coming_out = begin_of(FetchEmpty, plan) - driving - leaving
        # From a carrier's order until it can stop at the lane.
        _, coming = way_to(route, current.row, side)
        if self._leaves_early:
            # The order comes at the earliest when the picker drives into the row. So the picker
            # waits only for what the carrier's way is longer than all that the picker does until
            # then.
            coming -= _way_in_seconds(route, side, plan[0].pose.x) + picking + leaving
        # The carrier waits before the place of the lane until the picker has come out of it, and
        # then drives from there to its stop.
        stop = begin_of(Deliver, job)
        claim = _claimed(job, side.place("D", current.row), stop)
        waiting = max(coming, coming_out + stop - claim) + handover_seconds(layout)
        cycle, charging = _cycle_and_charging(layout, job)
        return BinTimes(
            picking=picking,
            crossing=beside_picking - coming_out,
            waiting=waiting,
            cycle=cycle,
            row_end=row_end,
            charging=charging,
        )


def _any_bin(current: Pass) -> Pass:
    """Return a pass for any bin of its picker."""
    return current._replace(bin_number=UNKNOWN)


def plan_of_pass(route: OneWay, current: Pass, after: Pass) -> list[TimedStep]:
    """Return a picker's steps from the head of one row to the head of the next one, on free
    roads.
    """
    side = route.sides[current.end]
    lane = route.layout.lane(current.row)
    # The picker enters the row at the end from which it does not leave.
    x = lane.east
    if side is route.east:
        x = lane.west
    start = Pose(x, lane.y, HEADINGS[side.heading("EAST")])
    steps = route.pick(current, came_over=False) + route.go_on(current, after)
    return list(timed_steps(steps, start, route.layout.machines["picker"]))


def _way_in_seconds(route: OneWay, side: Side, x: float) -> float:
    """Return how long a picker drives from where it waits on the other side to an end of a row.

    `side`: that of the row's end at which the bin is exchanged. `x`: of the other end, m.
    """
    opposite = route.east
    if side is route.east:
        opposite = route.west
    return abs(opposite.x(route.WAITING) - x) / route.layout.machines["picker"].speed


def _cycle_and_charging(layout: Layout, job: Sequence[TimedStep]) -> tuple[float, float]:
    """Return how long a carrier is busy with a job, with its mean repairs, and for how long it
    charges afterwards, s.
    """
    # Failures come by the time driven, but not in the queue.
    driven = 0.0
    for timed in job:
        if isinstance(timed.step, DriveTo) and not timed.step.queueing:
            driven += timed.ends - timed.begins
    carrying = layout.scenario.carrying
    battery = carrying.battery
    repairs = carrying.failure.share * driven
    cycle = job[-1].ends + repairs
    standing = _handling(job) + repairs
    standing += layout.machines["carrier"].haul_standing_ticks * TIME_STEP
    # What it uses in this time, as seconds of driving: standing uses a share of that.
    used = cycle - standing + battery.standing * standing
    # Without a battery `hours` is None, and nothing is used.
    return cycle, battery.hours_to_charge * used / (battery.hours or inf)


def _claimed(job: Sequence[TimedStep], place: str, otherwise: float) -> float:
    """Return when a job needs a place for the first time, s; `otherwise` if it never does."""
    for timed in job:
        for needed, seconds in timed.needs:
            if needed == place:
                return seconds
    return otherwise


def _handling(plan: Sequence[TimedStep]) -> float:
    """Return the time that a plan takes beside all drives and turns, s: for bins and answers."""
    return sum(timed.handling for timed in plan)
