"""The jobs of a harvest: what picker and carrier need at least for each bin, from the plans that
they follow in the simulator.

Times are in ticks, rounded down, with roads that are free. So no robot is faster, whatever sends
it. Failures, batteries, people, animals and errors of sensors are left out: they take time, and
give none.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import floor
from typing import NamedTuple

from orchard.field.geometry import Pose
from orchard.field.kinds import KINDS
from orchard.field.layout import Layout
from orchard.field.machines import Machine
from orchard.field.queue import CLOSED_UP
from orchard.field.rows import Block
from orchard.field.scenario import TIME_STEP
from orchard.plans.robot import ASK, Gate, Step
from orchard.plans.route import OneWay, Side
from orchard.plans.routes import route_of, timetable
from orchard.plans.sense import STOP_DISTANCE
from orchard.plans.steps import (
    Alone,
    Deliver,
    DriveTo,
    FetchEmpty,
    Free,
    Haul,
    LeaveBin,
    Need,
    Unload,
)

ROUNDING = 1e-6  # ticks


class Use(NamedTuple):
    """A place that a robot has alone, on free roads."""

    place: str
    #: When the robot comes to the gate of the place, s from the carrier's stop at the lane on;
    #: negative before it.
    at: float
    #: Until another robot can be at a gate of it: the place was given back, and the other one has
    #: heard of it.
    ticks: int


@dataclass(frozen=True)
class TimedJob:
    """An exchange of bins, in ticks.

    The picker leaves a full bin, and goes on with the empty one that a carrier has brought.
    """

    picker: str
    lane: int
    side: str  #: the end of the lane
    crossings: list[Use]  #: of the picker since then, in their order
    #: From the time at which the picker went on before, or from the start, until a carrier can
    #: stand at its stop at the lane.
    ready: int
    clearing: int  #: of it, from the full bin in the lane, as bins report it, on
    way: list[Use]  #: of the carrier, from the first lane on, in their order
    exits: list[
        tuple[int, list[Use]]
    ]  #: of each line of the queue: the ticks from its head to the stop, and the uses before `way`
    approach: int  #: from a carrier's order, in its line's head, to the stop
    going_on: int  #: from the stop until the picker goes on
    to_bay: int  #: from the stop until the carrier stands in the bay
    in_bay: int  #: from there until it knows that its bin is empty
    to_head: int  #: from there to its line's head
    #: From there to where it stands when the harvest is over: behind the others of its line.
    to_rest: int


class TimedStep(NamedTuple):
    """A step of a plan, the pose in which it begins, and when it begins and ends, s."""

    step: Step
    pose: Pose
    begins: float
    ends: float
    #: m/s, of a drive; else 0.
    speed: float
    #: s of it, beside motion: for bins that are handled, and for answers.
    handling: float

    def at(self, gate: Gate) -> float | None:
        """When a drive comes to a gate, s; None if it does not."""
        assert isinstance(self.step, DriveTo)
        here, target = (
            (self.pose.y, self.step.y) if self.step.x is None else (self.pose.x, self.step.x)
        )
        assert target is not None
        ahead = (gate.at - here) * (1.0 if target >= here else -1.0)
        return (
            self.begins + ahead / self.speed
            if -ROUNDING < ahead < abs(target - here) + ROUNDING
            else None
        )

    @property
    def needs(self) -> list[tuple[str, float]]:
        """The places from which on it must have them, and when, s."""
        if isinstance(self.step, Need):
            return [(place, self.ends) for place in self.step.places]
        return self._passed(self.step.needs) if isinstance(self.step, DriveTo) else []

    @property
    def frees(self) -> list[tuple[str, float]]:
        """The places that it gives back, and when, s."""
        if isinstance(self.step, Free):
            return [(place, self.begins) for place in self.step.places]
        return self._passed(self.step.frees) if isinstance(self.step, DriveTo) else []

    def _passed(self, gates: Sequence[Gate]) -> list[tuple[str, float]]:
        return [
            (place, at)
            for gate in gates
            if (at := self.at(gate)) is not None
            for place in gate.places
        ]


def handover_seconds(layout: Layout) -> float:
    """Return the time from a carrier's stop until its picker has the bin and the place, and goes
    on, s.
    """
    carrier = layout.machines["carrier"]
    picker = layout.machines["picker"]
    handling = carrier.uncoupling_ticks + picker.coupling_ticks + picker.exchange_ticks
    return (handling + ASK) * TIME_STEP


def least_headway(carrier: Machine) -> float:
    """Return how far a carrier is behind one with a bin, at least, from centre to centre, m.

    It stops for what is nearer to its front than `STOP_DISTANCE`, and may have begun a step then.
    """
    kind = KINDS["carrier"]
    tail = kind.tows + KINDS["bin"].length / 2
    return tail + STOP_DISTANCE + kind.length / 2 - carrier.speed * TIME_STEP


def jobs_of(layout: Layout) -> list[TimedJob]:
    """Return the jobs of a harvest: those of each picker in its order.

    Raises ValueError for a route on which robots do not take turns at the lanes.
    """
    route = route_of(layout)
    return [
        job for picker, block in layout.blocks.items() for job in _jobs_of(route, picker, block)
    ]


def _jobs_of(route: OneWay, picker: str, block: Block) -> Iterator[TimedJob]:
    layout = route.layout
    start = next(start.pose for start in layout.starts if start.name == picker)
    passes = iter([one for one in layout.passes(block) if one.leaves_bin])
    plan = list(timed_steps(route.harvest(block), start, layout.machines["picker"]))
    begins, went_on = 0, 0.0
    for number, moment in enumerate(plan):
        if isinstance(moment.step, FetchEmpty):
            one = next(passes)
            waits = any(isinstance(after.step, Alone) for after in plan[number : number + 3])
            yield _job(
                route, picker, one.row, route.sides[one.end], plan[begins:number], went_on, waits
            )
            begins, went_on = number + 1, moment.ends


def _job(
    route: OneWay,
    picker: str,
    row: int,
    side: Side,
    before: Sequence[TimedStep],
    went_on: float,
    waits: bool,
) -> TimedJob:
    """`before`: the picker's steps since it `went_on`, s. `waits`: whether it goes on only once the
    carrier has left the lane's place.
    """
    layout, queue, place = route.layout, route.queue, side.place("D", row)
    lines = range(0, layout.queue_places, queue.places)
    carrier = layout.machines["carrier"]
    handover = handover_seconds(layout)
    plans = []
    for first in lines:
        steps = route.fetch(first + 1, row, side, "", "")
        plans.append(list(timed_steps(steps, queue.place(first), carrier)))
    homes = [plan[-1].ends - begin_of(Unload, plan) for plan in plans]
    backs = [_back(plan, carrier) - begin_of(Unload, plan) for plan in plans]
    counts = [
        layout.scenario.carrier_count - (0 if layout.first_charging else first) for first in lines
    ]
    behind = [(min(queue.places, count) - 1) * CLOSED_UP / carrier.speed for count in counts]
    stop, way = begin_of(Deliver, plans[0]), _uses(plans[0])
    of_lane = next((use for use in way if use.place == place), None)
    crossings = _uses(before)
    ready = next((use for use in reversed(crossings) if use.place == place), None)
    if of_lane is None or ready is None:
        raise ValueError(
            f"robots need no place {place} on your route, or do not give it back: so it is not"
            " known when they are there"
        )
    stands = (
        ready.at + ready.ticks * TIME_STEP + stop - of_lane.at
    )  # when a carrier that holds before the lane can stand there
    gone = of_lane.at + (of_lane.ticks - ASK) * TIME_STEP - stop
    begins = min(
        use.at for use in way if use.place in (side.place("D", 1), route.east.place("D", 1))
    )  # all lines lead to there
    left = next(number for number, moment in enumerate(before) if isinstance(moment.step, LeaveBin))
    exits = [
        (ticks(begin_of(Deliver, plan)), _before(plan, begin_of(Deliver, plan), begins - stop))
        for plan in plans
    ]
    full = next(
        moment.begins for moment in reversed(before[:left]) if isinstance(moment.step, DriveTo)
    )  # at the row's end
    return TimedJob(
        picker,
        row,
        side.name,
        [use._replace(at=use.at - stands) for use in crossings],
        ticks(stands - went_on),
        ticks(stands - full - layout.beyond(row, side.name) / layout.machines["picker"].speed),
        [use._replace(at=use.at - stop) for use in way if use.at >= begins],
        exits,
        min(approach for approach, _ in exits),
        ticks(max(handover, gone) if waits else handover),
        ticks(min(begin_of(Unload, plan) - begin_of(Deliver, plan) for plan in plans)),
        Unload().ticks(carrier),
        ticks(min(homes)),
        ticks(
            min(
                max(home - room, back)
                for home, room, back in zip(homes, behind, backs, strict=True)
            )
        ),
    )


def _back(plan: Sequence[TimedStep], carrier: Machine) -> float:
    """Return when a carrier is back from the load-out, s; when it unloads, if it does not go."""
    for moment in plan:
        if isinstance(moment.step, Haul):
            return moment.begins + carrier.haul_ticks * TIME_STEP
    return begin_of(Unload, plan)


def _before(plan: Sequence[TimedStep], stop: float, until: float) -> list[Use]:
    """What a carrier uses until so many seconds from its stop on."""
    return [
        use._replace(at=use.at - stop) for use in _uses(plan) if use.at - stop < until - ROUNDING
    ]


def timed_steps(steps: Sequence[Step], start: Pose, machine: Machine) -> Iterator[TimedStep]:
    """Yield the steps of a machine's plan on free roads, with their times.

    A step's answers and bins take its `ticks`.
    """
    late = 0.0
    for step, pose, begins, ends in timetable(list(steps), start, machine):
        handling = step.ticks(machine) * TIME_STEP
        speed = step.speed_of(machine) if isinstance(step, DriveTo) else 0.0
        yield TimedStep(step, pose, begins + late, ends + late + handling, speed, handling)
        late += handling


def begin_of(kind: type[Step], plan: Sequence[TimedStep]) -> float:
    """Return when the first step of a kind begins, s."""
    return next(moment.begins for moment in plan if isinstance(moment.step, kind))


def _uses(plan: Sequence[TimedStep]) -> list[Use]:
    """The places that a robot has on its way, in the order in which it comes to them."""
    uses, open_uses = list[Use](), dict[str, int]()
    for moment in plan:
        for place, at in moment.needs:
            if place not in open_uses:
                open_uses[place] = len(uses)
                uses.append(Use(place, at, 0))
        for place, at in moment.frees:
            if place in open_uses:
                number = open_uses.pop(place)
                uses[number] = uses[number]._replace(ticks=ticks(at - uses[number].at) + ASK)
    return sorted((use for use in uses if use.ticks), key=lambda use: use.at)


def ticks(seconds: float) -> int:
    """Return the ticks that a time takes at least."""
    return floor(seconds / TIME_STEP + ROUNDING)
