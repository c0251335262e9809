"""Which robots go and come when a run goes on with another number of carriers.

Bodies are numbered, and a layout with fewer carriers lacks the last ones. But only a carrier that
waits in the queue with an empty bin can be taken away. So such a carrier and its bin swap names
with the last ones first: in the world, in memories, in letters and in figures.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from orchard.contract.messages import Written, pack, unpack
from orchard.field.kinds import number_of
from orchard.field.layout import Layout
from orchard.fork.changes import NotNow, problem
from orchard.sim.snapshot import Snapshot
from orchard.sim.world import NONE, World

# Pairs of names that are swapped: each name -> its partner.
Names = Mapping[str, str]


def swapped_names(before: World, snapshot: Snapshot, after: Layout) -> Names:
    """Return the names that are swapped so that those which go are the last ones.

    Raises NotNow if too few carriers wait in the queue to be taken away.
    """
    carriers = before.layout.names_of("carrier")
    count = len(carriers) - after.scenario.carrier_count
    if count <= 0:
        return {}
    free = [name for name in carriers if _is_free(before, name, snapshot.memories.get(name))]
    if len(free) < count:
        words = f"only {len(free)} of them wait in the queue with an empty bin at this moment"
        text = f"{count} cannot be taken away: {words}"
        raise NotNow([problem(text, "carriers", after.scenario.carrier_count)])
    leaving = free[-count:]
    bodies = [before.index[name] for name in leaving]
    their_bins = before.layout.names_at(before.coupled[bodies].tolist())
    bins = before.layout.names_of("bin")
    last_bins = sorted(name for name in bins if name not in after.index)
    return _pairs(leaving, carriers[-count:]) | _pairs(their_bins, last_bins)


def _is_free(world: World, carrier: str, memory: bytes | None) -> bool:
    """Whether a carrier stands in the queue with an empty bin, and has no job."""
    body = world.index[carrier]
    bin_ = world.coupled[body]
    has_empty_bin = bin_ != NONE and not world.fill[bin_]
    stands = not world.twist[body].any()
    is_in_queue = world.layout.queue.area.contains(*world.pose[body, :2])
    has_job = _remembered(memory).get("job") is not None
    return bool(has_empty_bin and stands and is_in_queue and not has_job)


def _remembered(memory: bytes | None) -> Mapping[str, Any]:
    """Return the fields of a carrier's memory.

    There are none before its first tick, or if an own class remembers something else.
    """
    if not memory:
        return {}
    fields = unpack(memory, Any)
    if isinstance(fields, dict):
        return fields
    return {}


def places_in_queue(
    before: Layout, after: Layout, memories: Mapping[str, bytes | None], swapped: Names
) -> dict[str, int]:
    """Return the place in the queue of each carrier, from 1.

    It is what it was until now, or the first free one. `memories`: by the names of before.
    """
    carriers = after.names_of("carrier")
    places = {}
    added = []
    for name in carriers:
        old_name = swapped.get(name, name)
        if old_name in before.index:
            # 0, or none: its place is the number in its name, see `CarrierMemory.queue_place`.
            remembered_place = _remembered(memories.get(old_name)).get("queue_place")
            places[name] = remembered_place or number_of(old_name)
        else:
            added.append(name)
    taken = set(places.values())
    # At least as many as carriers are added, because each of the others takes one place at most.
    free = [place for place in range(1, len(carriers) + 1) if place not in taken]
    return places | dict(zip(added, free, strict=False))


def _pairs(some: Sequence[str], others: Sequence[str]) -> dict[str, str]:
    """Return each name that is only in one of both sequences, with its partner."""
    pairs = {}
    for name, partner in zip(_without(some, others), _without(others, some), strict=True):
        pairs[name] = partner
        pairs[partner] = name
    return pairs


def _without(names: Sequence[str], others: Sequence[str]) -> list[str]:
    """Return the names that are not among the others, in their order."""
    return [name for name in names if name not in others]


def renamed(data: Any, swapped: Names) -> Any:
    """Return plain data with names swapped in all of it, also in what is packed in it."""
    match data:
        case dict():
            return {renamed(key, swapped): renamed(value, swapped) for key, value in data.items()}
        case list() | tuple():
            return [renamed(value, swapped) for value in data]
        case str():
            return swapped.get(data, data)
        # An agent's memory in a snapshot. It is left as it is, to the byte, if no names change.
        case bytes() if swapped and data:
            return pack(renamed(unpack(data, Any), swapped))
    return data


def renamed_letters(snapshot: Snapshot, swapped: Names) -> list[tuple[int, dict[str, Written]]]:
    """Return the letters that are under way, with names swapped in all of them."""
    plain = unpack(pack(snapshot.letters), Any)
    letters: list[tuple[int, dict[str, Written]]] = unpack(
        pack(renamed(plain, swapped)), list[tuple[int, dict[str, Written]]]
    )
    return letters
