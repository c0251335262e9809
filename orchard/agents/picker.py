"""The picker: drives its rows, fills its bin, leaves it when it is full, and fetches an empty one for the next row."""

from orchard.agents.bystanders import bystanders_of
from orchard.agents.robot import PlanExecutor
from orchard.agents.route import harvest
from orchard.agents.steps import Plan, Realign
from orchard.contract.agent import Action, Heard, Mail, Observation
from orchard.contract.messages import Answer, Here, No, Yes
from orchard.field.layout import Layout


class PickerMemory(Plan):
    """Its plan, and what it knows of the exchange of bins that is under way."""

    full_bin: str = ""  # the bin that it left
    carrier: str = ""  # who brings, or brought, an empty one
    offered: str = ""  # the empty bin that was brought
    taken: str = ""  # the empty bin that it took, place and all


class Picker:
    """Picks its rows one after another."""

    Memory = PickerMemory

    def __init__(self, layout: Layout, name: str) -> None:
        self.layout, self.rows, self.bystanders = layout, layout.blocks[name], bystanders_of(layout)

    def tick(self, seen: Observation, mail: Mail, memory: PickerMemory | None) -> Action:
        me = PlanExecutor(seen, mail, memory or PickerMemory(plan=[Realign(), *harvest(self.layout, self.rows)]), self.bystanders)
        for heard in mail.requests:
            me.action.answers.append((heard, self.answer(me, heard)))
        me.follow()
        return me.finish()

    def answer(self, me: PlanExecutor, heard: Heard) -> Answer:
        """To a carrier that brings a bin: yes, once it is coupled and the place where it stands is taken over."""
        if not isinstance(heard.body, Here):
            return No("a picker knows nothing of that")
        memory = me.memory
        if heard.body.bin in (memory.taken, memory.full_bin):
            return Yes()
        if me.seen.hitch is not None:
            return No("no bin is wanted") if heard.body.bin != me.seen.hitch.name else No("the place is not taken over yet")
        memory.offered, memory.carrier = heard.body.bin, heard.sender
        return No("not coupled yet")
