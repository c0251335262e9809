"""The empty bins at the bay: for a full bin a carrier gets one of them.

They can run out. A trailer, or the truck, brings as many back as it has taken full ones, so as many
bins belong to the bay at all times: the empty ones, the full ones that wait there, and those on
trailers. `World.waiting_bins` counts the full ones that wait for the truck.
"""

from math import inf

from orchard.sim.world import World


def empty_bins(world: World) -> float:
    """Return the number of empty bins at the bay; infinity if they cannot run out."""
    load_out = world.layout.scenario.load_out
    if load_out.empty_bins is None:
        return inf
    loaded, back_at, taken = world.trailers.T
    is_away = back_at > world.tick
    full_on_trailers = int(loaded.sum()) + int(taken[is_away].sum())
    return load_out.empty_bins - world.waiting_bins - full_on_trailers


def take(world: World) -> None:
    """Count a full bin that was just unloaded, if bins wait at the bay for the truck."""
    if world.layout.machines["carrier"].truck_ticks:
        world.waiting_bins += 1


def advance(world: World) -> None:
    """Let the truck come, if it is time for it."""
    # Ticks from one coming to the next; 0: there is no truck.
    every = world.layout.machines["carrier"].truck_ticks
    if not every or world.tick == 0 or world.tick % every != 0:
        return
    truck = world.scenario.load_out.truck
    assert truck.bins is not None
    world.waiting_bins = max(0, world.waiting_bins - truck.bins)
