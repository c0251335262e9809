"""Trailers at the bay: each takes the bins of carriers, and drives to the load-out when it is full.

Bins go on one trailer at a time: the one that stands at the bay with most of them, else the first.
"""

from math import inf

from orchard.sim.world import World


def room(world: World) -> float:
    """Return for how many bins the trailers at the bay have room; infinity if none is needed."""
    if not world.layout.machines["carrier"].trailer_ticks:
        return inf
    load_out = world.layout.scenario.load_out
    bins = load_out.trailers.bins
    assert bins is not None
    at_bay, back, _ = world.trailers.T
    return int((bins - at_bay[back <= world.tick]).sum())


def take(world: World, is_last: bool) -> None:
    """Take a bin in the bay. The trailer leaves once it is full, or if that is the last bin."""
    machine = world.layout.machines["carrier"]
    if not machine.trailer_ticks:
        return
    there = (world.trailers[:, 1] <= world.tick).nonzero()[0]
    trailer = max(there.tolist(), key=lambda number: int(world.trailers[number, 0]))
    world.trailers[trailer, 0] += 1
    bins = int(world.trailers[trailer, 0])
    load_out = world.layout.scenario.load_out
    if is_last or bins == load_out.trailers.bins:
        world.trailers[trailer] = 0, world.tick + machine.trailer_ticks, bins
