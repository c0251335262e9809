"""One step of the orchard, 0.1 s: deeds, then movement and picking, then unloading. Rules and figures: docs/reference.md.

Only physics decides which bodies move, what is coupled, and when a row is picked, a bin is full or a bin is unloaded.
"""

from operator import attrgetter

import numpy as np

from orchard.contract.events import Event
from orchard.contract.messages import Deed
from orchard.field.geometry import EAST, angle_between
from orchard.field.kinds import kind_of
from orchard.field.layout import UNLOADING_SECONDS
from orchard.field.scenario import TIME_STEP
from orchard.sim import batteries
from orchard.sim.deeds import do_deeds
from orchard.sim.kernels.jit import in_order
from orchard.sim.kernels.move import advance
from orchard.sim.world import NONE, Fixed, Space, World

UNLOADING_TICKS = round(UNLOADING_SECONDS / TIME_STEP)
FACING = 1e-6  # rad
PAST_HEAD = 2.0  # m past the queue: a carrier that something drove there, and that another one keeps there, still waits in it

_CHANGING = (
    "twist",
    "pose",
    "stopped",
    "coupled",
    "fill",
    "distance",
    "collisions",
    "refused",
    "blocked",
    "row_ends",
    "pick_from",
)
_CONSTANT = [name for name in Fixed._fields if name not in ("carriers", "walls_in_sight")]
_PLACES = [
    *_CHANGING,
    *(f"fixed.{name}" for name in _CONSTANT),
    *(f"space.{name}" for name in Space._fields),
]  # in the world
_ARGUMENTS = attrgetter(
    *in_order(advance, {place.rpartition(".")[2]: place for place in _PLACES}, skip=1)
)  # of the kernel `advance`


def step(world: World, twists: np.ndarray, deeds: list[tuple[int, Deed]]) -> list[Event]:
    """Advance the world by one tick, in place, and return the events. A stopped or flat body does not move and does no deed.

    twists: (n, 3) float64, as wanted, in each body's frame, m/s and rad/s. deeds: (body index, deed), in body order.
    """
    if world.layout.first_charging:
        twists, deeds = batteries.without_flat(world, twists, deeds)
    events = do_deeds(world, np.where(world.stopped[:, None], 0.0, twists), deeds) if deeds else []
    events = _left_part_full(world, events) + events
    if advance(twists, *_ARGUMENTS(world)):
        events += [
            _collision(world, i, obstacle)
            for i, obstacle in enumerate(world.space.met.tolist())
            if obstacle != NONE
        ]
        events += _picked(world, world.space.picked_from)
        events += _unload(world)
    if world.layout.first_charging:
        events += batteries.advance(world)
    world.tick += 1
    return events


def _collision(world: World, i: int, obstacle: int) -> Event:
    names = world.layout.names
    if obstacle < len(names):
        return Event(world.tick, "collision", names[i], names[obstacle])
    x, y, half_length, half_width = world.layout.walls[obstacle - len(names)].tolist()
    what = "a fence" if max(half_length, half_width) > 1.0 else "a trunk or post"
    return Event(world.tick, "collision", names[i], "", f"{what} at ({x:g}, {y:g})")


def _left_part_full(world: World, events: list[Event]) -> list[Event]:
    """The events for bins that a picker has left though they are not full: the last ones of a harvest."""
    left = [
        (event, world.index[event.whom])
        for event in events
        if event.what == "uncoupled" and kind_of(event.who) == "picker"
    ]
    row_y = world.fixed.row_y
    return [
        Event(
            world.tick,
            "bin full",
            event.whom,
            event.who,
            _held(world, bin_, int(np.argmin(np.abs(row_y - world.pose[bin_, 1])))),
        )
        for event, bin_ in left
        if world.fixed.bin_least <= world.fill[bin_] < world.fixed.bin_full
    ]


def _picked(world: World, picked_from: np.ndarray) -> list[Event]:
    events, names = [], world.layout.names
    for i, r in zip(world.fixed.pickers.tolist(), picked_from.tolist(), strict=True):
        if r == NONE:
            continue
        bin_ = int(world.coupled[i])
        if world.rows_done[r]:
            events.append(Event(world.tick, "row picked", names[i], names[bin_], f"row {r + 1}"))
        if world.fill[bin_] >= world.fixed.bin_full:
            events.append(
                Event(world.tick, "bin full", names[bin_], names[i], _held(world, bin_, r))
            )
    return events


def _held(world: World, bin_: int, row: int) -> str:
    """In which row a bin was filled, and the metres in it, for people and for the table of exchanges."""
    return f"row {row + 1}, {world.fill[bin_] / world.fixed.row_share[row]:.2f} m"


def _unload(world: World) -> list[Event]:
    waiting = [i for i in world.full.nonzero()[0].tolist() if _rests_in_bay(world, i)]
    begun = [i for i in waiting if world.bay_ticks[i] > 0]
    ticks = int(world.bay_ticks[begun[0]]) if begun else 0
    world.bay_ticks[:] = 0
    if not waiting:
        return []
    bin_ = (begun or waiting)[0]
    world.bay_ticks[bin_] = ticks + 1
    if ticks + 1 < UNLOADING_TICKS:
        return []
    world.delivered_metres += float(world.fill[bin_])
    world.fill[bin_] = 0.0
    world.bay_ticks[bin_] = 0
    world.delivered += 1
    names = world.layout.names
    return [
        Event(
            world.tick,
            "unloaded",
            names[bin_],
            names[int(world.coupled[bin_])],
            f"bin number {world.delivered}",
        )
    ]


def _rests_in_bay(world: World, bin_: int) -> bool:
    carrier = int(world.coupled[bin_])
    if carrier == NONE or world.layout.starts[carrier].kind != "carrier":
        return False
    x, y, _ = world.pose[bin_].tolist()
    return (
        world.layout.bay.contains(x, y) and is_at_rest(world, bin_) and is_at_rest(world, carrier)
    )


# -- queries


def is_at_rest(world: World, i: int) -> bool:
    return not world.twist[i].any()


def harvest_is_over(world: World) -> bool:
    if False in world.rows_done.tolist() or max(world.fill.tolist()) >= world.fixed.bin_least:
        return False
    robots = [
        (i, start.kind)
        for i, start in enumerate(world.layout.starts)
        if start.kind in ("carrier", "picker")
    ]
    return all(
        is_at_rest(world, i) and (kind == "picker" or _waits_in_queue(world, i))
        for i, kind in robots
    )


def _waits_in_queue(world: World, carrier: int) -> bool:
    x, y, yaw = world.pose[carrier].tolist()
    area = world.layout.queue.area
    is_there = area._replace(east=area.east + PAST_HEAD).contains(x, y)
    return (
        is_there
        and abs(angle_between(yaw, EAST)) <= FACING
        and bool(world.coupled[carrier] != NONE)
    )
