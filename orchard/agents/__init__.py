"""The agents of an orchard: one for every body, and traffic, which has none."""

from collections.abc import Callable, Collection

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


def cast(layout: Layout, names: Collection[str] | None = None) -> dict[str, Agent]:
    """These agents of an orchard by their names, or all, in the order of names; where the scenario names a class, one of that."""
    names = (*layout.names, TRAFFIC) if names is None else names
    agents: dict[str, Agent] = {**configured(layout, names)}
    for start in layout.starts:
        if start.name in names and start.name not in agents:
            agents[start.name] = ROLES[start.kind](layout, start.name)
    if TRAFFIC in names:
        agents[TRAFFIC] = Traffic()
    return dict(sorted(agents.items()))
