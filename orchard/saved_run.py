"""The state of a run between two ticks as a snapshot, and back.

A snapshot has the world, the figures, what agents remember, and the letters that are under way.
`orchard.local` makes a run of it; `orchard.sim.snapshot` keeps it on the disk.
"""

from collections.abc import Collection, Mapping
from typing import Any

import msgspec

from orchard.contract.guard import Guard
from orchard.contract.mail import LocalMail
from orchard.contract.messages import pack, unpack
from orchard.report.metrics import HarvestFigures
from orchard.sim.engine import Engine
from orchard.sim.restore import fitting
from orchard.sim.snapshot import Snapshot


def snapshot_of(
    engine: Engine,
    agents: Collection[str],
    memories: Mapping[str, Any],
    post: LocalMail,
    figures: HarvestFigures,
) -> Snapshot:
    """Return the state of a run as data.

    `agents`: the names of those that are hosted. `memories`: agent -> its memory.
    """
    packed: dict[str, bytes | None] = {}
    for name, memory in memories.items():
        packed[name] = None
        if memory is not None:
            packed[name] = pack(memory)
    return Snapshot(
        run="",
        scenario=engine.scenario.model_dump(),
        world=engine.as_data(),
        digest=engine.digest,
        memories=packed,
        letters=list(post.written.items()),
        figures=engine.figures_as_data() | {"harvest": figures.watched()},
        owned=sorted(agents),
    )


def figures_in(snapshot: Snapshot, tick: int) -> HarvestFigures:
    """Return the figures of a run that goes on at a tick. Raises SnapshotError."""
    new = {"progress_tick": tick}
    with fitting(snapshot):
        return msgspec.convert(snapshot.figures.get("harvest", new), HarvestFigures)


def memories_in(snapshot: Snapshot, agents: Mapping[str, Guard]) -> dict[str, Any]:
    """Return what the agents of a run remember, by name. Raises SnapshotError."""
    memories = {}
    with fitting(snapshot):
        for name, memory in snapshot.memories.items():
            if memory is not None:
                memories[name] = unpack(memory, agents[name].Memory)
    return memories


def without_players(snapshot: Snapshot, players: Collection[str]) -> Snapshot:
    """Return a snapshot from which a fork begins: own agents are left behind.

    `players`: their names. What was changed may end a jam, so the fork counts anew for how long
    nothing goes on: the figures of the harvest, which count that, are left out.
    """
    memories = {name: known for name, known in snapshot.memories.items() if name not in players}
    figures = {key: known for key, known in snapshot.figures.items() if key != "harvest"}
    return msgspec.structs.replace(snapshot, memories=memories, figures=figures)
