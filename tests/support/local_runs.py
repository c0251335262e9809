"""Runs without a network. Runs of many processes must have the same hashes, whatever faults occur."""

from functools import cache

from orchard.agents.catalogue import make_agents
from orchard.contract.messages import pack, unpack
from orchard.field.scenario import Animals, People, Scenario
from orchard.local import Local
from orchard.sim.lookahead import Lookahead

SMALL = Scenario(rows=3, carriers=1, people=People(workers=1, visitors=0), animals=Animals(dogs=0, cats=0), weeds=1, tractor=False)
ALONE = dict(people=People(workers=0, visitors=0), animals=Animals(dogs=0, cats=0), weeds=0, tractor=False)
SHORT = Scenario(rows=3, carriers=1, row_length=30.0, **ALONE)  # a harvest of 7 minutes
AGENTS = 10  # of the small scenario
TICKS = 120
TOY = "calling_agents:cast"  # agents that only call each other

HARVEST_TICKS = 1500  # includes the exchanges of 3 rows with 2 pickers


def local_hash(scenario, ticks, agents=None, holds=Lookahead):
    """Return the hash of a run after a number of ticks."""
    local = Local(scenario, agents, holds=holds)
    for _ in range(ticks):
        local.tick()
    return local.engine.hash


def start_afresh(local: Local) -> None:
    """Replace all agents as another process would: new agents, and their memories from bytes."""
    local.agents = make_agents(local.engine.layout)
    local.memories = {name: unpack(pack(memory), local.agents[name].Memory) for name, memory in local.memories.items()}


def local_at(tick: int) -> Local:
    """Return a run of 3 rows at a tick."""
    local = Local(Scenario(rows=3))
    while local.engine.tick < tick:
        local.tick()
    return local


@cache
def harvest_hash():
    """Return the hash of a run of 3 rows after HARVEST_TICKS."""
    return local_hash(Scenario(rows=3), HARVEST_TICKS)
