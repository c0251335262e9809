"""How the robots move in the jobs of a harvest: their drives and turns on free roads, with times.

On a drive a robot fails, and meets people and animals. Before a turn it looks around. Both use the
battery. `jobs_of` of orchard/plans/jobs.py has the places and times of the same jobs.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from orchard.field.layout import Layout
from orchard.plans.jobs import TimedStep, begin_of, fillings, trips_of
from orchard.plans.route import OneWay
from orchard.plans.routes import duration, route_of
from orchard.plans.steps import Deliver, DriveTo, Face, LeaveBin, MayFail, TakeBin, Unload


class Drive(NamedTuple):
    """A drive: when it begins, and how long it takes, s; its way, m."""

    at: float
    seconds: float
    metres: float
    #: Whether the robot may fail on it.
    may_fail: bool


class Turn(NamedTuple):
    """A turn on the spot: when it begins, and how long it takes, s."""

    at: float
    seconds: float
    #: Whether a bin is on the bar.
    is_towing: bool


@dataclass(frozen=True)
class Motion:
    """The drives and turns of a robot in one job, in their order."""

    drives: list[Drive] = field(default_factory=list)
    turns: list[Turn] = field(default_factory=list)


@dataclass(frozen=True)
class JobMotions:
    """How picker and carrier move in a job."""

    #: From the time at which the picker last went on, or from the start, until it waits for a bin.
    picker: Motion
    #: For each line of the queue: from its head to the head again. Times count from the stop at the
    #: lane.
    carriers: list[Motion]
    #: For each line of the queue: from when the carrier stands in the bay until it is at the line's
    #: head, s.
    to_heads: list[float]


def motions_of(layout: Layout) -> list[JobMotions]:
    """Return how robots move in the jobs of a harvest, which are in the order of `jobs_of`."""
    route = route_of(layout)
    motions = []
    for picker, block in layout.blocks.items():
        for filling in fillings(route, picker, block):
            carriers = []
            to_heads = []
            for line, trip in enumerate(trips_of(route, filling.row, filling.side)):
                carriers.append(_motion_of(trip, begin_of(Deliver, trip)))
                to_heads.append(_to_head(route, trip, line))
            picker_motion = _motion_of(filling.steps, filling.went_on)
            motions.append(JobMotions(picker_motion, carriers, to_heads))
    return motions


def _to_head(route: OneWay, trip: Sequence[TimedStep], line: int) -> float:
    """Return the time from when a carrier stands in the bay until it is at a line's head, s."""
    unload = next(timed for timed in trip if isinstance(timed.step, Unload))
    first = line * route.queue.places + 1
    carrier = route.layout.machines["carrier"]
    way = [*route.go_to_line(first), DriveTo(x=route.queue.head)]
    return unload.handling + duration(way, unload.pose, carrier)


def _motion_of(plan: Sequence[TimedStep], zero: float) -> Motion:
    """Return the drives and turns of a part of a plan. `zero`: the time from which they count."""
    motion = Motion()
    is_towing = True
    may_fail = False
    for timed in plan:
        at = timed.begins - zero
        seconds = timed.ends - timed.begins
        if isinstance(timed.step, DriveTo) and seconds > 0.0:
            motion.drives.append(Drive(at, seconds, seconds * timed.speed, may_fail))
        elif isinstance(timed.step, Face) and seconds > 0.0:
            motion.turns.append(Turn(at, seconds, is_towing))
        elif isinstance(timed.step, Deliver | LeaveBin):
            is_towing = False
        elif isinstance(timed.step, TakeBin):
            is_towing = True
        may_fail = isinstance(timed.step, MayFail)
    return motion
