"""Damages the snapshots of a simulated run, as a failing machine does, or a user who copies files.

schedule.py calls it for the faults "torn snapshot" and "foreign snapshot".
"""

from pathlib import Path

from chaos.simulated.harvest import harvest_of
from chaos.simulated.processes import World
from orchard.sim.snapshot import SNAPSHOT, as_file


def whole_snapshots(world: World) -> set[int]:
    """Return the ticks of the snapshots that can be read.

    The snapshot of a first tick, also that of a reset, outdates all that were written before it.
    """
    kept = list(world.kept)
    if 0 in kept:
        last_begin = max(at for at, tick in enumerate(kept) if tick == 0)
        kept = kept[last_begin:]
    return {tick for tick in kept if tick not in world.torn}


def tear_newest(world: World, folder: Path) -> set[int]:
    """Cut the newest snapshot in a folder off. Return its tick; nothing without a snapshot."""
    files = sorted(folder.glob(f"tick-*{SNAPSHOT}"))
    if not files:
        return set()
    newest = files[-1]
    content = newest.read_bytes()
    newest.write_bytes(content[: world.random.randrange(len(content))])
    world.stamp(newest)
    tick = int(newest.stem.removeprefix("tick-"))
    world.torn.add(tick)
    return {tick}


def put_foreign(world: World, folder: Path, scene: str) -> None:
    """Put a snapshot of another run of a scene into a folder: one of a late moment."""
    harvest = harvest_of(scene)
    foreign = harvest.snapshot(max(harvest.keyframes))
    foreign.run = "another"
    name, content = as_file(foreign)
    folder.mkdir(exist_ok=True)
    (folder / name).write_bytes(content)
    world.stamp(folder / name)
