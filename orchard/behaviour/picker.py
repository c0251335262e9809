"""The picker: drives its rows, fills its bin, leaves the full bin, and fetches an empty one.

It follows the plan of its route (`harvest` of orchard/plans/route.py). This class puts the steps
into the plan bit by bit, and answers the carrier that brings an empty bin.
"""

from orchard.contract.agent import Action, Heard, Mail, Observation
from orchard.contract.messages import Answer, Here, No, Yes
from orchard.field.layout import Layout
from orchard.plans.robot import PlanExecutor, Step
from orchard.plans.routes import route_of
from orchard.plans.sense import bystanders_of
from orchard.plans.steps import Plan, Realign, of_known_steps, with_steps

# Steps that are put into the plan at a time: more than a picker does in a tick, and few, because
# the memory is sent with each action.
FORESEEN = 50


class PickerMemory(Plan):
    """A picker's plan, and the state of the present exchange of bins."""

    # The bin that it left.
    full_bin: str = ""
    # The carrier that brings, or brought, an empty bin.
    carrier: str = ""
    # The empty bin that was brought.
    offered: str = ""
    # The empty bin that it took, once it has also taken over the place where the bin stood.
    taken: str = ""
    # Steps of its harvest that were put into its plan so far; -1: its plan is none of its harvest,
    # as one that a user's class has made.
    planned: int = -1


class Picker:
    """Picks its rows one after another."""

    Memory: type[PickerMemory] = PickerMemory
    holds = True

    def __init__(self, layout: Layout, name: str) -> None:
        self.block = layout.blocks[name]
        self.route = route_of(layout)
        self.machine = layout.machines["picker"]
        self.bystanders = bystanders_of(layout)
        self.Memory = with_steps(type(self).Memory, self.route.Steps)
        self.steps = of_known_steps(self.route.harvest(self.block), self.route.Steps)

    def tick(self, seen: Observation, mail: Mail, memory: PickerMemory | None) -> Action:
        """Go on with the plan, and answer carriers."""
        if memory is None:
            memory = self.Memory(plan=[Realign()], planned=0)
        if len(memory.plan) < FORESEEN and 0 <= memory.planned < len(self.steps):
            memory.plan += self.steps[memory.planned : memory.planned + FORESEEN]
            memory.planned += FORESEEN
        robot = PlanExecutor(seen, mail, memory, self.machine, self.bystanders)
        robot.action.answers = [(heard, self.answer(robot, heard)) for heard in mail.requests]
        robot.follow()
        return robot.finish()

    def course(self, memory: PickerMemory) -> list[Step]:
        """Return the steps of which the plan in a memory is a part, for a fork (`orchard.fork`)."""
        if memory.planned < 0:
            return []
        return self.steps

    def answer(self, robot: PlanExecutor, heard: Heard) -> Answer:
        """Answer a carrier that brings a bin, and note the bin, which the plan then fetches.

        The answer is yes once the bin is coupled and the place where it stands is taken over.
        """
        if not isinstance(heard.body, Here):
            return No("a picker knows nothing of that")
        memory = robot.memory
        # A carrier that has not heard the yes asks again; the bin may be full and left by then.
        if heard.body.bin in (memory.taken, memory.full_bin):
            return Yes()
        if robot.seen.hitch is not None:
            if heard.body.bin != robot.seen.hitch.name:
                return No("no bin is wanted")
            return No("the place is not taken over yet")
        memory.offered = heard.body.bin
        memory.carrier = heard.sender
        return No("not coupled yet")
