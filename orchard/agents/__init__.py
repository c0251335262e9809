"""The agents of an orchard: one for every body, and traffic, which has none."""

from collections.abc import Callable

from orchard.agent import Agent
from orchard.agents.animal import Animal
from orchard.agents.bin import Bin
from orchard.agents.carrier import Carrier
from orchard.agents.person import Person
from orchard.agents.picker import Picker
from orchard.agents.tractor import Tractor
from orchard.agents.traffic import Traffic
from orchard.agents.weed import Weed
from orchard.doer import TRAFFIC
from orchard.guard import configured
from orchard.layout import Layout

ROLES: dict[str, Callable[[Layout, str], Agent]] = {
    "picker": Picker,
    "carrier": Carrier,
    "bin": Bin,
    "tractor": Tractor,
    "worker": Person,
    "visitor": Person,
    "dog": Animal,
    "cat": Animal,
    "weed": Weed,
}


def cast(layout: Layout) -> dict[str, Agent]:
    """Every agent of an orchard by its name, in the order of names; where the scenario names a class, one of that."""
    agents: dict[str, Agent] = {**configured(layout)}
    agents |= {start.name: ROLES[start.kind](layout, start.name) for start in layout.starts if start.name not in agents}
    agents[TRAFFIC] = Traffic()
    return dict(sorted(agents.items()))
