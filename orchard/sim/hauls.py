"""Carriers that are away at the load-out.

A carrier that has unloaded goes there. It cannot leave the picture, so it stands for itself in its
line of the queue, from the tick on at which it has turned into it. It drives up its line meanwhile.
"""

import numpy as np

from orchard.field.geometry import EAST
from orchard.sim.world import World

# m before the queue from which on a carrier is in its line.
EARLY = 0.05
# rad by which it may be turned from the east there.
TURNED = 0.1


def begin(world: World, carrier: int) -> None:
    """Let a carrier that has unloaded go to the load-out, once it is in its line."""
    world.hauling[carrier] = world.layout.machines["carrier"].haul_ticks


def advance(world: World) -> None:
    """Let a tick pass for the carriers that are away."""
    if world.layout.machines["carrier"].haul_ticks:
        world.hauling[are_away(world)] -= 1


def are_away(world: World) -> np.ndarray:
    """Return which bodies are away, as seen from the queue, (n,) bool."""
    queue = world.layout.queue
    area = queue.area
    x, y, yaw = world.pose.T
    is_along = (x >= queue.turn_off - EARLY) & (x <= area.east)
    is_in_line = is_along & (y >= area.south) & (y <= area.north) & (np.abs(yaw - EAST) <= TURNED)
    away: np.ndarray = is_in_line & (world.hauling > 0)
    return away


def is_any_under_way(world: World) -> bool:
    """Whether a carrier is away at the load-out, or a trailer is: it comes back by itself.

    A carrier that has unloaded, and stands before its line, may stand for ever.
    """
    if world.layout.machines["carrier"].trailer_ticks:
        return world.is_any_hauling
    return world.is_any_hauling and bool(are_away(world).any())
