"""The jobs of a harvest: what picker and carrier need at least for each bin, from the plans that they follow in the simulator.

Times are in ticks, rounded down, with roads that are free. So no robot is faster, whatever sends it. Failures, batteries, people, animals
and errors of sensors are left out: they take time, and give none.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from orchard.agents.robot import ASK, Gate, Step
from orchard.agents.route import OneWay, Side
from orchard.agents.routes import route_of, timetable
from orchard.agents.steps import Alone, Deliver, DriveTo, FetchEmpty, Free, LeaveBin, Unload
from orchard.field.geometry import Pose
from orchard.field.layout import Layout
from orchard.field.queue import CLOSED_UP
from orchard.field.scenario import TIME_STEP

HANDOVER = (Deliver.handles + FetchEmpty.handles + ASK) * TIME_STEP  # s from a carrier's stop until its picker has the bin and the place
ROUNDING = 1e-6  # ticks


class NoBound(ValueError):
    """Raised for a harvest that has no proven bound; the text says why."""


@dataclass(frozen=True)
class Job:
    """An exchange of bins, in ticks. The picker leaves a full bin, and goes on with the empty one that a carrier has brought."""

    picker: str
    ready: int  #: from the time at which the picker went on before, or from the start, until a carrier can stand at its stop at the lane
    approach: int  #: from a carrier's order, in its line's head, to the stop
    going_on: int  #: from the stop until the picker goes on
    to_bay: int  #: from the stop until the carrier stands in the bay
    to_head: int  #: from there to its line's head
    to_rest: int  #: from there to where it stands when the harvest is over: behind the others of its line


class Moment(NamedTuple):
    """A step of a plan, the pose in which it begins, and when it begins and ends, s."""

    step: Step
    pose: Pose
    begins: float
    ends: float

    def at(self, gate: Gate) -> float:
        """When a drive comes to a gate, s."""
        assert isinstance(self.step, DriveTo)
        return self.begins + abs(gate.at - (self.pose.y if self.step.x is None else self.pose.x)) / self.step.speed


def jobs_of(layout: Layout) -> list[Job]:
    """Return the jobs of a harvest: those of each picker in its order. Raises NoBound."""
    route = route_of(layout)
    if own := sorted({*layout.scenario.agents, *layout.scenario.agents_without_body}):
        raise NoBound(f"the bound knows built-in agents only, and not {', '.join(own)}")
    if route.Steps:
        raise NoBound(f"the bound does not know the steps of your route: {', '.join(step.__name__ for step in route.Steps)}")
    return [job for picker in layout.blocks for job in _jobs_of(route, picker)]


def _jobs_of(route: OneWay, picker: str) -> Iterator[Job]:
    layout, block = route.layout, route.layout.blocks[picker]
    start = next(start.pose for start in layout.starts if start.name == picker)
    passes = iter([one for one in layout.passes(block) if one.leaves_bin])
    plan = list(_moments(route.harvest(block), start))
    went_on, left = 0.0, 0
    for number, (step, _, _, ends) in enumerate(plan):
        if isinstance(step, LeaveBin):
            left = number
        elif isinstance(step, FetchEmpty):
            one = next(passes)
            side = route.sides[one.end]
            ready = _freed(plan[left:number], side.place("D", one.row)) - went_on
            swings = any(isinstance(step, Alone) for step in (moment.step for moment in plan[number : number + 3]))
            yield _job(route, picker, one.row, side, ready, swings)
            went_on = ends


def _job(route: OneWay, picker: str, row: int, side: Side, ready: float, waits: bool) -> Job:
    """`ready`: s until the picker frees the lane's place. `waits`: whether it goes on only once the carrier has left that place."""
    layout, queue, place = route.layout, route.queue, side.place("D", row)
    approaches, holds, after, homes, rests = [], [], [], [], []
    for first in range(0, layout.queue_places, queue.places):  # of each line
        plan = list(_moments(route.fetch(first + 1, row, side, "", ""), queue.place(first)))
        stop = next(moment for moment in plan if isinstance(moment.step, Deliver))
        bay = next(moment for moment in plan if isinstance(moment.step, Unload))
        behind = (min(queue.places, layout.scenario.carrier_count - (0 if layout.first_charging else first)) - 1) * CLOSED_UP
        freed = _freed(plan[plan.index(stop) + 1 :], place) - stop.begins
        approaches.append(stop.begins)
        holds.append(stop.begins - _needed(plan, place))
        after.append(bay.begins - stop.begins)
        homes.append(plan[-1].ends - bay.begins)
        rests.append(plan[-1].ends - bay.begins - behind)
    going_on = max(HANDOVER, freed) if waits else HANDOVER
    return Job(
        picker,
        _ticks(ready + ASK * TIME_STEP + min(holds)),
        _ticks(min(approaches)),
        _ticks(going_on),
        _ticks(min(after)),
        _ticks(min(homes)),
        _ticks(min(rests)),
    )


def _moments(steps: Sequence[Step], start: Pose) -> Iterator[Moment]:
    """The moments of a plan on free roads. A step's answers and bins take its `ticks`."""
    late = 0.0
    for step, pose, begins, ends in timetable(list(steps), start):
        yield Moment(step, pose, begins + late, ends + late + step.ticks * TIME_STEP)
        late += step.ticks * TIME_STEP


def _needed(plan: Sequence[Moment], place: str) -> float:
    """When a robot first needs a place, s. Raises NoBound if it never does."""
    for moment in plan:
        gates = [gate for gate in getattr(moment.step, "needs", ()) if place in gate.places]
        if gates:
            return min(map(moment.at, gates))
    raise NoBound(f"the bound does not know a route whose carriers need no place {place}")


def _freed(plan: Sequence[Moment], place: str) -> float:
    """When a robot first gives a place back, s. Raises NoBound if it never does."""
    for moment in plan:
        if isinstance(moment.step, Free) and place in moment.step.places:
            return moment.begins
        if gates := [gate for gate in getattr(moment.step, "frees", ()) if place in gate.places]:
            return min(map(moment.at, gates))
    raise NoBound(f"the bound does not know a route whose robots do not give back the place {place}")


def _ticks(seconds: float) -> int:
    return int(seconds / TIME_STEP + ROUNDING)
