"""The carrier: brings an empty bin to a picker, and takes the full bin to the bay.

It waits in the queue until a full bin calls, or the dispatcher has sent it. With `nearest` a
calling bin asks all carriers, those that can leave offer themselves, and the bin sends for one of
them (`Come`). With a dispatcher there are no offers: the dispatcher asks carriers for their state.
Its plan is made of steps (orchard/plans); `orchard.plans.routes` has the steps of each route.
"""

from collections.abc import Mapping

import msgspec

from orchard.behaviour.bin import CALL_AGAIN
from orchard.contract.agent import Action, Heard, Mail, Observation
from orchard.contract.messages import (
    LAST_TICK,
    Answer,
    Call,
    CarrierQuery,
    CarrierStatus,
    Come,
    No,
    Offer,
    Yes,
)
from orchard.field.kinds import number_of
from orchard.field.layout import Layout
from orchard.field.queue import PITCH
from orchard.plans.robot import PlanExecutor, Step
from orchard.plans.routes import route_of
from orchard.plans.sense import bystanders_of
from orchard.plans.steps import Plan, Realign, of_known_steps, with_steps

# A bin sends for a carrier within so many ticks of its first offer. One that has not done so by
# then comes last for further offers: it probably has another carrier.
CHOOSING = 5
# m to the head of the line, of a carrier that stands there.
AT_HEAD = 0.1
# m to the head of the line, at most, of a carrier that drives up to it and can already be sent: one
# place of the queue, and some centimetres for where it may have stopped.
MOVING_UP = PITCH + 0.2
# Ticks for which a call counts. By then the bin has called again, unless a carrier comes; the 5 are
# a margin.
REMEMBERED = CALL_AGAIN + 5


class HeardCall(msgspec.Struct):
    """A bin's call."""

    # Tick at which the bin began to call.
    since: int
    # Tick at which it was last heard.
    tick: int
    # Tick of this carrier's first offer to it; LAST_TICK: it has made none.
    offered: int = LAST_TICK


class Job(msgspec.Struct):
    """The present task of a carrier.

    It is the full bin, where it stands, and the picker that needs an empty bin.
    """

    bin: str
    lane: int
    side: str
    picker: str


class CarrierMemory(Plan):
    """A carrier's plan, and the job that it follows from."""

    job: Job | None = None
    # The empty bin that it left for the picker.
    delivered: str = ""
    # Whether its battery has been full since it last went to charge.
    charged: bool = True
    # Whether its battery has not been full since it was flat.
    flat: bool = False
    # Bin -> its call, heard lately, also while the carrier is busy.
    calls: dict[str, HeardCall] = {}
    # Its place in the queue, from 1: it waits in the line of that place. 0: its place is the number
    # in its name. Only a fork gives another one.
    queue_place: int = 0


class Carrier:
    """Swaps full bins for empty ones."""

    Memory: type[CarrierMemory] = CarrierMemory
    holds = True

    def __init__(self, layout: Layout, name: str) -> None:
        self.layout = layout
        self.number = number_of(name)
        self.route = route_of(layout)
        self.machine = layout.machines["carrier"]
        self.bystanders = bystanders_of(layout)
        self.Memory = with_steps(type(self).Memory, self.route.Steps)

    def begin(self, queue_place: int = 0) -> CarrierMemory:
        """Return the memory of a carrier that begins to wait in the queue.

        `queue_place`: see `CarrierMemory`.
        """
        return self.Memory(plan=[Realign(), *self.route.wait_in_queue()], queue_place=queue_place)

    def tick(self, seen: Observation, mail: Mail, memory: CarrierMemory | None) -> Action:
        """Hear calls, answer, and follow the plan; with a battery that was flat, stand."""
        robot = PlanExecutor(seen, mail, memory or self.begin(), self.machine, self.bystanders)
        hear_calls(robot.memory.calls, mail, seen.tick)
        robot.action.answers = [(heard, self.answer(robot, heard)) for heard in mail.requests]
        is_full = seen.charge >= 1.0
        robot.memory.charged = robot.memory.charged or is_full
        robot.memory.flat = seen.charge <= 0.0 or (robot.memory.flat and not is_full)
        if robot.memory.flat:
            return self.stand(robot)
        robot.follow()
        return robot.finish()

    def stand(self, robot: PlanExecutor) -> Action:
        """Return the action of a carrier after its battery was flat.

        It stands until the battery is full. Otherwise it would drive on by each bit of charge,
        and be flat again at once.
        """
        if robot.seen.charge > 0.0 or robot.memory.charged:
            robot.hold()
        action = robot.finish()
        if robot.seen.charge > 0.0:
            action.doing = "charging a flat battery"
            action.state = "resting"
        else:
            action.doing = "standing with a flat battery"
            action.state = "failed"
        return action

    def answer(self, robot: PlanExecutor, heard: Heard) -> Answer:
        """Answer a request.

        A free carrier offers itself to the oldest call, and goes for the bin that sends for it.
        """
        job = robot.memory.job
        body = heard.body
        if isinstance(body, CarrierQuery):
            return self.status(robot)
        if isinstance(body, Come) and job and job.bin == heard.sender:
            return Yes()
        if not isinstance(body, Call | Come):
            return No("a carrier knows nothing of that")
        if not 1 <= body.lane <= len(self.layout.lanes):
            return No("there is no such row")
        if job:
            return No(f"busy with {job.bin}")
        if isinstance(body, Call) and not self.is_next(robot):
            return No("another one of my line goes first")
        if isinstance(body, Call):
            return self.offer(robot, heard.sender, body)
        self.accept(robot, heard.sender, body)
        return Yes()

    def status(self, robot: PlanExecutor) -> CarrierStatus:
        """Return what the dispatcher asks for.

        That is its job, whether it can leave, and its way to the head.
        """
        metres = max(0.0, self.layout.queue.head - robot.pose.x)
        job = robot.memory.job
        if job:
            return CarrierStatus(job=job.bin, is_next=False, metres=metres)
        return CarrierStatus(job="", is_next=self.is_next(robot), metres=metres)

    def offer(self, robot: PlanExecutor, bin_name: str, call: Call) -> Answer:
        """Offer the carrier to a bin, unless one that has called for longer waits for an offer."""
        calls = robot.memory.calls
        offered = {name: known.offered for name, known in calls.items()}
        if first_call(calls, offered, robot.seen.tick) != bin_name:
            return No("an older call comes first")
        calls[bin_name].offered = min(calls[bin_name].offered, robot.seen.tick)
        x = robot.pose.x
        y = robot.pose.y
        return Offer(x, y, self.route.distance(x, y, call.lane, self.route.sides[call.side]))

    def course(self, memory: CarrierMemory) -> list[Step]:
        """Return the steps of which the plan in a memory is a part, in whichever line of the queue
        the carrier ends.

        A fork (`orchard.fork`) finds by them which step of a plan is which of a changed orchard.
        """
        steps = [*self.route.wait_in_queue()]
        if memory.job is None:
            return steps
        waiting = memory.queue_place or self.number
        # Its place in the charging lines; without them the same place.
        charging = waiting + self.layout.first_charging
        steps += self.fetch(waiting, memory.job)
        if charging != waiting:
            steps += self.fetch(charging, memory.job)
        return steps

    def fetch(self, number: int, job: Job) -> list[Step]:
        """Return the steps of a job, from a place of the queue (from 1) and back to its line."""
        return self.route.fetch(number, job.lane, self.route.sides[job.side], job.picker, job.bin)

    def is_next(self, robot: PlanExecutor) -> bool:
        """Whether the carrier is at the head of its line, or drives up to it."""
        # The queue faces east, with all heads at one x.
        behind = self.layout.queue.head - robot.pose.x
        return can_leave(behind, robot.seen.twist.x > 0.0, robot.position_bound)

    def accept(self, robot: PlanExecutor, bin_name: str, come: Come) -> None:
        """Take the job of a bin that sends for the carrier."""
        memory = robot.memory
        memory.job = Job(bin_name, come.lane, come.side, come.picker)
        number = self.route.number(memory.queue_place or self.number, robot.pose.y)
        plan = self.fetch(number, memory.job)
        memory.plan = of_known_steps(plan, self.route.Steps)
        # What its last job has asked and found is over; see `Plan`.
        memory.asked = {}
        memory.left = ""
        # Its offers are over too: after the job each bin that calls gets a first offer again.
        for call in memory.calls.values():
            call.offered = LAST_TICK


def can_leave(behind: float, is_moving: bool, position_bound: float = 0.0) -> bool:
    """Whether a carrier is at its line's head, or drives up to it.

    `behind`: how far it is from there, m; `position_bound`: by how much that may be wrong, m.
    """
    return behind < AT_HEAD + position_bound or (is_moving and behind < MOVING_UP)


def first_call(calls: Mapping[str, HeardCall], offered: Mapping[str, int], tick: int) -> str:
    """Return the bin to which a carrier offers itself: the one that has called for longest.

    A bin that has had an offer for more than CHOOSING ticks comes last. `calls`: bin -> its call.
    `offered`: bin -> tick of the first offer to it.
    """

    def rank(name: str) -> tuple[bool, int, str]:
        has_long_had_offer = tick - offered.get(name, LAST_TICK) > CHOOSING
        return has_long_had_offer, calls[name].since, name

    return min(calls, key=rank)


def hear_calls(calls: dict[str, HeardCall], mail: Mail, tick: int) -> None:
    """Note the calls in the mail, and forget those of bins that call no longer."""
    for name, call in list(calls.items()):
        if tick - call.tick > REMEMBERED:
            del calls[name]
    for heard in mail.requests:
        if isinstance(heard.body, Call):
            offered = LAST_TICK
            before = calls.get(heard.sender)
            # The same call, heard once more, keeps the tick of its first offer.
            if before and before.since == heard.body.since:
                offered = before.offered
            calls[heard.sender] = HeardCall(heard.body.since, tick, offered)
