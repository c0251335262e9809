"""The carrier: waits in the queue, brings a picker an empty bin when a full bin calls, and takes the full bin to the bay."""

from collections.abc import Mapping

import msgspec

from orchard.agents.bin import CALL_AGAIN
from orchard.agents.robot import PlanExecutor, Step
from orchard.agents.routes import route_of
from orchard.agents.sense import bystanders_of
from orchard.agents.steps import Plan, Realign, of_known_steps, with_steps
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

CHOOSING = 5  # ticks in which a bin that has an offer sends for a carrier; after them it comes last
AT_HEAD, MOVING_UP = (
    0.1,
    PITCH + 0.2,
)  # m to the head of the line: of a carrier that stands there, of one that drives up to it
REMEMBERED = (
    CALL_AGAIN + 5
)  # ticks for which a call counts: by then the bin has called again, unless a carrier comes


class HeardCall(msgspec.Struct):
    """A bin's call."""

    since: int  # tick at which the bin began to call
    tick: int  # at which it was last heard
    offered: int = LAST_TICK  # tick of the first offer to it


class Job(msgspec.Struct):
    """The present task of a carrier: the full bin, where it stands, and the picker that needs an empty bin."""

    bin: str
    lane: int
    side: str
    picker: str


class CarrierMemory(Plan):
    """A carrier's plan, and the job that it follows from."""

    job: Job | None = None
    delivered: str = ""  # the empty bin that it left for the picker
    charged: bool = True  # whether its battery has been full since it last went to charge
    flat: bool = False  # whether its battery has not been full since it was flat
    calls: dict[
        str, HeardCall
    ] = {}  # bin -> its call, heard lately, also while the carrier is busy
    queue_place: int = (
        0  # in the queue, from 1: its line is the place's; 0: that of the carrier's number
    )


class Carrier:
    """Swaps full bins for empty ones."""

    Memory: type[CarrierMemory] = CarrierMemory
    holds = True

    def __init__(self, layout: Layout, name: str) -> None:
        self.layout, self.number, self.route, self.bystanders = (
            layout,
            number_of(name),
            route_of(layout),
            bystanders_of(layout),
        )
        self.Memory = with_steps(type(self).Memory, self.route.Steps)

    def begin(self, queue_place: int = 0) -> CarrierMemory:
        """Return the memory of a carrier that begins to wait in the queue. `queue_place`: see `CarrierMemory`."""
        return self.Memory(plan=[Realign(), *self.route.wait_in_queue()], queue_place=queue_place)

    def tick(self, seen: Observation, mail: Mail, memory: CarrierMemory | None) -> Action:
        robot = PlanExecutor(seen, mail, memory or self.begin(), self.bystanders)
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
        """Return the action of a carrier whose battery was flat: it stands until the battery is full.

        Otherwise it would drive on by each bit of charge, and be flat again at once.
        """
        if robot.seen.charge > 0.0 or robot.memory.charged:
            robot.hold()
        action = robot.finish()
        if robot.seen.charge > 0.0:
            action.doing, action.state = "charging a flat battery", "resting"
        else:
            action.doing, action.state = "standing with a flat battery", "failed"
        return action

    def answer(self, robot: PlanExecutor, heard: Heard) -> Answer:
        """Answer a request. A free carrier offers itself to the oldest call, and goes for the bin that sends for it."""
        job, body = robot.memory.job, heard.body
        if isinstance(body, CarrierQuery):
            return CarrierStatus(
                job.bin if job else "",
                not job and self.is_next(robot),
                max(0.0, self.layout.queue.head - robot.pose.x),
            )
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

    def offer(self, robot: PlanExecutor, bin_name: str, call: Call) -> Answer:
        """Offer the carrier to a bin, unless one that has called for longer waits for an offer."""
        calls, x, y = robot.memory.calls, robot.pose.x, robot.pose.y
        if (
            first_call(
                calls, {name: known.offered for name, known in calls.items()}, robot.seen.tick
            )
            != bin_name
        ):
            return No("an older call comes first")
        calls[bin_name].offered = min(calls[bin_name].offered, robot.seen.tick)
        return Offer(x, y, self.route.distance(x, y, call.lane, self.route.sides[call.side]))

    def course(self, memory: CarrierMemory) -> list[Step]:
        """Return the steps of which the plan in a memory is a part, for whichever line of the queue."""
        job, number = memory.job, memory.queue_place or self.number
        numbers = dict.fromkeys((number, number + self.layout.first_charging))
        return sum(
            [self.fetch(number, job) for number in numbers if job], self.route.wait_in_queue()
        )

    def fetch(self, number: int, job: Job) -> list[Step]:
        return self.route.fetch(number, job.lane, self.route.sides[job.side], job.picker, job.bin)

    def is_next(self, robot: PlanExecutor) -> bool:
        return can_leave(
            self.layout.queue.head - robot.pose.x, robot.seen.twist.x > 0.0, robot.position_bound
        )

    def accept(self, robot: PlanExecutor, bin_name: str, come: Come) -> None:
        robot.memory.job = Job(bin_name, come.lane, come.side, come.picker)
        plan = self.fetch(
            self.route.number(robot.memory.queue_place or self.number, robot.pose.y),
            robot.memory.job,
        )
        robot.memory.plan = of_known_steps(plan, self.route.Steps)
        robot.memory.asked, robot.memory.left = {}, ""
        for call in robot.memory.calls.values():
            call.offered = LAST_TICK


def can_leave(behind: float, is_moving: bool, doubt: float = 0.0) -> bool:
    """Whether a carrier, m `behind` its line's head by a measure that may be wrong by `doubt`, is there or drives up to it."""
    return behind < AT_HEAD + doubt or (is_moving and behind < MOVING_UP)


def first_call(calls: Mapping[str, HeardCall], offered: Mapping[str, int], tick: int) -> str:
    """Return the bin to which a carrier offers itself: the one that has called for longest. A bin with an offer for longer than a bin needs
    to send for a carrier comes last. `offered`: bin -> tick of the first offer to it."""
    return min(
        calls,
        key=lambda name: (tick - offered.get(name, LAST_TICK) > CHOOSING, calls[name].since, name),
    )


def hear_calls(calls: dict[str, HeardCall], mail: Mail, tick: int) -> None:
    """Note the calls in the mail, and forget those of bins that call no longer."""
    for name in [name for name, call in calls.items() if tick - call.tick > REMEMBERED]:
        del calls[name]
    for heard in mail.requests:
        if isinstance(heard.body, Call):
            before = calls.get(heard.sender)
            offered = before.offered if before and before.since == heard.body.since else LAST_TICK
            calls[heard.sender] = HeardCall(heard.body.since, tick, offered)
