"""Carriers that are away at the load-out, where their fruit is loaded on trucks.

The world has no road to it. So a carrier that has unloaded drives from the bay to its line of the
queue as any other one. When it has turned into the line, it counts as away for `haul_ticks`: its
body is in the line, and may drive up it, but no bin can have it. `World.hauling` counts the ticks.
"""

import numpy as np

from orchard.field.geometry import EAST
from orchard.sim.world import World

# m. A carrier is in its line from so far before the turn-off on: carriers drive to the turn-off,
# but do not reach it to the last bit.
EARLY = 0.05
# rad. A carrier that is turned further from the east is still turning into its line.
TURNED = 0.1


def begin(world: World, carrier: int) -> None:
    """Let a carrier, a body's index, that has unloaded go to the load-out, once it is in its line.

    Without a load-out `haul_ticks` is 0.
    """
    world.hauling[carrier] = world.layout.machines["carrier"].haul_ticks


def advance(world: World) -> None:
    """Let a tick pass for the carriers that are away."""
    if world.layout.machines["carrier"].haul_ticks:
        world.hauling[are_away(world)] -= 1


def are_away(world: World) -> np.ndarray:
    """Return which bodies are away now, (n,) bool.

    One that has unloaded and has not reached its line is not away yet, though `World.hauling` is
    above 0.
    """
    queue = world.layout.queue
    area = queue.area
    x, y, yaw = world.pose.T
    is_along = (x >= queue.turn_off - EARLY) & (x <= area.east)
    is_in_line = is_along & (y >= area.south) & (y <= area.north) & (np.abs(yaw - EAST) <= TURNED)
    away: np.ndarray = is_in_line & (world.hauling > 0)
    return away


def is_any_under_way(world: World) -> bool:
    """Whether a carrier is away at the load-out, or a trailer is: it comes back by itself.

    A carrier that has unloaded, and stands before its line, does not count: it may stand there for
    ever.
    """
    if world.layout.machines["carrier"].trailer_ticks:
        return world.is_any_hauling
    return world.is_any_hauling and bool(are_away(world).any())
