"""The tractor: drives up and down the driveway, and waits and turns about at each end.

It stops for obstacles. It handles no bins: it is traffic beside the bay.
"""

from orchard.contract.agent import Action, Mail, Observation
from orchard.field.layout import Layout
from orchard.plans.robot import PlanExecutor, Step
from orchard.plans.sense import bystanders_of
from orchard.plans.steps import Again, DriveTo, Face, Plan, Realign, Say, Wait

# x, m: 20 m apart (docs/reference.md).
WEST_END = -45.0
EAST_END = -25.0
WORK = 5.0  # s at each end

# The steps of a round. It begins at the west end, facing east.
ROUND: list[Step] = [
    Say("driving east", "driving"),
    DriveTo(x=EAST_END),
    Say("being loaded", "handling a bin"),
    Wait(WORK),
    Say("turning about", "driving"),
    Face("WEST"),
    Say("driving west", "driving"),
    DriveTo(x=WEST_END),
    Say("being unloaded", "unloading"),
    Wait(WORK),
    Say("turning about", "driving"),
    Face("EAST"),
]


class Tractor:
    """Repeats its round without end."""

    Memory = Plan
    holds = True

    def __init__(self, layout: Layout, name: str) -> None:
        self.machine = layout.machines["tractor"]
        self.bystanders = bystanders_of(layout)

    def tick(self, seen: Observation, mail: Mail, memory: Plan | None) -> Action:
        """Go on with the round."""
        memory = memory or self.Memory(plan=[Realign(), Again(ROUND)])
        robot = PlanExecutor(seen, mail, memory, self.machine, self.bystanders)
        robot.follow()
        return robot.finish()
