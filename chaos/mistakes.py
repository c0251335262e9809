"""An agent of the user's that makes mistakes, for the soak test.

They must harm no other agent: the hash is that of local mode with the same agent.
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
# What the agent does in turn: it raises an error, or it puts such values into its action.
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
    """Wanders as other animals do, and makes a mistake every EVERY ticks, each time another one."""

    def tick(self, seen: Observation, mail: Mail, memory: AnimalMemory | None) -> Action:
        action = super().tick(seen, mail, memory)
        number, rest = divmod(seen.tick, EVERY)
        if rest > 0:
            return action
        mistake = MISTAKES[number % len(MISTAKES)]
        if isinstance(mistake, type):
            raise mistake
        return replace(action, **mistake)
