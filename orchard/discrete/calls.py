"""Which carrier fetches which bin in the discrete-event model: the same policies, and the ticks
that their letters take.
"""

from collections.abc import Container, Iterable
from dataclasses import dataclass
from math import ceil

import simpy

from orchard.behaviour.bin import CALL_AGAIN
from orchard.behaviour.carrier import REMEMBERED, HeardCall, can_leave, first_call
from orchard.behaviour.dispatcher import (
    BOOKED_TICKS,
    POLL_TICKS,
)
from orchard.discrete.places import at
from orchard.discrete.robots import Events, Robot
from orchard.dispatch.policy import Assignment, BinReport, CarrierReport, is_early
from orchard.dispatch.ranking import MARGIN
from orchard.event_model.policies import AskedPolicy
from orchard.field.kinds import number_of
from orchard.field.scenario import TIME_STEP
from orchard.plans.forecast import horizon
from orchard.plans.robot import ASK
from orchard.plans.route import OneWay, Side
from orchard.plans.routes import way_to

HEARD = ASK  # ticks from a call, by way of an offer, to the order that follows it
ORDERED = 1  # tick from an order to the carrier


@dataclass
class OpenCall:
    """A bin that needs a carrier."""

    bin: str
    picker: str
    lane: int
    side: Side
    since: int  # tick at which it began to call
    full: float  # tick at which it will be full, or was
    failed: int = -1  # tick since which its picker has stood because it failed; -1: it picks
    is_reported: bool = False  # to the dispatcher
    learned: int = -1  # tick of the question at which the policy learned of it outside a decision

    def left(self, now: int) -> float:
        """Return the ticks until it is full; negative since then."""
        return self.full - (now if self.failed < 0 else self.failed)


@dataclass
class DispatchDecision:
    """A time at which carriers can be sent to bins: what a policy is told, and the calls and robots
    that it is about.
    """

    now: int  # tick
    bins: list[BinReport]
    carriers: list[CarrierReport]
    calls: dict[str, OpenCall]  # bin -> its call
    ready: dict[str, Robot]  # carrier that can leave -> the robot

    @property
    def is_open(self) -> bool:
        """Whether a carrier can be sent to a bin."""
        return bool(self.bins) and any(carrier.is_next for carrier in self.carriers)


class Calls:
    """The calls of bins that ask all carriers: the oldest one gets the nearest carrier that can
    leave.
    """

    def __init__(self, env: simpy.Environment, route: OneWay, carriers: list[Robot]) -> None:
        self.env, self.route, self.layout, self.free = env, route, route.layout, list(carriers)
        self._calling: dict[int, list[OpenCall]] = {}  # tick -> the bins that call then
        self._heard: dict[str, HeardCall] = {}  # bin -> its call, as all carriers heard it
        self._offered: dict[str, dict[str, int]] = {
            robot.name: {} for robot in carriers
        }  # carrier -> bin -> tick of its first offer

    def begins(self, robot: Robot, lane: int, side: Side, seconds: float, seen: int) -> None:
        """Hear that a picker begins a row, or to drive into it; when its bin sees that, a tick; and
        in how many seconds it will be full.
        """

    def fails(self, robot: Robot) -> None:
        """Hear that a picker stands in its row because it failed."""

    def goes_on(self, robot: Robot) -> None:
        """Hear that a picker is repaired."""

    def left(self, robot: Robot, lane: int, side: Side) -> None:
        self._call(
            OpenCall(robot.full_bin, robot.name, lane, side, robot.tick, robot.tick), robot.tick
        )

    def home(self, robot: Robot) -> None:
        self.free.append(robot)

    def ready(self) -> list[Robot]:
        head = self.layout.queue.head
        return [robot for robot in self.free if can_leave(head - robot.x_now, robot.is_moving)]

    def _call(self, call: OpenCall, tick: int) -> None:
        if tick not in self._calling:
            self._calling[tick] = []
            at(self.env, tick + 1, lambda: self._hear(tick))
        self._calling[tick].append(call)

    def _hear(self, tick: int) -> None:
        calls, now = {call.bin: call for call in self._calling.pop(tick)}, tick + 1
        self._heard |= {call.bin: HeardCall(call.since, now) for call in calls.values()}
        offers: dict[str, list[Robot]] = {}
        for robot in self.ready():
            offered = self._offered[robot.name]
            self._heard = {
                name: heard for name, heard in self._heard.items() if now - heard.tick <= REMEMBERED
            }
            first = first_call(self._heard, offered, now)
            if first in calls:
                offered.setdefault(first, now)
                offers.setdefault(first, []).append(robot)
        for call in calls.values():
            self._choose(call, offers.get(call.bin, []), tick)

    def _choose(self, call: OpenCall, offers: list[Robot], tick: int) -> None:
        if not offers:
            return self._call(call, tick + CALL_AGAIN)
        chosen = min(
            offers,
            key=lambda robot: (
                round(self.route.distance(robot.x_now, robot.y, call.lane, call.side), 3),
                robot.name,
            ),
        )
        at(self.env, tick + 1 + HEARD, lambda: self._come(call, chosen))

    def _come(self, call: OpenCall, carrier: Robot) -> None:
        if carrier not in self.free:
            return self._call(call, ceil(self.env.now) + 1)
        self.free.remove(carrier)
        self._offered[carrier.name].clear()
        self.start(call, carrier)

    def start(self, call: OpenCall, carrier: Robot) -> None:
        number = self.route.number(number_of(carrier.name), carrier.y)
        carrier.take(self.route.fetch(number, call.lane, call.side, call.picker, call.bin))


class Dispatched(Calls):
    """The calls of bins that report to the dispatcher, which asks the policy of the scenario."""

    def __init__(self, env: simpy.Environment, route: OneWay, carriers: list[Robot]) -> None:
        super().__init__(env, route, carriers)
        self.open, self._changed = list[OpenCall](), env.event()
        self.asked = AskedPolicy(route.layout)
        self.policy = self.asked.policy
        ends = [(lane.number, side) for lane in self.layout.lanes for side in route.sides.values()]
        self._ways = {(lane, side.name): way_to(route, lane, side) for lane, side in ends}
        self.horizon = horizon(self.layout) / TIME_STEP  # ticks before it is full, to report
        self._ripening: dict[str, OpenCall] = {}  # picker -> the call of the bin that it fills
        self._booked: set[str] = set()
        self._carriers = sorted(carriers, key=lambda robot: robot.name)
        self._jobs: dict[
            str, tuple[str, int]
        ] = {}  # carrier -> the bin that it fetches, and the tick at which that bin was told
        self._asked = (
            self._decided
        ) = -POLL_TICKS  # ticks of the last question to the carriers, and of its answers
        self._knows_policy = type(self) is Dispatched and self.asked.is_built_in
        env.process(self.run())

    def begins(self, robot: Robot, lane: int, side: Side, seconds: float, seen: int) -> None:
        if not is_early(self.policy):
            return
        full, call = robot.tick + seconds / TIME_STEP, self._ripening.get(robot.name)
        if call is None or call.bin != robot.bin:
            call = self._ripening[robot.name] = OpenCall(
                robot.bin, robot.name, lane, side, seen, full
            )
        self._learn(call)
        call.full = full
        if not call.is_reported:
            call.since = max(seen, ceil(full - self.horizon))
            self.env.process(self._later(call))

    def fails(self, robot: Robot) -> None:
        if call := self._ripening.get(robot.name):
            self._learn(call)
            call.failed = robot.tick

    def goes_on(self, robot: Robot) -> None:
        if call := self._ripening.get(robot.name):
            self._learn(call)
            call.full, call.failed = call.full + robot.tick - call.failed, -1

    def _later(self, call: OpenCall) -> Events:
        yield self.env.timeout(call.since - self.env.now)
        if not call.is_reported and call.since <= ceil(self.env.now):  # else it was estimated anew
            call.is_reported = True
            self.open.append(call)
            self.wake()

    def home(self, robot: Robot) -> None:
        super().home(robot)
        self._jobs.pop(robot.name, None)

    def left(self, robot: Robot, lane: int, side: Side) -> None:
        if not is_early(self.policy):
            self.open.append(
                OpenCall(robot.full_bin, robot.name, lane, side, robot.tick, robot.tick)
            )
            self.wake()

    def wake(self) -> None:
        happened, self._changed = self._changed, self.env.event()
        happened.succeed()

    def run(self) -> Events:
        """Ask the carriers again and again while bins wait, and let the policy decide."""
        while True:
            waiting = [call for call in self.open if call.bin not in self._booked]
            if not waiting:
                yield self._changed
                continue
            asked = max(
                ceil(self.env.now),
                min(call.since for call in waiting) + 1,
                self._asked + POLL_TICKS,
            )
            yield self.env.timeout(asked + 1 - self.env.now)
            self._asked, ready = (
                asked,
                {robot.name: robot for robot in self.ready() if robot.name not in self._booked},
            )
            carriers = self._told(ready) if ready or not self._knows_policy else []
            yield self.env.timeout(1)
            calls = [
                call
                for call in self.open
                if call.bin not in self._booked and call.since < asked + 2
            ]
            before, self._decided = self._decided, asked + 2
            if not self._knows_policy or (ready and any(self._is_due(call) for call in calls)):
                self.decide(self._decision(calls, carriers, ready))
                continue
            # Of those that are full at the next question: this one, or none, was the last before.
            for call in calls:
                if (
                    before <= max(call.full, call.since)
                    and call.full <= self._decided + POLL_TICKS + 1
                ):
                    self._learn(call)

    def _is_due(self, call: OpenCall) -> bool:
        """Whether a carrier may have to leave for a bin: a tick too early rather than too late."""
        return (
            call.left(self._decided)
            <= (self._ways[call.lane, call.side.name][1] + MARGIN) / TIME_STEP + 1
        )

    def _learn(self, call: OpenCall) -> None:
        """Let a policy of ours learn of a bin what it would have at the last question, if it was
        not asked because nothing was due.

        What it remembers is that of the last question before a bin is full, or its estimate
        changes: so no other one is needed.
        """
        is_new = max(call.since, call.learned) < self._decided
        if self._knows_policy and is_new and call.bin not in self._booked and call in self.open:
            call.learned = self._decided
            self.policy.assign(
                self._decided, [self._report(call, self._decided)], [], self.asked.memory
            )

    def decide(self, decision: DispatchDecision) -> None:
        self.send(decision, self.orders(decision))

    def orders(self, decision: DispatchDecision) -> list[Assignment]:
        """Return what the policy decides. Raises PolicyFault."""
        now, bins, carriers = decision.now, decision.bins, decision.carriers
        return self.asked.orders(now, bins, carriers)

    def send(self, decision: DispatchDecision, orders: Iterable[Assignment]) -> None:
        for order in orders:
            self._booked |= {order.bin, order.carrier}
            self.env.process(
                self._fetch(
                    order, decision.calls[order.bin], decision.ready[order.carrier], decision.now
                )
            )

    def _told(self, ready: Container[str]) -> list[CarrierReport]:
        """What the carriers answer: all but those that the dispatcher has sent, until it is told of
        their jobs.
        """
        head, sent = self.layout.queue.head, ceil(self.env.now) - BOOKED_TICKS
        told = [
            (robot, *self._jobs.get(robot.name, ("", -BOOKED_TICKS)))
            for robot in self._carriers
            if robot.name not in self._booked
        ]
        return [
            CarrierReport(one.name, job, one.name in ready, max(0.0, head - one.x_now))
            for one, job, since in told
            if since <= sent
        ]

    def _decision(
        self, calls: list[OpenCall], carriers: list[CarrierReport], ready: dict[str, Robot]
    ) -> DispatchDecision:
        now = ceil(self.env.now)
        bins = [self._report(call, now) for call in sorted(calls, key=lambda call: call.bin)]
        return DispatchDecision(now, bins, carriers, {call.bin: call for call in calls}, ready)

    def _report(self, call: OpenCall, now: int) -> BinReport:
        metres, reach = self._ways[call.lane, call.side.name]
        return BinReport(
            call.bin,
            call.lane,
            call.side.name,
            call.picker,
            call.since,
            metres,
            max(0.0, call.left(now) * TIME_STEP),
            reach,
        )

    def _fetch(self, order: Assignment, call: OpenCall, carrier: Robot, now: int) -> Events:
        report = call.since + CALL_AGAIN * ceil((now - call.since) / CALL_AGAIN)
        yield self.env.timeout(report + HEARD + ORDERED - self.env.now)
        self.open.remove(call)
        self.free.remove(carrier)
        self._booked -= {order.bin, order.carrier}
        self._jobs[carrier.name] = order.bin, report
        self.start(call, carrier)
