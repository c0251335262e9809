"""Animals, cats and dogs: they choose a new direction and speed at random every 3 s, and turn away from obstacles."""

from orchard.agents.walker import WalkerMemory, tell_where, walk
from orchard.contract.agent import Action, Mail, Observation, State
from orchard.field.geometry import Twist
from orchard.field.kinds import KINDS, kind_of
from orchard.field.layout import Layout
from orchard.field.repeatable import draw
from orchard.field.scenario import TICKS_PER_SECOND

MIND_CHANGES = 3 * TICKS_PER_SECOND  # ticks between two choices (manual)
SLOW = 0.05  # m/s: a slower animal counts as standing


class AnimalMemory(WalkerMemory):
    """The present choice of an animal."""

    speed: float = 0.0  # m/s
    rate: float = 0.0  # rad/s
    turning_until: int = 0  # tick
    mind: int = -1  # number of the present choice; -1: none yet


class Animal:
    """Wanders at random."""

    Memory = AnimalMemory

    def __init__(self, layout: Layout, name: str) -> None:
        self.seed, self.kind = layout.scenario.seed, KINDS[kind_of(name)]

    def tick(self, seen: Observation, mail: Mail, memory: AnimalMemory | None) -> Action:
        memory = memory or AnimalMemory(seen.x, seen.y, seen.tick)
        if (mind := seen.tick // MIND_CHANGES) != memory.mind:
            memory.mind = mind
            self.change_mind(seen, memory)
        whim = Twist(x=memory.speed, yaw=memory.rate if seen.tick < memory.turning_until else 0.0)
        twist, evading = walk(seen, memory, self.seed, min(memory.speed, 1.0), self.kind, whim)
        doing = evading or ("wandering" if memory.speed >= SLOW else "standing")
        state: State = "resting" if doing == "standing" else "driving"
        return Action(twist=twist, answers=tell_where(seen, mail), memory=memory, doing=doing, state=state)

    def change_mind(self, seen: Observation, memory: AnimalMemory) -> None:
        """Choose a turn to either side at up to 2 pi rad/s, for up to a second, and a speed of up to 3 m/s."""
        rate, speed, length = draw(self.seed, seen.name, memory.mind * MIND_CHANGES, 3)
        memory.rate, memory.speed = (2 * rate - 1) * self.kind.turn, speed * self.kind.speed
        memory.turning_until = seen.tick + int(TICKS_PER_SECOND * length)
