"""What the plans of pickers and carriers take on free roads, beside the picking itself.

None of it depends on how fast rows are picked. So all seeds of an orchard share one `PlanTimes`,
to the last bit, although their rows may differ. `orchard.report.pass_times` adds the picking.
"""

from collections.abc import Sequence
from functools import cache, lru_cache
from math import inf
from typing import NamedTuple

from msgspec.structs import replace

from orchard.field.geometry import HEADINGS, Pose
from orchard.field.layout import KEPT_LAYOUTS, Layout
from orchard.field.layout_key import Geometry
from orchard.field.passes import Pass
from orchard.field.scenario import TIME_STEP
from orchard.plans.jobs import TimedStep, begin_of, timed_steps
from orchard.plans.route import OneWay, Side
from orchard.plans.routes import ROUTES, route_of, way_to
from orchard.plans.steps import Deliver, DriveTo, FetchEmpty, LeaveBin

# m/s at which plans pick here. Their picking is taken out again: any speed would do.
PICKING_SPEED = 1.0


class DrivingTimes(NamedTuple):
    """What a picker does from the head of a row to the head of the next one, beside picking, s."""

    #: All of it: drives, turns, and what takes time at bins.
    total: float
    #: What takes time beside all drives and turns: for bins and answers.
    handling: float
    #: From the head of the row until the full bin is left.
    leaving: float
    #: From the full bin until the picker is out of the carrier's way, and fetches the empty one.
    coming_out: float
    #: From the exchange until it is at the head of the next row.
    going_on: float
    #: The way to the row's end on which it could wait for its next bin, before the row.
    way_in: float


class JobTimes(NamedTuple):
    """What a carrier does for a bin at an end of a row, s."""

    #: From its order until it can stop at the lane.
    coming: float
    #: From the place where it waits for the picker to its stop at the lane.
    driving_in: float
    #: From its order until it is back in the queue, with mean repairs.
    cycle: float
    #: It charges what that takes out of its battery.
    charging: float


class PlanTimes:
    """The times of the passes and of the carriers' jobs of all seeds of an orchard.

    The same passes come again and again, so each is computed once.
    """

    def __init__(self, layout: Layout) -> None:
        self._route = route_of(layout)
        self.of_pass = cache(self._of_pass)
        self.of_job = cache(self._of_job)

    @staticmethod
    def of(layout: Layout) -> "PlanTimes":
        """Return those of an orchard, which are kept for all its seeds."""
        # A user's own code may read the seed.
        has_seed = layout.scenario.route not in ROUTES
        return _kept(Geometry.of(layout, has_seed))

    def _of_pass(self, current: Pass, after: Pass) -> DrivingTimes:
        """Return the times of a pass. `after`: the next one of the same picker."""
        plan = self._plan_of_pass(current, after)
        picking = current.metres / PICKING_SPEED
        total = plan[-1].ends - picking
        if not current.leaves_bin:
            return DrivingTimes(total, _handling(plan), 0.0, 0.0, 0.0, 0.0)
        fetching = begin_of(FetchEmpty, plan)
        left = next(timed.ends for timed in plan if isinstance(timed.step, LeaveBin))
        return DrivingTimes(
            total=total,
            handling=_handling(plan),
            leaving=left - picking,
            coming_out=fetching - left,
            going_on=plan[-1].ends - fetching,
            way_in=_way_in_seconds(self._route, self._route.sides[current.end], plan[0].pose.x),
        )

    def _plan_of_pass(self, current: Pass, after: Pass) -> list[TimedStep]:
        """Return a picker's steps from the head of one row to the head of the next one, on free
        roads.
        """
        route = self._route
        side = route.sides[current.end]
        lane = route.layout.lane(current.row)
        # The picker enters the row at the end from which it does not leave.
        x = lane.east
        if side is route.east:
            x = lane.west
        start = Pose(x, lane.y, HEADINGS[side.heading("EAST")])
        steps = route.pick(current, came_over=False) + route.go_on(current, after)
        speed = route.layout.speed_on(current)
        for number, step in enumerate(steps):
            if isinstance(step, DriveTo) and step.speed == speed:
                steps[number] = replace(step, speed=PICKING_SPEED)
        return list(timed_steps(steps, start, route.layout.machines["picker"]))

    def _of_job(self, row: int, end: str) -> JobTimes:
        """Return the times of a carrier's job at an end of a row."""
        route = self._route
        layout = route.layout
        side = route.sides[end]
        # Carrier 1 stands for all. The names of the picker and of the bin are empty: they take no
        # time.
        fetch = route.fetch(1, row, side, "", "")
        job = list(timed_steps(fetch, route.queue.place(0), layout.machines["carrier"]))
        # The carrier waits before the place of the lane until the picker has come out of it, and
        # then drives from there to its stop.
        stop = begin_of(Deliver, job)
        claim = _claimed(job, side.place("D", row), stop)
        _, coming = way_to(route, row, side)
        cycle, charging = _cycle_and_charging(layout, job)
        return JobTimes(coming, driving_in=stop - claim, cycle=cycle, charging=charging)


@lru_cache(maxsize=KEPT_LAYOUTS)
def _kept(geometry: Geometry) -> PlanTimes:
    return PlanTimes(geometry.layout)


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
