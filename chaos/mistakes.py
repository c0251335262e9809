"""An own agent that makes mistakes.

They must stay its own: the hash is that of local mode with the same agent.
"""

import math
from asyncio import CancelledError
from typing import Any

from msgspec.structs import replace

from orchard.behaviour.walker import Animal, AnimalMemory
from orchard.contract.agent import Action, Mail, Observation
from orchard.contract.messages import Where
from orchard.field.geometry import Twist

MISTAKEN = "cat_01"
EVERY = 7  # ticks between two mistakes
MISTAKES: tuple[type[BaseException] | dict[str, Any], ...] = (
    KeyboardInterrupt,
    CancelledError,
    ZeroDivisionError,
    {"steps_done": 2**60},
    {"twist": Twist(x=math.nan)},
    {"requests": [("*", Where())]},
    {"requests": [("carrier_01", Where())] * 1000},
    {"doing": "\ud800"},
)


class Mistaken(Animal):
    """Wanders as other animals do, and makes a mistake now and then, each time another one."""

    def tick(self, seen: Observation, mail: Mail, memory: AnimalMemory | None) -> Action:
        action = super().tick(seen, mail, memory)
        number, rest = divmod(seen.tick, EVERY)
        mistake = {} if rest else MISTAKES[number % len(MISTAKES)]
        if isinstance(mistake, type):
            raise mistake
        return replace(action, **mistake)
