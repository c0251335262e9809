"""The emergency stop: a latch for each robot, which overrides all commands to it until it is reset.

A robot and its coupled bin are stopped and reset together. A stopped robot stands and does no
deed, but its agent still observes, hears and sends. Unloading in the bay is no motion, and goes on.
People and animals cannot be stopped.
"""

from collections.abc import Mapping, Sequence

from msgspec.structs import replace

from orchard.contract.agent import Action
from orchard.contract.events import STOPPED
from orchard.field.kinds import ROBOTS, select_agents
from orchard.sim.obstacles import PLACES, with_names
from orchard.sim.world import NONE, World


def stopped(world: World) -> list[str]:
    """Return the names of the bodies that are stopped, in body order."""
    return world.layout.names_at(world.stopped.nonzero()[0].tolist())


def latch(world: World, words: Sequence[str], stop: bool) -> list[str]:
    """Stop or reset the robots with these names or kinds, or all without any.

    Return the names of the bodies that change. `stop`: False to reset. Raises ValueError for a word
    that is no robot's name or kind.
    """
    robots = world.layout.names_of(*ROBOTS)
    meant = [world.index[name] for name in select_agents(robots, list(words), [])]
    partners = world.coupled[meant].tolist()
    bodies = {*meant, *partners} - {NONE}
    changed = [i for i in sorted(bodies) if bool(world.stopped[i]) is not stop]
    world.stopped[changed] = stop
    return world.layout.names_at(changed)


def as_shown(world: World, actions: Mapping[str, Action]) -> Mapping[str, Action]:
    """Return the actions as they are shown to people.

    Where a robot waits for an obstacle, the names of the bodies there are shown. A stopped robot is
    shown as stopped, whatever its agent returned.
    """
    shown = dict(actions)
    for name, action in actions.items():
        if action.waits_for in PLACES:
            shown[name] = replace(action, waits_for=with_names(world, name, action.waits_for))
    for name in stopped(world):
        action = actions.get(name) or Action()
        shown[name] = replace(action, doing=STOPPED, state="stopped", waits_for="")
    return shown
