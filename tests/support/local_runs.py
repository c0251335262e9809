"""Scenarios for tests of runs, and their hashes in local mode: one process, no network.

Tests compare runs of many processes with them: these must have the same hashes, whatever faults
occur.
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
# No people, animals, weeds and tractor.
ALONE = dict(
    people=People(workers=0, visitors=0), animals=Animals(dogs=0, cats=0), weeds=0, tractor=False
)
# A harvest of 7 minutes.
SHORT = Scenario(rows=3, carriers=1, row_length=30.0, **ALONE)
# How many agents SMALL has: 2 pickers, 1 carrier, 3 bins, 1 worker, 1 weed, 2 desks.
AGENTS = 10
# How long most runs of SMALL are: 12 s, in which robots drive, and pickers pick.
TICKS = 120
# The function that makes agents which only call each other: `--agents` of a host.
TOY = "calling_agents:cast"

# 150 s. In them 2 pickers of 3 rows exchange bins with carriers.
HARVEST_TICKS = 1500


def driven_by(**classes: str) -> Scenario:
    """Return the small orchard with classes of `own_agents` for kinds or robots.

    `driven_by(picker="Eastward")`: each picker is an `own_agents.Eastward`.
    """
    return SMALL.model_copy(
        update={"agents": {name: f"own_agents.{class_}" for name, class_ in classes.items()}}
    )


def played(run: Local | Scenario, until: int, **agents: Agent) -> Local:
    """Let a run, or a new one of a scenario, go on until a tick, and return it.

    `agents`: name -> agent that takes over from that of the scenario before the first of the ticks.
    """
    local = Local(run) if isinstance(run, Scenario) else run
    for name, agent in agents.items():
        local.play(name, agent)
    while local.engine.tick < until:
        local.tick()
    return local


def local_hash(scenario, ticks, agents=None, holds=Lookahead):
    """Return the hash of a run after so many ticks.

    `agents`: all agents by name; None: those of the scenario. `holds`: the class that says which
    agents are asked at a tick.
    """
    return played(Local(scenario, agents, holds=holds), ticks).engine.hash


def start_afresh(local: Local) -> None:
    """Replace all agents as another process would: new agents, and their memories from bytes."""
    local.agents = make_agents(local.engine.layout)
    local.memories = {
        name: unpack(pack(memory), local.agents[name].Memory)
        for name, memory in local.memories.items()
    }


def local_at(tick: int) -> Local:
    """Return a run of 3 rows at a tick."""
    return played(Scenario(rows=3), tick)


@cache
def harvest_hash():
    """Return the hash of a run of 3 rows after HARVEST_TICKS."""
    return local_hash(Scenario(rows=3), HARVEST_TICKS)
