"""Trailers at the bay: each takes the bins of carriers, and drives to the load-out when it is full.

Used by `orchard.sim.physics` if the scenario has trailers. `World.trailers`, (t, 3), has the bins
that are loaded at the bay, the tick at which the trailer is back, and the bins that it took. Bins
go on one trailer at a time: the one that stands at the bay with most of them, else the first.
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
    loaded, back_at, _ = world.trailers.T
    return int((bins - loaded[back_at <= world.tick]).sum())


def take(world: World, is_last: bool) -> None:
    """Take a bin in the bay. The trailer leaves once it is full, or if that is the last bin."""
    machine = world.layout.machines["carrier"]
    if not machine.trailer_ticks:
        return
    # Views: what is written to them is written to the world.
    loaded, back_at, taken = world.trailers.T
    at_bay = (back_at <= world.tick).nonzero()[0]
    # `max` returns the first of those with equally many bins.
    trailer = max(at_bay.tolist(), key=lambda number: int(loaded[number]))
    loaded[trailer] += 1
    load_out = world.layout.scenario.load_out
    if is_last or loaded[trailer] == load_out.trailers.bins:
        taken[trailer] = loaded[trailer]
        loaded[trailer] = 0
        back_at[trailer] = world.tick + machine.trailer_ticks
