"""The emergency stop: a latch for each robot, which outranks whatever anybody asks of it, until it is reset.

A robot and the bin on its bar are one: who stops or resets the one stops or resets the other. A stopped robot stands and does no deed;
its agent goes on to see, hear and speak. What the bay does to a full bin that rests in it is no motion, and goes on. People and animals
cannot be stopped.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from orchard.contract.agent import Action
from orchard.contract.events import STOPPED
from orchard.field.kinds import KINDS, select_agents
from orchard.field.layout import Layout

if TYPE_CHECKING:
    from orchard.sim.world import World


def robots_of(layout: Layout) -> list[str]:
    """All that can be stopped: pickers, carriers, tractor and bins."""
    return [start.name for start in layout.starts if KINDS[start.kind].robot]


def stop(world: "World", words: Sequence[str] = ()) -> list[str]:
    """Stop the robots that these names and kinds mean; all, if there are none. Those that were not stopped before.

    Raises ValueError for a word that means no robot; then nobody is stopped.
    """
    return _set(world, words, True)


def reset(world: "World", words: Sequence[str] = ()) -> list[str]:
    """Let these robots, or all, go on. Those that were stopped before. Raises ValueError as `stop` does."""
    return _set(world, words, False)


def stopped(world: "World") -> list[str]:
    """All that are stopped, in the layout's order."""
    return [name for name, latched in zip(world.layout.names, world.stopped.tolist(), strict=True) if latched]


def _set(world: "World", words: Sequence[str], latch: bool) -> list[str]:
    meant = [world.index[name] for name in select_agents(robots_of(world.layout), list(words), [])]
    pairs = {j for i in meant for j in (i, int(world.coupled[i])) if j >= 0}
    changed = [i for i in sorted(pairs) if bool(world.stopped[i]) is not latch]
    world.stopped[changed] = latch
    return [world.layout.names[i] for i in changed]


def as_shown(world: "World", actions: Mapping[str, Action]) -> Mapping[str, Action]:
    """The actions as people are told of them: a stopped robot is stopped, whatever its agent says that it does."""
    return {**actions, **{name: replace(actions.get(name) or Action(), doing=STOPPED, waits_for="") for name in stopped(world)}}
