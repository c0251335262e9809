"""People: workers and visitors. They walk straight on. They turn for an obstacle, after a refused step, or when they have lingered."""

from orchard.agents.walker import WalkerMemory, tell_where, walk
from orchard.contract.agent import Action, Mail, Observation
from orchard.field.geometry import Twist
from orchard.field.kinds import KINDS, kind_of
from orchard.field.layout import Layout


class Person:
    """Walks about the orchard."""

    Memory = WalkerMemory

    def __init__(self, layout: Layout, name: str) -> None:
        self.seed, self.kind = layout.scenario.seed, KINDS[kind_of(name)]

    def tick(self, seen: Observation, mail: Mail, memory: WalkerMemory | None) -> Action:
        memory = memory or WalkerMemory(seen.x, seen.y, seen.tick)
        speed = self.kind.speed
        twist, evading = walk(seen, memory, self.seed, speed, self.kind, Twist(x=speed))
        return Action(twist=twist, answers=tell_where(seen, mail), memory=memory, doing=evading or "walking", state="driving")
