"""Runs without a network. Runs of many processes must have the same hashes, whatever faults occur."""

from functools import cache

from orchard.field.scenario import Animals, People, Scenario
from orchard.local import Local

SMALL = Scenario(rows=3, carriers=1, people=People(workers=1, visitors=0), animals=Animals(dogs=0, cats=0), weeds=1, tractor=False)
ALONE = dict(people=People(workers=0, visitors=0), animals=Animals(dogs=0, cats=0), weeds=0, tractor=False)
SHORT = Scenario(rows=3, carriers=1, row_length=30.0, **ALONE)  # a harvest of 7 minutes
AGENTS = 10  # of the small scenario
TICKS = 120
TOY = "calling_agents:cast"  # agents that only call each other

HARVEST_TICKS = 1500  # includes the exchanges of 3 rows with 2 pickers


def local_hash(scenario, ticks, agents=None):
    """Return the hash of a run after a number of ticks."""
    local = Local(scenario, agents)
    for _ in range(ticks):
        local.tick()
    return local.engine.hash


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
