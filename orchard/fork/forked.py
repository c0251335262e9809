"""The snapshot of a run that goes on with something changed: what `Local.fork` and the command
`orchard fork` begin with.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from orchard.behaviour.catalogue import make_agents
from orchard.contract.agent import STATES
from orchard.field.layout import Layout
from orchard.fork.changes import changed_layout
from orchard.fork.memories import memories_after
from orchard.fork.names import places_in_queue, renamed, renamed_letters, swapped_names
from orchard.fork.world import world_after
from orchard.sim.engine import Engine
from orchard.sim.restore import fitting, world_from
from orchard.sim.snapshot import Snapshot
from orchard.sim.world import World


def forked(snapshot: Snapshot, changes: Mapping[str, Any], stop: Sequence[str] = ()) -> Snapshot:
    """Return the snapshot of a run that goes on from this one with some values changed.

    `changes`: dotted path of a value of the scenario -> value, as for `with_changes`. `stop`: names
    or kinds of robots that stand from now on, until they are reset.

    What is random from now on follows from the seed: with another one people and animals walk
    elsewhere, robots fail at other times, and what remains of the rows takes another time. A
    carrier that is added begins at a free place of the queue; one that waits there with an empty
    bin is taken away, and the queue stays as long. People, animals and weeds begin at their starts.
    New robots have rested.

    Raises SnapshotError, ScenarioError for what cannot change, NotNow for what cannot now,
    ValueError for another word in `stop`.
    """
    before = world_from(snapshot)
    old_layout = before.layout
    layout = changed_layout(old_layout, changes)
    # What cannot be made is a mistake of the changes, and not of the snapshot.
    make_agents(layout)
    # With fewer carriers those with the last names are lacking. A carrier that must stay, because
    # it works, swaps its name with one that goes (orchard/fork/names.py).
    swapped = swapped_names(before, snapshot, layout)
    with fitting(snapshot):
        places = places_in_queue(old_layout, layout, snapshot.memories, swapped)
        memories = memories_after(
            old_layout, layout, renamed(snapshot.memories, swapped), snapshot.elsewhere, places
        )
        letters = renamed_letters(snapshot, swapped)
    world = world_after(before, World(layout), swapped, places)
    figures = _figures(renamed(snapshot.figures, swapped), old_layout, layout, world.tick)
    engine = Engine(world, snapshot.digest, figures)
    if stop:
        engine.stop(stop)
    # The engine's part of the figures is what it is now, stops included. The rest stays.
    figures |= engine.figures_as_data()
    # A new agent is one of this program, as those are that sessions have joined with.
    added = set(layout.agents).difference(old_layout.agents)
    owned = [name for name in layout.agents if name in snapshot.owned or name in added]
    return Snapshot(
        run=snapshot.run,
        scenario=layout.scenario.model_dump(),
        world=engine.as_data(),
        digest=engine.digest,
        memories=memories,
        letters=letters,
        figures=figures,
        owned=sorted(owned),
        lost=snapshot.lost,
        elsewhere=snapshot.elsewhere,
    )


def _figures(figures: dict[str, Any], before: Layout, after: Layout, tick: int) -> dict[str, Any]:
    """Return the figures so far. A robot that is new has rested until now."""
    states = figures["states"]
    resting = [tick - states["since"] if state == "resting" else 0 for state in STATES]
    states["ticks"] = {name: list(resting) for name in after.names} | states["ticks"]
    is_changed = figures.get("is_changed", False) or after.scenario != before.scenario
    return figures | {"is_changed": is_changed}
