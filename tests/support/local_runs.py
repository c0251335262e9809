"""Runs without a network.

Runs of many processes must have the same hashes, whatever faults occur.
"""

from functools import cache

from orchard.behaviour.catalogue import make_agents
from orchard.contract.agent import Agent
from orchard.contract.messages import pack, unpack
from orchard.field.scenario import Animals, People, Scenario
from orchard.local import Local
from orchard.sim.lookahead import Lookahead

SMALL = Scenario(
    rows=3,
    carriers=1,
    people=People(workers=1, visitors=0),
    animals=Animals(dogs=0, cats=0),
    weeds=1,
    tractor=False,
)
ALONE = dict(
    people=People(workers=0, visitors=0), animals=Animals(dogs=0, cats=0), weeds=0, tractor=False
)
# A harvest of 7 minutes.
SHORT = Scenario(rows=3, carriers=1, row_length=30.0, **ALONE)
# The agents of the small scenario.
AGENTS = 10
# Ticks of most runs of it: 12 s, in which robots drive, and pickers pick.
TICKS = 120
# Agents that only call each other.
TOY = "calling_agents:cast"

# Includes the exchanges of 3 rows with 2 pickers.
HARVEST_TICKS = 1500


def driven_by(**classes: str) -> Scenario:
    """Return the small orchard with classes of `own_agents` for kinds or robots."""
    return SMALL.model_copy(
        update={"agents": {name: f"own_agents.{class_}" for name, class_ in classes.items()}}
    )


def played(run: Local | Scenario, until: int, **agents: Agent) -> Local:
    """Return a run at a tick, in which these agents have taken over from those of the scenario."""
    local = Local(run) if isinstance(run, Scenario) else run
    for name, agent in agents.items():
        local.play(name, agent)
    while local.engine.tick < until:
        local.tick()
    return local


def local_hash(scenario, ticks, agents=None, holds=Lookahead):
    """Return the hash of a run at a tick. `holds`: the class that says which agents are asked."""
    return played(Local(scenario, agents, holds=holds), ticks).engine.hash


def start_afresh(local: Local) -> None:
    """Replace all agents as another process would: new agents, and their memories from bytes."""
    local.agents = make_agents(local.engine.layout)
    local.memories = {
        name: unpack(pack(memory), local.agents[name].Memory)
        for name, memory in local.memories.items()
    }


def local_at(tick: int) -> Local:
    return played(Scenario(rows=3), tick)


@cache
def harvest_hash():
    return local_hash(Scenario(rows=3), HARVEST_TICKS)
