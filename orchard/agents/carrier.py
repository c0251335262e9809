"""The carrier: waits in the queue, brings an empty bin to a picker that is called for, and takes the full one to the bay."""

import msgspec

from orchard.agents.bystanders import bystanders_of
from orchard.agents.robot import PlanExecutor
from orchard.agents.route import SIDES, close_up, distance, fetch, line_of
from orchard.agents.steps import Plan, Realign
from orchard.contract.agent import Action, Heard, Mail, Observation
from orchard.contract.messages import Answer, Call, Come, No, Offer, Yes
from orchard.field.layout import QUEUE_HEAD, QUEUE_PITCH, Layout


class Job(msgspec.Struct):
    """What a carrier was sent to do."""

    bin: str
    lane: int
    side: str
    picker: str


class CarrierMemory(Plan):
    """Its plan, and the job that it follows from."""

    job: Job | None = None
    delivered: str = ""  # the empty bin that it left for the picker


class Carrier:
    """Swaps full bins for empty ones."""

    Memory = CarrierMemory

    def __init__(self, layout: Layout, name: str) -> None:
        self.layout, self.line, self.bystanders = layout, line_of(int(name.rsplit("_", 1)[1])), bystanders_of(layout)

    def tick(self, seen: Observation, mail: Mail, memory: CarrierMemory | None) -> Action:
        me = PlanExecutor(seen, mail, memory or CarrierMemory(plan=[Realign(), *close_up()]), self.bystanders)
        for heard in mail.requests:
            me.action.answers.append((heard, self.answer(me, heard)))
        me.follow()
        return me.finish()

    def answer(self, me: PlanExecutor, heard: Heard) -> Answer:
        """To bins: a waiting carrier tells where it is, and goes for the first that sends for it; a busy one says no."""
        job, body = me.memory.job, heard.body
        if isinstance(body, Come) and job and job.bin == heard.sender:
            return Yes()
        if not isinstance(body, Call | Come):
            return No("a carrier knows nothing of that")
        if not 1 <= body.lane <= len(self.layout.lanes):
            return No("there is no such row")
        if job:
            return No(f"busy with {job.bin}")
        if isinstance(body, Call) and not self.is_next(me):
            return No("another one of my line goes first")
        if isinstance(body, Call):
            x, y = me.pose.x, me.pose.y
            return Offer(x, y, distance(self.layout, x, y, body.lane, SIDES[body.side]))
        self.accept(me, heard.sender, body)
        return Yes()

    def is_next(self, me: PlanExecutor) -> bool:
        """Whether it is at the head of its line, or on its way into that place: nobody stands before it who could stay there."""
        behind = QUEUE_HEAD - me.pose.x
        return behind < 0.1 or (behind < QUEUE_PITCH + 0.2 and me.seen.twist.x > 0.0)

    def accept(self, me: PlanExecutor, bin_name: str, come: Come) -> None:
        me.memory.job = Job(bin_name, come.lane, come.side, come.picker)
        me.memory.plan = fetch(self.layout, self.line, come.lane, SIDES[come.side], come.picker, bin_name)
        me.memory.asked = {}
