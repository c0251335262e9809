"""The jobs of a harvest: the least times that picker and carrier need for each bin, from the plans
that they follow in the simulator.

A job is an exchange of bins: a picker leaves a full bin, and a carrier brings an empty bin and
takes the full one to the bay. Bounds (orchard/report/bounds.py) and the proven schedule
(orchard/optimum) are made of jobs. Times are in ticks, rounded down, with roads that are free. So
no robot is faster, whatever carrier is sent. Failures, batteries, people, animals and errors of
sensors are left out: they only make a harvest longer. Absences of a picker depend on when a bin is
begun: `TimedJob.absent` has them apart.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import floor
from typing import NamedTuple

from orchard.field.geometry import Pose
from orchard.field.kinds import KINDS
from orchard.field.layout import Layout
from orchard.field.machines import Machine
from orchard.field.picking import Absences
from orchard.field.queue import CLOSED_UP
from orchard.field.rows import Block
from orchard.field.scenario import TIME_STEP
from orchard.plans.absent_drives import AbsentDrive, absent_drive
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
    MayFail,
    Need,
    Unload,
)

# Ticks, s or m that may be missing because of rounding.
ROUNDING = 1e-6
# `Use.ticks` of a place that its robot has not given back.
NOT_GIVEN_BACK = 0


class Use(NamedTuple):
    """A time in which a robot has a place alone, on free roads."""

    place: str
    #: When the robot comes to the gate of the place, s. In a job it counts from the carrier's stop
    #: at the lane, and is negative before it.
    at: float
    #: Ticks from then until another robot can be at a gate of the place: the place was given back,
    #: and the other robot has heard of it.
    ticks: int


@dataclass(frozen=True)
class TimedJob:
    """An exchange of bins, in ticks.

    The picker leaves a full bin, and goes on with the empty bin that a carrier has brought. The
    stop is where and when the carrier stops at the lane, at the earliest; times of uses count from
    it. The picker goes on when it has the empty bin.
    """

    picker: str
    lane: int
    #: The end of the lane: 'east' or 'west'.
    side: str
    #: The places that the picker uses from the time at which it last went on, in its order.
    crossings: list[Use]
    #: Ticks from the time at which the picker last went on, or from the start, to the stop.
    ready: int
    #: The part of `ready` after the time at which the bin is full, as bins report it.
    clearing: int
    #: The places that the carrier uses from the first lane on, in its order.
    way: list[Use]
    #: For each line of the queue: the ticks from its head to the stop, and the places that the
    #: carrier uses before `way`.
    exits: list[tuple[int, list[Use]]]
    #: Ticks from a carrier's order, at the head of its line, to the stop: the least of `exits`.
    approach: int
    #: Ticks from the stop until the picker goes on.
    going_on: int
    #: Ticks from the stop until the carrier stands in the bay.
    to_bay: int
    #: Ticks from then until the carrier knows that its bin is empty.
    in_bay: int
    #: Ticks from the time at which the carrier stands in the bay to the head of its line.
    to_head: int
    #: The same to where it stands when the harvest is over: behind the others of its line.
    to_rest: int
    #: The drives on which the picker may go away, before it leaves the full bin.
    absent: tuple[AbsentDrive, ...] = ()

    @property
    def all_there(self) -> int:
        """The tick from which on its picker is not away any more; 0 if it never is."""
        last = 0.0
        for drive in self.absent:
            for _, end in drive.absences:
                last = max(last, end)
        return ticks(last)

    def earliest_stop(self, went_on: int) -> int:
        """Return the earliest tick of the stop. `went_on`: that at which the picker went on, at the
        earliest.
        """
        late = 0.0
        for drive in self.absent:
            late += drive.delay(went_on * TIME_STEP + drive.begins + late)
        return went_on + self.ready + ticks(late)


class TimedStep(NamedTuple):
    """A step of a plan, the pose in which it begins, and when it begins and ends, s."""

    step: Step
    pose: Pose
    begins: float
    ends: float
    #: m/s, of a drive; else 0.
    speed: float
    #: The part of the step beside motion, s: for bins that are handled, and for answers.
    handling: float

    def at(self, gate: Gate) -> float | None:
        """Return when a drive comes to a gate, s; None if it does not."""
        assert isinstance(self.step, DriveTo)
        if self.step.x is None:
            here = self.pose.y
            target = self.step.y
        else:
            here = self.pose.x
            target = self.step.x
        assert target is not None
        direction = 1.0
        if target < here:
            direction = -1.0
        ahead = (gate.at - here) * direction
        if -ROUNDING < ahead < abs(target - here) + ROUNDING:
            return self.begins + ahead / self.speed
        return None

    @property
    def needs(self) -> list[tuple[str, float]]:
        """The places that the robot must have from this step on, and from when on, s."""
        if isinstance(self.step, Need):
            return [(place, self.ends) for place in self.step.places]
        if isinstance(self.step, DriveTo):
            return self._passed(self.step.needs)
        return []

    @property
    def frees(self) -> list[tuple[str, float]]:
        """The places that the robot gives back in this step, and when, s."""
        if isinstance(self.step, Free):
            return [(place, self.begins) for place in self.step.places]
        if isinstance(self.step, DriveTo):
            return self._passed(self.step.frees)
        return []

    def _passed(self, gates: Sequence[Gate]) -> list[tuple[str, float]]:
        """Return the places of the gates to which the drive comes, and when, s."""
        passed = []
        for gate in gates:
            seconds = self.at(gate)
            if seconds is not None:
                passed += [(place, seconds) for place in gate.places]
        return passed


def handover_seconds(layout: Layout) -> float:
    """Return the least time of a handover, s: from a carrier's stop until its picker goes on.

    The picker then has the bin and the place. It hears of the bin ASK ticks after it stands.
    """
    carrier = layout.machines["carrier"]
    picker = layout.machines["picker"]
    handling = carrier.uncoupling_ticks + picker.coupling_ticks + picker.exchange_ticks
    return (handling + ASK) * TIME_STEP


def least_headway(carrier: Machine) -> float:
    """Return how far a carrier is behind another one with a bin, at least, m between centres.

    It stops for what is nearer to its front than `STOP_DISTANCE`, and may have driven on for a tick
    by then.
    """
    kind = KINDS["carrier"]
    tail = kind.tows + KINDS["bin"].length / 2
    return tail + STOP_DISTANCE + kind.length / 2 - carrier.speed * TIME_STEP


@dataclass(frozen=True)
class Filling:
    """What a picker does with one bin: from when it goes on with it empty, until it wants the next.

    Times count from the start of the harvest, without any wait for carriers.
    """

    picker: str
    #: The row at whose end the bin is full, and is exchanged for an empty one.
    row: int
    #: Of that end.
    side: Side
    #: When the picker went on with the empty bin, or started, s.
    went_on: float
    steps: Sequence[TimedStep]
    #: Whether the picker goes on only once the carrier has left the lane's place.
    waits_for_place: bool


def jobs_of(layout: Layout) -> list[TimedJob]:
    """Return the jobs of a harvest: those of each picker in its order.

    Raises ValueError for a route on which robots do not take turns at the lanes.
    """
    route = route_of(layout)
    jobs = []
    for picker, block in layout.blocks.items():
        for filling in fillings(route, picker, block):
            jobs.append(_job(route, filling))
    return jobs


def fillings(route: OneWay, picker: str, block: Block) -> Iterator[Filling]:
    """Yield what a picker does with each of its bins, on free roads."""
    layout = route.layout
    start = layout.starts[layout.index[picker]].pose
    plan = list(timed_steps(route.harvest(block), start, layout.machines["picker"]))
    passes_with_bin = [current for current in layout.passes(block) if current.leaves_bin]
    # Each of these passes ends with a `FetchEmpty`.
    fetches = [number for number, timed in enumerate(plan) if isinstance(timed.step, FetchEmpty)]
    first = 0
    went_on = 0.0
    for filled, fetch in enumerate(fetches):
        current = passes_with_bin[filled]
        # `Alone` follows within two steps, after a `Say`: see `PickerWays.go_to_next_row`.
        following = plan[fetch + 1 : fetch + 3]
        yield Filling(
            picker=picker,
            row=current.row,
            side=route.sides[current.end],
            went_on=went_on,
            steps=plan[first:fetch],
            waits_for_place=any(isinstance(after.step, Alone) for after in following),
        )
        first = fetch + 1
        went_on = plan[fetch].ends


def _job(route: OneWay, filling: Filling) -> TimedJob:
    """Return the job that takes the full bin away, and brings the picker an empty one.

    Raises ValueError for a route on which robots do not take turns at the lane.

    A carrier's trip begins at the head of its line; all times of a trip count from then. Times of a
    picker count from the start of the harvest.
    """
    layout = route.layout
    carrier = layout.machines["carrier"]
    row = filling.row
    side = filling.side
    trips = trips_of(route, row, side)
    way = _uses(trips[0])
    stop = begin_of(Deliver, trips[0])
    crossings = _uses(filling.steps)
    place = side.place("D", row)
    of_carrier = _use_of(place, way)
    of_picker = _use_of(place, reversed(crossings))
    if of_carrier is None or of_picker is None:
        raise ValueError(
            f"robots need no place {place} on your route, or do not give it back: so it is not"
            " known when they are there"
        )
    # When a carrier that waits before the lane's place can be at its stop: the picker has given the
    # place back, and the carrier drives from the gate to the stop.
    ready = of_picker.at + of_picker.ticks * TIME_STEP + stop - of_carrier.at
    beyond = layout.beyond(row, side.name) / layout.machines["picker"].speed
    going_on = handover_seconds(layout)
    if filling.waits_for_place:
        # s from the stop until the carrier gives the place back. The last ASK ticks of a use are
        # those in which another robot hears of that; the picker shares the place already.
        leaves_place = of_carrier.at + (of_carrier.ticks - ASK) * TIME_STEP - stop
        going_on = max(going_on, leaves_place)
    # The ways from all lines of the queue join before the first lane. On the route `one-way` that
    # is the first lane of the east side for both sides.
    first_lane = (side.place("D", 1), route.east.place("D", 1))
    joins = min(use.at for use in way if use.place in first_lane)
    exits = [_exit(trip, until=joins - stop) for trip in trips]
    to_rest = [_seconds_to_rest(route, trip) for trip in trips]
    return TimedJob(
        picker=filling.picker,
        lane=row,
        side=side.name,
        crossings=[use._replace(at=use.at - ready) for use in crossings],
        ready=ticks(ready - filling.went_on),
        clearing=ticks(ready - _filled_at(filling.steps) - beyond),
        way=[use._replace(at=use.at - stop) for use in way if use.at >= joins],
        exits=exits,
        approach=min(approach for approach, _ in exits),
        going_on=ticks(going_on),
        to_bay=ticks(min(begin_of(Unload, trip) - begin_of(Deliver, trip) for trip in trips)),
        in_bay=Unload().ticks(carrier),
        to_head=ticks(min(trip[-1].ends - begin_of(Unload, trip) for trip in trips)),
        to_rest=ticks(min(to_rest)),
        absent=tuple(_absent_drives(filling, until=of_picker.at)),
    )


def _absent_drives(filling: Filling, until: float) -> Iterator[AbsentDrive]:
    """Yield the drives of a filling on which its picker may go away.

    `until`: when the picker comes to the lane's place, s. A carrier waits for no drive after that.
    """
    for before, timed in pairwise(filling.steps):
        absences: Absences = ()
        if isinstance(before.step, MayFail):
            absences = before.step.absences
        if absences and isinstance(timed.step, DriveTo) and timed.begins < until:
            begins = timed.begins - filling.went_on
            yield absent_drive(timed.step, timed.pose, timed.speed, begins, absences)


def trips_of(route: OneWay, row: int, side: Side) -> list[list[TimedStep]]:
    """Return a carrier's trips, one from the head of each line of the queue: to an end of a row, to
    the bay and back, on free roads.
    """
    carrier = route.layout.machines["carrier"]
    trips = []
    # The number of the place, from 0, at the head of each line.
    for head in range(0, route.layout.queue_places, route.queue.places):
        # The names of picker and bin do not matter for times.
        steps = route.fetch(head + 1, row, side, picker="", full_bin="")
        trips.append(list(timed_steps(steps, route.queue.place(head), carrier)))
    return trips


def _use_of(place: str, uses: Iterable[Use]) -> Use | None:
    """Return the first use of a place; None if there is none."""
    for use in uses:
        if use.place == place:
            return use
    return None


def _filled_at(steps: Sequence[TimedStep]) -> float:
    """Return when a picker's bin is full and at the row's end, s.

    That is when the picker begins its last drive before it leaves the bin in the lane's mouth.
    """
    filled = 0.0
    for timed in steps:
        if isinstance(timed.step, LeaveBin):
            break
        if isinstance(timed.step, DriveTo):
            filled = timed.begins
    return filled


def _exit(trip: Sequence[TimedStep], until: float) -> tuple[int, list[Use]]:
    """Return the ticks that a carrier drives from its line's head to its stop, and the places that
    it uses on that way before a time.

    `until`: s from the stop; negative before it.
    """
    stop = begin_of(Deliver, trip)
    uses = []
    for use in _uses(trip):
        after_stop = use.at - stop
        if after_stop < until - ROUNDING:
            uses.append(use._replace(at=after_stop))
    return ticks(stop), uses


def _seconds_to_rest(route: OneWay, trip: Sequence[TimedStep]) -> float:
    """Return the least time from the bay until a carrier stands in its line for good, s.

    The carrier may be the last one to come to a line that is else full, and then it need not drive
    to the head. But it is away at the load-out in any case.
    """
    carrier = route.layout.machines["carrier"]
    in_line = min(route.queue.places, route.layout.scenario.carrier_count)
    behind = (in_line - 1) * CLOSED_UP / carrier.speed
    unloads = begin_of(Unload, trip)
    to_head = trip[-1].ends - unloads
    return max(to_head - behind, _back(trip, carrier) - unloads)


def _back(trip: Sequence[TimedStep], carrier: Machine) -> float:
    """Return when a carrier is back from the load-out, s; without one, when it unloads."""
    for timed in trip:
        if isinstance(timed.step, Haul):
            return timed.begins + carrier.haul_ticks * TIME_STEP
    return begin_of(Unload, trip)


def timed_steps(steps: Sequence[Step], start: Pose, machine: Machine) -> Iterator[TimedStep]:
    """Yield the steps of a machine's plan on free roads, with their times.

    Beside its motion each step takes its `ticks`, for bins that are handled and for answers.
    """
    # s by which the steps before have taken longer than their motion.
    late = 0.0
    for step, pose, begins, ends in timetable(list(steps), start, machine):
        handling = step.ticks(machine) * TIME_STEP
        speed = 0.0
        if isinstance(step, DriveTo):
            speed = step.speed_of(machine)
        yield TimedStep(
            step=step,
            pose=pose,
            begins=begins + late,
            ends=ends + late + handling,
            speed=speed,
            handling=handling,
        )
        late += handling


def begin_of(kind: type[Step], plan: Sequence[TimedStep]) -> float:
    """Return when the first step of a kind begins, s. There must be one in the plan."""
    return next(timed.begins for timed in plan if isinstance(timed.step, kind))


def _uses(plan: Sequence[TimedStep]) -> list[Use]:
    """Return the places that a robot has on its way, in the order in which it comes to them.

    Places that it does not give back are left out: it is not known when others can have them.
    """
    uses: list[Use] = []
    # Place -> the number in `uses` of its use, until the place is given back.
    open_uses: dict[str, int] = {}
    for timed in plan:
        for place, at in timed.needs:
            if place not in open_uses:
                open_uses[place] = len(uses)
                uses.append(Use(place, at, NOT_GIVEN_BACK))
        for place, at in timed.frees:
            if place in open_uses:
                number = open_uses.pop(place)
                uses[number] = uses[number]._replace(ticks=ticks(at - uses[number].at) + ASK)
    given_back = [use for use in uses if use.ticks != NOT_GIVEN_BACK]
    return sorted(given_back, key=lambda use: use.at)


def ticks(seconds: float) -> int:
    """Return the ticks that a time takes at least."""
    return floor(seconds / TIME_STEP + ROUNDING)
