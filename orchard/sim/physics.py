"""One step of the orchard, 0.1 s: deeds, then movement and picking, then unloading.

`orchard.sim.engine` calls `step` once in each tick. Only physics decides which bodies move, what is
coupled, and when a row is picked, a bin is full or unloaded. Rules and figures: docs/reference.md.
"""

from operator import attrgetter

import numpy as np

from orchard.contract.events import Event
from orchard.contract.messages import Deed
from orchard.field.geometry import EAST, angle_between
from orchard.field.kinds import kind_of
from orchard.sim import batteries, hauls, stock, trailers
from orchard.sim.deeds import do_deeds
from orchard.sim.kernels.jit import in_order
from orchard.sim.kernels.move import advance
from orchard.sim.world import NONE, Fixed, Space, World

# rad by which a carrier that waits may be turned from the east. It turns until it faces the east to
# rounding.
FACING = 1e-6
# m past the east edge of the queue. A carrier that something has driven there, and that cannot go
# back because another one is behind it, still waits in the queue.
PAST_HEAD = 2.0
# m. Of the walls only fences have a half side longer than this; trunks and posts are much thinner.
HALF_OF_A_FENCE = 1.0

# Attributes of the world that the kernel `advance` takes.
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
# Parameter of `advance` -> the dotted path of its argument in the world.
_PATHS = {
    **{name: name for name in _CHANGING},
    **{name: f"fixed.{name}" for name in _CONSTANT},
    **{name: f"space.{name}" for name in Space._fields},
}
# Returns the arguments of `advance` after the wanted twists, from a world.
_arguments = attrgetter(*in_order(advance, _PATHS, skip=1))


def step(world: World, twists: np.ndarray, deeds: list[tuple[int, Deed]]) -> list[Event]:
    """Advance the world by one tick, in place, and return the events.

    A stopped or flat body does not move and does no deed. twists: (n, 3) float64, as wanted, in
    each body's frame, m/s and rad/s. deeds: (body index, deed), in body order.
    """
    if world.layout.first_charging:
        twists, deeds = batteries.without_flat(world, twists, deeds)
    stock.advance(world)
    events: list[Event] = []
    if deeds:
        allowed = np.where(world.stopped[:, None], 0.0, twists)
        done = do_deeds(world, allowed, deeds)
        events = _left_part_full(world, done) + done
    # In most ticks nothing happens, and the kernel says so: then all that is skipped. It says that
    # something may have happened also while a bin is full, because that bin may be in the bay.
    if advance(twists, *_arguments(world)):
        for i, obstacle in enumerate(world.space.met.tolist()):
            if obstacle != NONE:
                events.append(_collision(world, i, obstacle))
        events += _picked(world, world.space.picked_from)
        events += _unload(world)
    if world.layout.first_charging:
        events += batteries.advance(world)
    hauls.advance(world)
    world.tick += 1
    return events


def _collision(world: World, i: int, obstacle: int) -> Event:
    """Return the event that body i begins a collision. `obstacle`: as the kernel writes it."""
    names = world.layout.names
    if obstacle < len(names):
        return Event(world.tick, "collision", names[i], names[obstacle])
    x, y, half_length, half_width = world.layout.walls[obstacle - len(names)].tolist()
    thing = "a trunk or post"
    if max(half_length, half_width) > HALF_OF_A_FENCE:
        thing = "a fence"
    return Event(world.tick, "collision", names[i], "", f"{thing} at ({x:g}, {y:g})")


def _left_part_full(world: World, events: list[Event]) -> list[Event]:
    """Return the events for bins that a picker has left though they are not full.

    They are the last bins of pickers. `events`: of this tick's deeds.
    """
    fixed = world.fixed
    part_full = []
    for event in events:
        if event.what != "uncoupled" or kind_of(event.who) != "picker":
            continue
        bin_ = world.index[event.whom]
        if fixed.bin_least <= world.fill[bin_] < fixed.bin_full:
            row = int(np.argmin(np.abs(fixed.row_y - world.pose[bin_, 1])))
            detail = _content(world, bin_, row)
            part_full.append(Event(world.tick, "bin full", event.whom, event.who, detail))
    return part_full


def _picked(world: World, picked_from: np.ndarray) -> list[Event]:
    """Return the events that rows are picked, and that bins are full.

    `picked_from`: of each picker, the row from which it has picked in this tick, or NONE.
    """
    events = []
    names = world.layout.names
    for i, r in zip(world.fixed.pickers.tolist(), picked_from.tolist(), strict=True):
        if r == NONE:
            continue
        bin_ = int(world.coupled[i])
        if world.rows_done[r]:
            events.append(Event(world.tick, "row picked", names[i], names[bin_], f"row {r + 1}"))
        if world.fill[bin_] >= world.fixed.bin_full:
            detail = _content(world, bin_, r)
            events.append(Event(world.tick, "bin full", names[bin_], names[i], detail))
    return events


def _content(world: World, bin_: int, row: int) -> str:
    """Return in which row a bin was filled, and the metres in it.

    It is for people, and for the table of exchanges.
    """
    return f"row {row + 1}, {world.fill[bin_] / world.fixed.row_share[row]:.2f} m"


def _unload(world: World) -> list[Event]:
    """Unload the bins in the bay for one tick. Return the events that some are empty now.

    As many bins are unloaded as the bay takes: those that have begun, then from the first place on.
    """
    in_bay = _bins_in_bay(world)
    ticks = world.bay_ticks[in_bay].tolist()
    # A bin that has left the bay begins anew when it comes again.
    world.bay_ticks[:] = 0
    events = []
    # The limit is taken once: a bin that becomes empty in this tick may lower it for the next one.
    most = _most_taken(world)
    for bin_, before in list(zip(in_bay, ticks, strict=True))[:most]:
        world.bay_ticks[bin_] = before + 1
        if before + 1 >= world.layout.machines["carrier"].unloading_ticks:
            events.append(_deliver(world, bin_))
    return events


def _deliver(world: World, bin_: int) -> Event:
    """Count a bin that is empty now. Return the event."""
    world.delivered_metres += float(world.fill[bin_])
    world.fill[bin_] = 0.0
    world.bay_ticks[bin_] = 0
    world.delivered += 1
    name = world.layout.names[bin_]
    hauls.begin(world, int(world.coupled[bin_]))
    trailers.take(world, is_last=_is_all_unloaded(world))
    stock.take(world)
    carrier = world.layout.names[int(world.coupled[bin_])]
    return Event(world.tick, "unloaded", name, carrier, f"bin number {world.delivered}")


def _bins_in_bay(world: World) -> list[int]:
    """Return the full bins that rest in the bay, as it takes them: those that have begun, then from
    its first place, in the east, on.
    """

    def turn(bin_: int) -> tuple[bool, float]:
        is_new = world.bay_ticks[bin_] == 0
        return is_new, -world.pose[bin_, 0]

    resting = [bin_ for bin_ in world.full.nonzero()[0].tolist() if _rests_in_bay(world, bin_)]
    return sorted(resting, key=turn)


def _most_taken(world: World) -> int:
    """Return how many bins the bay unloads at a time: one at each place, if it has an empty one to
    give for each, and room on a trailer if it needs that.
    """
    bays = world.layout.scenario.bays
    return int(min(bays, trailers.room(world), stock.empty_bins(world)))


def _rests_in_bay(world: World, bin_: int) -> bool:
    """Whether a bin stands in the bay, on a carrier that stands too."""
    carrier = int(world.coupled[bin_])
    if carrier == NONE or world.layout.starts[carrier].kind != "carrier":
        return False
    x, y, _ = world.pose[bin_].tolist()
    is_in_bay = world.layout.bay.contains(x, y)
    return is_in_bay and is_at_rest(world, bin_) and is_at_rest(world, carrier)


# -- queries


def is_at_rest(world: World, i: int) -> bool:
    """Whether body i did not move in the last step."""
    return not world.twist[i].any()


def keeps_a_bin_waiting(world: World) -> bool:
    """Whether a full bin stands at a place of the bay which cannot take it: there is no empty bin
    to give for it, or no room on a trailer.
    """
    most = _most_taken(world)
    bays = world.layout.scenario.bays
    return most < bays and len(_bins_in_bay(world)) > most


def is_anything_coming(world: World) -> bool:
    """Whether a carrier or a trailer is away and comes back, or the truck comes for a bay that
    keeps a bin waiting.
    """
    if world.layout.machines["carrier"].truck_ticks:
        return keeps_a_bin_waiting(world)
    return hauls.is_any_under_way(world)


def harvest_is_over(world: World) -> bool:
    """Whether all rows are picked, all bins are unloaded, and all robots stand at their ends.

    Pickers stand anywhere, carriers in the queue with a bin, back from the load-out.
    """
    fixed = world.fixed
    if world.is_any_hauling:
        return False
    if not _is_all_unloaded(world):
        return False
    pickers = fixed.pickers.tolist()
    carriers = fixed.carriers.tolist()
    for robot in pickers + carriers:
        if not is_at_rest(world, robot):
            return False
    return all(_waits_in_queue(world, carrier) for carrier in carriers)


def _is_all_unloaded(world: World) -> bool:
    """Whether all rows are picked, and all bins are unloaded."""
    is_all_picked = False not in world.rows_done.tolist()
    return is_all_picked and max(world.fill.tolist()) < world.fixed.bin_least


def _waits_in_queue(world: World, carrier: int) -> bool:
    """Whether a carrier is in the queue, faces east and has a bin."""
    x, y, yaw = world.pose[carrier].tolist()
    area = world.layout.queue.area
    is_there = area._replace(east=area.east + PAST_HEAD).contains(x, y)
    faces_east = abs(angle_between(yaw, EAST)) <= FACING
    return is_there and faces_east and bool(world.coupled[carrier] != NONE)
