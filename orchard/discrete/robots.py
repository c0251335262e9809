"""A robot in the discrete-event model: it walks through the steps of its plan, and each takes the
time that it takes in the simulator.
"""

from collections.abc import Generator, Sequence
from functools import singledispatchmethod
from math import ceil, floor, inf
from types import SimpleNamespace
from typing import Any, Protocol, cast

import simpy

from orchard.behaviour.traffic import is_alone
from orchard.discrete.lines import CLEAR, Follower, Line, Lines, room
from orchard.discrete.places import MAIL, Claimant, Reservations, at, first_of
from orchard.event_model.bystanders import Bystanders
from orchard.event_model.results import Exchange
from orchard.field.geometry import Pose, nearest_heading
from orchard.field.kinds import KINDS, kind_of
from orchard.field.scenario import TIME_STEP, Battery
from orchard.plans import steps as st
from orchard.plans.robot import ASK, PATIENCE, Gate, Step
from orchard.plans.sense import SIDE_MARGIN

Events = Generator[simpy.Event, Any, None]
NEAR = 1e-6  # m
BESIDE = (
    KINDS["carrier"].width / 2 + KINDS["bin"].width / 2 + SIDE_MARGIN
)  # m from a line at which a robot is clear of it


class Surroundings(Protocol):
    """What a robot knows of the harvest."""

    env: simpy.Environment
    robots: dict[str, "Robot"]
    bystanders: Bystanders
    exit: float  # x at which carriers leave the queue, m
    left: dict[str, simpy.Event]  # full bin -> it is left in its lane
    battery: Battery
    calls: Any  # `Calls`, which imports this module

    def begin_row(self, picker: "Robot", before: float = 0.0) -> None: ...
    def end_row(self, picker: "Robot") -> None: ...
    def leave(self, picker: "Robot") -> None: ...
    def couple(self, picker: "Robot") -> None: ...
    def deliver(self) -> None: ...
    def home(self, carrier: "Robot") -> None: ...
    def charge(self, carrier: "Robot") -> Events: ...


class Roads:
    """The roads: which robot has which place, and which follows which."""

    def __init__(self, env: simpy.Environment) -> None:
        self.reservations, self.lines = Reservations(env), Lines()


class Robot(Follower):
    """A robot and its plan."""

    def __init__(
        self, model: "Surroundings", name: str, pose: Pose, bin_name: str, roads: Roads
    ) -> None:
        self.model, self.env, self.name, self.kind = model, model.env, name, KINDS[kind_of(name)]
        self.x, self.y, self.yaw = pose
        self.bin = bin_name
        self.lines, self.places = roads.lines, Claimant(model.env, roads.reservations, name)
        self.moved = self.env.event()
        self.has_offer = self.env.event()  # a carrier has brought a bin
        self.new_plan = self.env.event()
        self.memory = SimpleNamespace(plan=[], doing="", state="resting", failures=0, worked=0.0)
        self.meetings, self.turns = (
            0,
            0,
        )  # so far: times that it stood for people and animals on its way, and turns
        self.clear = model.bystanders.metres_to(name, 0)  # m to the next meeting
        self._leg: tuple[str, int, float, float, int, float] | None = (
            None  # the part of a drive that it is on
        )
        self.charge, self.moved_ticks, self.since = (
            1.0,
            0,
            0,
        )  # of its battery at the tick `since`; ticks for which it has moved since then
        self.is_charged = self.env.event()
        self.parked: float = inf  # tick since which it stands in a charging line; inf: it does not
        self.away = inf  # tick since which it has been outside the queue; inf: it is there
        self.stood = 0  # tick since which it stands
        self.plan: list[Step] = []
        self.done = 0  # steps
        self.offered, self.carrier, self.full_bin = (
            "",
            "",
            "",
        )  # the bin that a carrier has brought; that carrier; the bin that it left
        # The exchange for which it is out as a carrier, and its charge when it left.
        self.exchange: Exchange | None = None
        self.charge_at_start = 1.0
        self.taken: dict[str, int] = {}  # bin that was brought -> tick at which it was taken over

    @property
    def tick(self) -> int:
        return ceil(self.env.now)

    def run(self) -> Events:
        """Walk through the plan, and through each new one."""
        do = self.do  # each look-up of a method with many forms costs as much as a short step
        while True:
            while self.plan:
                if (events := do(self.plan.pop(0))) is not None:
                    yield from events
                self.done += 1
            yield self.new_plan

    def take(self, plan: list[Step]) -> None:
        """Leave the queue with another plan."""
        self.use_battery(0.0)
        self.charge_at_start = self.charge
        self.plan, self.away, self.parked = list(plan), inf, inf
        happened, self.new_plan = self.new_plan, self.env.event()
        happened.succeed()

    @property
    def x_now(self) -> float:
        """Its x now, m, also on the way."""
        if self._leg is None or self._leg[0] != "x":
            return self.x
        _, begun, was, stride, sign, limit = self._leg
        return sign * min(limit, was + (self.env.now - begun) * stride)

    @property
    def is_on_the_way(self) -> bool:
        return self._leg is not None

    @property
    def is_moving(self) -> bool:
        return self._leg is not None and self.env.now > self._leg[1]

    def wait(self, *events: simpy.Event) -> Events:
        """Wait for the first of these events, and then for the next tick."""
        yield first_of(self.env, events) if len(events) > 1 else events[0]
        if self.env.now % 1:
            yield self.env.timeout(ceil(self.env.now) - self.env.now)

    @singledispatchmethod
    def do(self, step: Step) -> Events | None:
        """Do a step: what happens until it is done, or nothing if it takes no time."""
        raise NotImplementedError(
            f"the discrete-event model does not know the step {type(step).__name__}"
        )

    # -- drives

    @do.register
    def _(self, step: st.DriveTo) -> Events:
        axis, sign = (
            "y" if step.x is None else "x",
            -1 if nearest_heading(self.yaw) in ("WEST", "SOUTH") else 1,
        )
        target = sign * (step.x if step.x is not None else cast(float, step.y))
        here = sign * (self.x if axis == "x" else self.y)
        # a bin that sees its picker drive into the row, perhaps through a part of it, can call from
        # then on
        said = [one.state if isinstance(one, st.Say) else "" for one in self.plan[:3]]
        if "picking" in said and said[0] in ("driving", "picking"):
            drives = (
                one.x for one in self.plan[: said.index("picking")] if isinstance(one, st.DriveTo)
            )
            self.model.begin_row(
                self, target - here + sum(abs(cast(float, x) - cast(float, step.x)) for x in drives)
            )
        line = (axis, round(self.y if axis == "x" else self.x, 3), sign)
        left_at, arrived = self._left_at(axis, sign, here), self._leave(line, here)
        stride, called = step.speed * TIME_STEP, [self.new_plan] if step.queueing else []
        meeting = here + self.clear
        needs, frees = (
            [(sign * gate.at, gate) for gate in step.needs],
            sorted((sign * gate.at, gate.places) for gate in step.frees),
        )
        while not (
            called and called[0].triggered
        ):  # a carrier that is called on its way to the head stands there, and then goes on
            while here > meeting - NEAR:
                meeting = here + (yield from self._meet())
            while frees and here > frees[0][0] - NEAR:
                self.places.free(frees.pop(0)[1])
            gate_at, ask, shut = self._next_gate(needs, here, step)
            if not arrived and here - left_at >= CLEAR - NEAR:
                arrived = self._arrive(line, here)
            before = self.lines.before(self, line, here)
            free_to = room(self, before) if before is not None else inf
            goal = min(target, gate_at, meeting)
            limit = min(goal, max(here, free_to))
            if arrived:
                self._extend(limit)
            if limit - here <= NEAR:
                self.stood = self.tick
                if target - here <= NEAR:
                    break
                yield from self._stand(shut, before if free_to <= here + NEAR else None, called)
                continue
            next_freed = next(
                (
                    gate_at
                    for gate_at, places in frees
                    if not set(places).isdisjoint(self.places.reserved)
                ),
                inf,
            )
            next_at = min(limit, next_freed, inf if arrived else left_at + CLEAR)
            ticks = min(ceil((next_at - here) / stride - NEAR), ask)
            begun, was = self.tick, here
            self._leg = (axis, begun, was, stride, sign, limit)
            yield self._pause(ticks, called, is_held_up=limit < goal)
            if before is not None and limit < goal:  # the one before it has driven on
                limit = max(limit, min(goal, room(self, before)))
            self.moved_ticks += self.tick - begun
            here, self._leg = min(limit, was + (self.tick - begun) * stride), None
            if axis == "x":
                if was <= self.model.exit < here and self.away == inf:
                    self.away = begun + (self.model.exit - was) / stride
                self.x = sign * here
            else:
                self.y = sign * here
        self.clear = meeting - here

    def _pause(self, ticks: float, called: list[simpy.Event], is_held_up: bool) -> simpy.Event:
        waits = bool(self.places.wanted)
        timeout = self.env.timeout(
            min(ticks, self.places.ticks_to_answer()) if waits and is_held_up else ticks
        )
        pause = first_of(self.env, [timeout, *called]) if called else timeout
        return self.places.granted_or(pause) if waits else pause

    def _stand(
        self, shut: simpy.Event | None, ahead: Follower | None, called: list[simpy.Event]
    ) -> Events:
        events = [
            *([shut] if shut is not None else []),
            *([ahead.moved] if ahead is not None else []),
            *called,
        ]
        if not self.places.wanted:
            yield from self.wait(*events)
        else:
            look = [self.env.timeout(self.places.ticks_to_answer())] if ahead is not None else []
            yield self.places.granted_or(first_of(self.env, [*look, *events]))

    def _meet(self) -> Generator[simpy.Event, Any, float]:
        yield self.env.timeout(self.model.bystanders.meeting_ticks(self.name, self.meetings))
        self.meetings += 1
        return self.model.bystanders.metres_to(self.name, self.meetings)

    def _next_gate(
        self, needs: list[tuple[float, Gate]], here: float, step: st.DriveTo
    ) -> tuple[float, float, simpy.Event | None]:
        """Drop the gates that it has passed, and those of places that it has.

        Return where the next one is, m, in how many ticks the robot asks for its places, and what
        happens when a bin is left before that.
        """
        while needs and (here > needs[0][0] + NEAR or self.places.has(needs[0][1].places)):
            del needs[0]
        if not needs:
            return inf, inf, None
        gate_at, gate = needs[0]
        if (before := gate_at - here - step.asks_before) >= -NEAR:
            return gate_at, max(1, floor(before / (step.speed * TIME_STEP) + NEAR) + 1), None
        if gate.bin and not (left := self.model.left[gate.bin]).triggered:
            return gate_at, inf, left
        self.places.want(gate.places)
        return gate_at, inf, None

    def _left_at(self, axis: str, sign: int, here: float) -> float:
        """Where a drive has left the robot's line, in the drive's direction: before its beginning
        if the robot has failed on the way.
        """
        return (
            min(here, sign * self.line[1])
            if self.line is not None and self.line[0] != axis
            else here
        )

    def _leave(self, line: Line, at: float) -> bool:
        return self.line == line or (self.line is None and self._arrive(line, at))

    def _arrive(self, line: Line, at: float) -> bool:
        self.lines.enter(self, line, at)
        self.line, self.end, self.is_across = line, at, False
        self._tell()
        return True

    def _extend(self, end: float) -> None:
        if end > self.end + NEAR:
            self.end = end
            self._tell()

    def _tell(self) -> None:
        """Let the robots behind go on, if they wait: in the next tick, and a tick later if they see
        its bin, which follows it.
        """
        if self.moved.callbacks:
            happened, self.moved = self.moved, self.env.event()
            at(self.env, self.env.now + (2 if self.bin else 1), happened.succeed)

    @do.register(st.Face)
    @do.register(st.Realign)
    def _(self, step: st.Face | st.Realign) -> Events:
        end, seconds = step.motion(self.pose)
        self.yaw, ticks = end.yaw, ceil(seconds / TIME_STEP - NEAR)
        if not ticks:
            return
        self.turns += 1
        self.moved_ticks += ticks
        if stands := self.model.bystanders.turning_ticks(self.name, self.turns, bool(self.bin)):
            yield self.env.timeout(stands)
        swung = floor(st.Face.swings * ticks)
        if self.bin and not self.is_across:
            yield self.env.timeout(swung)
            self.is_across = True
            self._tell()
            ticks -= swung
        elif (
            self.is_across
            and self.line is not None
            and abs((self.y if self.line[0] == "x" else self.x) - self.line[1]) > BESIDE
        ):
            yield self.env.timeout(swung)
            self.lines.leave(self)
            self.line = None
            self._tell()
            ticks -= swung
        yield self.env.timeout(ticks)
        self.stood = self.tick

    @do.register
    def _(self, step: st.Wait) -> Events:
        yield self.env.timeout(ceil(step.seconds / TIME_STEP - NEAR))

    @do.register
    def _(self, step: st.Say) -> None:
        before, self.memory.doing, self.memory.state = self.memory.state, step.doing, step.state
        if step.state == "picking":
            (self.model.calls.goes_on if before == "failed" else self.model.begin_row)(self)
        elif before == "picking":
            (self.model.calls.fails if step.state == "failed" else self.model.end_row)(self)

    @do.register(st.MayFail)
    @do.register(st.Repair)
    @do.register(st.Ahead)
    @do.register(st.MoveTo)
    @do.register(st.Again)
    def _(self, step: Step) -> None:
        """These steps put others before the rest of the plan."""
        self.memory.plan = [step, *self.plan]
        step.act(self)  # type: ignore[arg-type]  # it uses memory, pose, seen.name and next, as of a PlanExecutor
        self.plan = self.memory.plan[1:]

    def next(self, steps: Sequence[Step]) -> None:
        """Insert steps right after the present one."""
        self.memory.plan[1:1] = steps

    @property
    def seen(self) -> "Robot":
        """What a step may ask of an observation: the name."""
        return self

    @property
    def pose(self) -> Pose:
        return Pose(self.x, self.y, self.yaw)

    # -- places

    @do.register
    def _(self, step: st.Need) -> Events:
        while not self.places.has(step.places):
            self.places.want(step.places)
            yield self.places.granted_or(self.env.event())

    @do.register
    def _(self, step: st.Free) -> None:
        self.places.free(step.places)

    @do.register
    def _(self, step: st.Alone) -> Events:
        while not is_alone(self.places.reservations.table, self.name, step.place):
            yield self.env.timeout(PATIENCE)
        if not is_alone(self.places.seen, self.name, step.place):
            yield self.env.timeout(ASK)

    # -- bins

    def _handle(self, step: Step) -> Events:
        yield self.env.timeout(step.handles if self.stood == self.tick else 1)

    @do.register
    def _(self, step: st.LeaveBin) -> Events:
        yield from self._handle(step)
        self.full_bin, self.bin, self.offered, self.carrier = self.bin, "", "", ""
        self.model.leave(self)

    @do.register
    def _(self, step: st.Deliver) -> Events:
        yield from self._handle(step)
        brought, self.bin = self.bin, ""
        picker = self.model.robots[step.picker]
        picker.taken.pop(brought, None)  # it may have had this bin before
        asked = self.tick
        at(self.env, self.env.now + MAIL, lambda: picker.brought(brought, self.name))
        while picker.taken.get(brought, inf) > asked:
            yield self.env.timeout(PATIENCE)
            asked = self.tick
        yield self.env.timeout(ASK)

    def brought(self, bin_name: str, carrier: str) -> None:
        self.offered, self.carrier = bin_name, carrier
        happened, self.has_offer = self.has_offer, self.env.event()
        happened.succeed()

    @do.register
    def _(self, step: st.FetchEmpty) -> Events:
        if not self.offered:
            yield from self.wait(self.has_offer)
        yield from self._handle(step)
        self.bin = self.offered
        self.model.couple(self)
        while not self.places.has([step.place]):
            self.places.want([step.place], beside=self.carrier)
            yield self.places.granted_or(self.env.event())
        self.taken[self.offered] = self.tick

    @do.register
    def _(self, step: st.TakeBin) -> Events:
        yield from self._handle(step)
        self.bin = step.bin

    @do.register(st.Announce)
    @do.register(st.Confirmed)
    def _(self, step: st.Announce | st.Confirmed) -> Events:
        yield self.env.timeout(step.ticks)

    @do.register
    def _(self, step: st.Unload) -> Events:
        yield self.env.timeout(step.ticks)
        self.model.deliver()

    @do.register
    def _(self, step: st.BeginPickingAt) -> None:
        """Its drives tell where it picks."""

    @do.register
    def _(self, step: st.MayCharge) -> Events:
        self.use_battery(self.model.battery.standing)
        if self.charge <= 0.0:
            yield self.env.event()  # it stands flat for ever
        if self.charge <= step.reserve:
            self.plan = list(step.otherwise)

    @do.register
    def _(self, step: st.Charge) -> None:
        self.is_charged = self.env.event()
        self.env.process(self.model.charge(self))

    @do.register
    def _(self, step: st.Charged) -> Events:
        if not self.is_charged.triggered:
            yield from self.wait(self.is_charged)
        self.use_battery(0.0)

    def use_battery(self, standing: float) -> None:
        """Count what the battery was used for since it was last counted, or charged.

        `standing`: the power since then while it stood.
        """
        worked = self.moved_ticks + standing * (self.tick - self.since - self.moved_ticks)
        self.charge -= worked * TIME_STEP / 3600.0 / (self.model.battery.hours or inf)
        self.since, self.moved_ticks = self.tick, 0

    @do.register
    def _(self, step: st.Home) -> None:
        self.model.home(self)
