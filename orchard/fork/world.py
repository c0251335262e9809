"""The world of a run that goes on with something changed: each body keeps its state, and new ones
get a place.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from orchard.field.kinds import kind_of
from orchard.fork.changes import NotNow, problem
from orchard.fork.names import Names
from orchard.sim.invariants import overlapping_bodies
from orchard.sim.world import NONE, World


def world_after(before: World, world: World, swapped: Names, places: Mapping[str, int]) -> World:
    """Let a new world go on from one before. Return it. Raises NotNow for a new body without a
    place.

    `world`: at its start; it is changed. `places`: carrier -> its place in the queue, from 1.
    """
    # The same body in the world before and in the new one, and the names of the bodies without one.
    old_bodies = []
    new_bodies = []
    added = []
    for name, body in world.index.items():
        old_name = swapped.get(name, name)
        if old_name in before.index:
            old_bodies.append(before.index[old_name])
            new_bodies.append(body)
        else:
            added.append(name)
    _take_over(before, world, old_bodies, new_bodies)
    for name in added:
        if kind_of(name) == "carrier":
            _put_into_its_line(world, name, places[name] - 1)
    for name in added:
        obstacle = _in_the_way(world, name)
        if obstacle:
            raise NotNow([problem(f"{name} has no place at this moment: {obstacle} is there")])
    return world


def _take_over(
    before: World, world: World, old_bodies: Sequence[int], new_bodies: Sequence[int]
) -> None:
    """Give a new world the state of one before. Bodies that were added keep their own.

    `old_bodies`, `new_bodies`: the numbers of the same bodies in both worlds.
    """
    body_count = len(before.layout.names)
    for field, value in before.state.items():
        has_entry_each = isinstance(value, np.ndarray) and len(value) == body_count
        # There may be as many rows, or trailers, as bodies.
        if has_entry_each and field not in ("row_ends", "trailers"):
            getattr(world, field)[new_bodies] = value[old_bodies]
        else:
            setattr(world, field, value)
    _be_back_otherwise(before, world)
    # The numbers of bodies in `coupled` are those of the world before.
    renumbered = dict(zip(old_bodies, new_bodies, strict=True))
    coupled = before.coupled[old_bodies].tolist()
    world.coupled[new_bodies] = [renumbered.get(body, NONE) for body in coupled]


def _be_back_otherwise(before: World, world: World) -> None:
    """Let what is on the way to the load-out be back as much earlier or later as it takes now."""
    old = before.layout.machines["carrier"]
    new = world.layout.machines["carrier"]
    are_hauling = world.hauling > 0
    left = world.hauling[are_hauling] + new.haul_ticks - old.haul_ticks
    world.hauling[are_hauling] = np.maximum(0, left)
    # The columns of `trailers` are bins, the tick of return, and bins that it took.
    are_away = world.trailers[:, 1] > world.tick
    back = world.trailers[are_away, 1] + new.trailer_ticks - old.trailer_ticks
    world.trailers[are_away, 1] = np.maximum(world.tick, back)


def _put_into_its_line(world: World, carrier: str, number: int) -> None:
    """Put a new carrier, with its bin, to a free place of its line, if there is one.

    It is the one that is nearest to its own, `number` from 0. If none is free, the carrier stays at
    the last one that was tried, in the way of what is there.
    """
    body = world.index[carrier]
    bin_ = int(world.coupled[body])
    queue = world.layout.queue
    first = number - number % queue.places
    of_line = range(first, first + queue.places)
    for place in sorted(of_line, key=lambda place: abs(place - number)):
        shift = np.subtract(queue.place(place)[:2], world.pose[body, :2])
        world.pose[[body, bin_], :2] += shift
        names = world.layout.names[body], world.layout.names[bin_]
        if not any(_in_the_way(world, name) for name in names):
            break
    world.reckoned[[body, bin_]] = world.pose[[body, bin_]]


def _in_the_way(world: World, name: str) -> str:
    """Return the body or obstacle that a body overlaps; '' if there is none."""
    # A fault reads "inside BODY OTHER".
    for fault, _ in overlapping_bodies(world):
        body, thing = fault.removeprefix("inside ").split(" ", 1)
        if body == name:
            return thing
        if thing == name:
            return body
    return ""
