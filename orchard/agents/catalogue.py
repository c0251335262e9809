"""Which class drives which agent: ours, or the one that the scenario names."""

import importlib
import inspect
import logging
from collections.abc import Callable, Collection
from typing import Any

from orchard.agents.animal import Animal
from orchard.agents.bin import Bin
from orchard.agents.carrier import Carrier
from orchard.agents.person import Person
from orchard.agents.picker import Picker
from orchard.agents.tractor import Tractor
from orchard.agents.traffic import Traffic
from orchard.agents.weed import Weed
from orchard.contract.agent import Agent
from orchard.contract.guard import MISTAKES, Broken, Guarded, place
from orchard.contract.messages import TRAFFIC
from orchard.field.kinds import select_agents
from orchard.field.layout import Layout

log = logging.getLogger("orchard")


# -- classes that a scenario names


def named_classes(layout: Layout) -> dict[str, str]:
    """name -> the class that the scenario names for it; a name counts more than a kind. Raises ValueError for a word that is neither."""
    classes = layout.scenario.agents
    paths: dict[str, str] = {}
    for word in sorted(classes, key=lambda word: word in layout.index):
        try:
            paths |= dict.fromkeys(select_agents(layout.names, [word], []), classes[word])
        except ValueError as error:
            raise ValueError(f"agents.{error}") from None
    return paths


def configured_agents(layout: Layout, names: Collection[str]) -> dict[str, Guarded]:
    """Of these agents those whose classes the scenario names."""
    return {name: Guarded(name, _make(path, layout, name)) for name, path in named_classes(layout).items() if name in names}


def _make(path: str, layout: Layout, name: str) -> Any:
    try:
        module, _, class_ = path.replace(":", ".").rpartition(".")
        agent = getattr(importlib.import_module(module), class_)(layout, name)
        if not callable(getattr(agent, "tick", None)):
            raise TypeError(f"it has no method tick(observation, mail, memory){_place_of(type(agent))}")
    except MISTAKES as error:
        log.error("%s: its class %s is of no use, it stands: %s: %s%s", name, path, type(error).__name__, error, place(error))
        return Broken()
    return agent


def _place_of(class_: type) -> str:
    try:
        return f" ({inspect.getsourcefile(class_)}, line {inspect.getsourcelines(class_)[1]})"
    except (OSError, TypeError):
        return ""


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


def make_agents(layout: Layout, names: Collection[str] | None = None) -> dict[str, Agent]:
    """These agents of an orchard by their names, or all, in the order of names; where the scenario names a class, one of that."""
    names = (*layout.names, TRAFFIC) if names is None else names
    agents: dict[str, Agent] = {**configured_agents(layout, names)}
    for start in layout.starts:
        if start.name in names and start.name not in agents:
            agents[start.name] = ROLES[start.kind](layout, start.name)
    if TRAFFIC in names:
        agents[TRAFFIC] = Traffic()
    return dict(sorted(agents.items()))
