"""The tractor: drives up and down the driveway, waits at each end, turns about, and stops for whatever is in its way."""

from orchard.agents.bystanders import bystanders_of
from orchard.agents.robot import PlanExecutor, Step
from orchard.agents.steps import Again, DriveTo, Face, Plan, Realign, Say, Wait
from orchard.contract.agent import Action, Mail, Observation
from orchard.field.layout import Layout

WEST_END, EAST_END = -45.0, -25.0  # x, m: 20 m apart (reference.md)
WORK = 5.0  # s at each end

ROUND: list[Step] = [
    Say("driving east"),
    DriveTo(x=EAST_END),
    Say("being loaded"),
    Wait(WORK),
    Say("turning about"),
    Face("WEST"),
    Say("driving west"),
    DriveTo(x=WEST_END),
    Say("being unloaded"),
    Wait(WORK),
    Say("turning about"),
    Face("EAST"),
]


class Tractor:
    """Works on the driveway throughout."""

    Memory = Plan

    def __init__(self, layout: Layout, name: str) -> None:
        self.bystanders = bystanders_of(layout)

    def tick(self, seen: Observation, mail: Mail, memory: Plan | None) -> Action:
        me = PlanExecutor(seen, mail, memory or Plan(plan=[Realign(), Again(ROUND)]), self.bystanders)
        me.follow()
        return me.finish()
