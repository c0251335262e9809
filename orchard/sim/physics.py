"""One step of the orchard, 0.1 s: deeds, then movement, then what follows from where everything is.

Physics alone decides what counts: who moves, what is coupled, when a row is picked, a bin full, a bin unloaded.
Rules and figures: reference.md, 'Towing', 'The behaviours', 'The work'.
"""

import numpy as np

from orchard.contract.events import Event
from orchard.contract.messages import Deed
from orchard.field.geometry import EAST, angle_between
from orchard.field.layout import BAY, QUEUE, ROW_LENGTH, UNLOADING_SECONDS
from orchard.field.scenario import TIME_STEP
from orchard.sim.deeds import do_deeds
from orchard.sim.kernels.move import advance, allowed
from orchard.sim.world import NOBODY, World

UNLOADING_TICKS = round(UNLOADING_SECONDS / TIME_STEP)
FACING = 1e-6  # rad


def step(world: World, twists: np.ndarray, deeds: list[tuple[int, Deed]]) -> list[Event]:
    """Move the world on by one tick, in place, and tell what happened. A stopped body stands, and does no deed, whatever is wanted.

    twists: (n, 3) float64, the velocities wanted, each in its body's frame, m/s and rad/s.
    deeds: (body index, deed), in body order.
    """
    wanted = allowed(twists, world.stopped)
    events = do_deeds(world, wanted, deeds)
    begun, picked_from = _advance(world, wanted)
    events += [_collision(world, *pair) for pair in begun.tolist()]
    events += _picked(world, picked_from)
    events += _unload(world)
    world.tick += 1
    return events


def _advance(world: World, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Move all bodies, in body order, and pick: the collisions that begin, and from which row each picker picks, or NOBODY."""
    bodies, rows = world.bodies, (world.lane_y, world.row_picked, world.row_from, world.layout.scenario.picking_speed)
    state = (world.twist, world.pose, world.coupled, world.fill)
    kinds = (world.pickers, bodies.speed, bodies.turn, bodies.sideways, bodies.boxes, bodies.tows, bodies.solid)
    around, counts = (world.walls, *world.wall_grid, world.frame), (world.distance, world.refused, world.held, world.blocked)
    begun, picked_from = advance(wanted, *state, *kinds, *around, *rows, *counts)
    return begun, picked_from


def _collision(world: World, i: int, obstacle: int) -> Event:
    names = world.layout.names
    if obstacle < len(names):
        return Event(world.tick, "collision", names[i], names[obstacle])
    return Event(world.tick, "collision", names[i], "", _wall(world, obstacle - len(names)))


def _wall(world: World, number: int) -> str:
    x, y, half_length, half_width = world.layout.walls[number].tolist()
    what = "a fence" if max(half_length, half_width) > 1.0 else "a trunk or post"
    return f"{what} at ({x:g}, {y:g})"


def _picked(world: World, picked_from: np.ndarray) -> list[Event]:
    """The rows and bins that are full with what was picked from these rows, one for each picker."""
    events, names = [], world.layout.names
    for i, r in zip(world.pickers.tolist(), picked_from.tolist(), strict=True):
        if r == NOBODY:
            continue
        bin_ = int(world.coupled[i])
        if world.row_picked[r] >= ROW_LENGTH:
            events.append(Event(world.tick, "row picked", names[i], names[bin_], f"row {r + 1}"))
        if is_full(world, bin_):
            events.append(Event(world.tick, "bin full", names[bin_], names[i], f"row {r + 1}"))
    return events


def _unload(world: World) -> list[Event]:
    """Count the ticks of the one full bin that is at rest in the bay, and empty it when they are enough."""
    waiting = [i for i in (world.fill >= ROW_LENGTH).nonzero()[0].tolist() if _rests_in_bay(world, i)]
    begun = [i for i in waiting if world.bay_ticks[i] > 0]
    ticks = int(world.bay_ticks[begun[0]]) if begun else 0
    world.bay_ticks[:] = 0
    if not waiting:
        return []
    bin_ = (begun or waiting)[0]
    world.bay_ticks[bin_] = ticks + 1
    return _empty(world, bin_) if ticks + 1 >= UNLOADING_TICKS else []


def _rests_in_bay(world: World, bin_: int) -> bool:
    carrier = int(world.coupled[bin_])
    if carrier == NOBODY or world.layout.starts[carrier].kind != "carrier":
        return False
    x, y, _ = world.pose[bin_].tolist()
    return BAY.contains(x, y) and is_at_rest(world, bin_) and is_at_rest(world, carrier)


def _empty(world: World, bin_: int) -> list[Event]:
    world.fill[bin_] = 0.0
    world.bay_ticks[bin_] = 0
    world.delivered += 1
    carrier = world.layout.names[int(world.coupled[bin_])]
    return [Event(world.tick, "unloaded", world.layout.names[bin_], carrier, f"bin number {world.delivered}")]


# -- what others ask of the world


def is_full(world: World, i: int) -> bool:
    """Whether a bin is full; of any other body, no."""
    return bool(world.fill[i] >= ROW_LENGTH)


def is_at_rest(world: World, i: int) -> bool:
    """Whether a body did not move in the last step."""
    return not world.twist[i].any()


def harvest_is_over(world: World) -> bool:
    """Every row is picked, no bin is full, the carriers stand in the queue with their bins, facing east, and the pickers stand."""
    if (world.row_picked < ROW_LENGTH).any() or (world.fill >= ROW_LENGTH).any():
        return False
    kinds = [start.kind for start in world.layout.starts]
    return all(
        _waits_in_queue(world, i) if kind == "carrier" else is_at_rest(world, i)
        for i, kind in enumerate(kinds)
        if kind in ("carrier", "picker")
    )


def _waits_in_queue(world: World, carrier: int) -> bool:
    x, y, yaw = world.pose[carrier].tolist()
    queued = QUEUE.contains(x, y) and abs(angle_between(yaw, EAST)) <= FACING
    return queued and world.coupled[carrier] != NOBODY and is_at_rest(world, carrier)
