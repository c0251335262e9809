"""The harvest of the event model that goes on from a snapshot of a run: what the futures of a fork
and the forecast of a run's end begin with.
"""

from typing import TYPE_CHECKING

from orchard.behaviour.catalogue import make_agents
from orchard.dispatch.policies import POLICIES
from orchard.event_model.known import refuse_unknown
from orchard.field.scenario import Scenario
from orchard.plans.routes import ROUTES
from orchard.saved_run import memories_in
from orchard.sim.restore import world_from
from orchard.sim.snapshot import Snapshot

if TYPE_CHECKING:
    from orchard.event_model.harvest import EventHarvest


def is_built_in(scenario: Scenario) -> bool:
    """Whether the event model knows all of a scenario, which names no code of a user.

    So what goes on from a run's snapshot executes nothing that the user has written.
    """
    try:
        refuse_unknown(scenario)
    except ValueError:
        return False
    return scenario.dispatch in POLICIES and scenario.route in ROUTES


def harvest_from(snapshot: Snapshot) -> "EventHarvest | None":
    """Return the harvest that goes on from a snapshot. Its ticks are those of the run.

    Plain Python does it while the event model is not compiled, so it waits for no compiler.

    None if the event model cannot go on from it, or if agents are lost or left to clients
    elsewhere. Raises SnapshotError.
    """
    # It loads numba, which takes a second.
    from orchard.event_model.begun.begin import begin_at
    from orchard.event_model.begun.moment import RunMoment
    from orchard.event_model.plain import machine_at_hand

    if snapshot.elsewhere or snapshot.lost:
        return None
    world = world_from(snapshot)
    if not is_built_in(world.layout.scenario):
        return None
    memories = memories_in(snapshot, make_agents(world.layout))
    try:
        moment = RunMoment(world, memories, dict(snapshot.letters))
        return begin_at(moment, machine_at_hand())
    except NotImplementedError:
        return None
