"""A run that goes on with something changed: what may change under way, and the snapshot with the changes."""

from collections.abc import Collection, Mapping, Sequence
from functools import reduce
from operator import getitem
from typing import Any

import numpy as np

from orchard.agents.carrier import Carrier, CarrierMemory
from orchard.agents.catalogue import make_agents
from orchard.agents.robot import Step
from orchard.contract.agent import STATES
from orchard.contract.messages import Written, pack, unpack
from orchard.field.kinds import DISPATCH, kind_of, number_of
from orchard.field.layout import Layout, lay_out
from orchard.field.problems import Problem, ScenarioError
from orchard.field.scenario import with_changes
from orchard.sim.engine import Engine
from orchard.sim.invariants import overlapping_bodies
from orchard.sim.restore import fitting, world_from
from orchard.sim.snapshot import Snapshot
from orchard.sim.world import NONE, World

_GROUND = "the orchard, its roads and what fills a bin stay as they are while a run goes on"
_ROWS = "which picker picks which rows is settled when a run begins; a picker can be stopped"
_COURSES = "robots are on courses that were made for it"
FIXED: Mapping[str, str] = {  # what cannot change under way -> why
    **dict.fromkeys(
        (
            "rows",
            "row_length",
            "row_width",
            "survey",
            "bay",
            "route",
            "metres_per_bin",
            "bins_per_row",
            "crop",
        ),
        _GROUND,
    ),
    **dict.fromkeys(("pickers", "rows_to_pickers", "order_in_row"), _ROWS),
    "sensors": _COURSES,
}
NULL_OR_NOT = (
    "picking.failure.mean_between",
    "carrying.failure.mean_between",
    "carrying.battery.hours",
)  # what cannot change either


class NotNow(ScenarioError):
    """A change that cannot be at this moment, and may be at another one: what it adds has no place, or what it takes away is at work."""


Names = Mapping[str, str]  # pairs of names that are swapped


def forked(snapshot: Snapshot, changes: Mapping[str, Any], stop: Sequence[str] = ()) -> Snapshot:
    """Return the snapshot of a run that goes on from this one with some values of its scenario changed.

    `changes`: dotted path -> value, as for `with_changes`. `stop`: names or kinds of robots that stand from now on, until they are reset.

    What is random from now on follows from the seed: with another one people and animals walk elsewhere, robots fail at other times, and
    what is left of the rows takes another time. A carrier that is added begins at a free place of the queue; one that waits there with an
    empty bin is taken away, and the queue stays as long. People, animals and weeds begin at their starts. New robots have rested.

    Raises SnapshotError, ScenarioError for what cannot change, NotNow for what cannot now, ValueError for another word in `stop`.
    """
    before = world_from(snapshot)
    old, now = before.layout.scenario, with_changes(before.layout.scenario, **changes)
    shrinks = (
        now.queue_carriers < old.queue_carriers
    )  # the queue stays as long as before: carriers are on their way to it
    layout = lay_out(with_changes(now, queue_room=old.queue_carriers) if shrinks else now)
    _check_changes(before.layout, layout)
    make_agents(layout)  # what cannot be made is a mistake of the changes, and not of the snapshot
    swapped = _swapped(before, snapshot, layout)
    with fitting(snapshot):
        places = _places(before.layout, layout, snapshot.memories, swapped)
        memories = _memories(
            before.layout, layout, _renamed(snapshot.memories, swapped), snapshot.elsewhere, places
        )
        letters = unpack(
            pack(_renamed(unpack(pack(snapshot.letters), Any), swapped)),
            list[tuple[int, dict[str, Written]]],
        )
    world = _world(before, World(layout), swapped, places)
    figures = _renamed(snapshot.figures, swapped)
    figures["is_changed"] = (
        figures.get("is_changed", False) or layout.scenario != before.layout.scenario
    )
    resting = [
        world.tick - figures["states"]["since"] if state == "resting" else 0 for state in STATES
    ]
    figures["states"]["ticks"] = {name: list(resting) for name in layout.names} | figures["states"][
        "ticks"
    ]
    engine = Engine(world, snapshot.digest, figures)
    if stop:
        engine.stop(stop)
    figures |= engine.figures_as_data()
    owned = sorted(
        name for name in layout.agents if name in snapshot.owned or name not in before.layout.agents
    )
    rest = figures, owned, snapshot.lost, snapshot.elsewhere
    return Snapshot(
        snapshot.run,
        layout.scenario.model_dump(),
        engine.as_data(),
        engine.digest,
        memories,
        letters,
        *rest,
    )


def _check_changes(before: Layout, now: Layout) -> None:
    """Raise ScenarioError for what cannot change under way."""
    old, new = before.scenario.model_dump(), now.scenario.model_dump()
    why = {path: why for path, why in FIXED.items() if old[path] != new[path]}
    why |= {
        path: _COURSES
        for path in NULL_OR_NOT
        if (_at(old, path) is None) != (_at(new, path) is None)
    }
    if _lines(before) != _lines(now) and not why:
        few, many = before.scenario.queue_carriers, now.scenario.queue_carriers
        larger = {
            count: with_changes(now.scenario, carriers=count, queue_room=None)
            for count in range(few + 1, many)
        }
        most = max(
            (count for count, one in larger.items() if _lines(lay_out(one)) == _lines(before)),
            default=few,
        )
        lines = "the lines of the queue would be others, and carriers are on their way to those that there are"
        why["carriers" if many == now.scenario.carrier_count else "queue_room"] = (
            f"{lines}; expected at most {most}"
        )
    if why:
        raise ScenarioError(
            [
                _refused(f"cannot change under way: {text}", path, _at(new, path))
                for path, text in why.items()
            ]
        )


def _refused(why: str, path: str = "", value: object = "") -> Problem:
    return Problem("changes", why, path, str(value))


def _lines(layout: Layout) -> tuple[Any, ...]:
    """What says in which line of the queue each carrier waits. A single line may become longer."""
    queue = layout.queue
    return queue.lines, layout.first_charging, queue.places if len(queue.lines) > 1 else 0


def _at(values: Mapping[str, Any], path: str) -> Any:
    return reduce(getitem, path.split("."), values)


# -- names: the carriers that are taken away, and their bins, change names with the last ones


def _swapped(before: World, snapshot: Snapshot, now: Layout) -> Names:
    carriers = [start.name for start in before.layout.starts if start.kind == "carrier"]
    count = len(carriers) - now.scenario.carrier_count
    if count <= 0:
        return {}
    free = [name for name in carriers if _is_free(before, name, snapshot.memories.get(name))]
    if len(free) < count:
        words = f"only {len(free)} of them wait in the queue with an empty bin at this moment"
        raise NotNow(
            [
                _refused(
                    f"{count} cannot be taken away: {words}", "carriers", now.scenario.carrier_count
                )
            ]
        )
    names, bins = (
        before.layout.names,
        sorted(
            name for name in before.layout.names if name not in now.index and name.startswith("bin")
        ),
    )
    taken = [names[before.coupled[before.index[name]]] for name in free[-count:]]
    return _pairs(free[-count:], carriers[-count:]) | _pairs(taken, bins)


def _is_free(world: World, carrier: str, memory: bytes | None) -> bool:
    """Whether a carrier stands in the queue with an empty bin, and has no job."""
    i = world.index[carrier]
    stands = (
        world.coupled[i] != NONE and not world.fill[world.coupled[i]] and not world.twist[i].any()
    )
    is_called = _remembered(memory).get("job") is not None
    return bool(stands and world.layout.queue.area.contains(*world.pose[i, :2]) and not is_called)


def _remembered(memory: bytes | None) -> Mapping[str, Any]:
    """The fields of a carrier's memory; none before its first tick, or if an own class remembers something else."""
    fields = unpack(memory, Any) if memory else None
    return fields if isinstance(fields, dict) else {}


def _places(
    before: Layout, now: Layout, memories: Mapping[str, bytes | None], swapped: Names
) -> dict[str, int]:
    """The place in the queue of each carrier, from 1: what it was until now, or the first free one."""
    carriers = [name for name in now.names if kind_of(name) == "carrier"]
    kept = {
        name: swapped.get(name, name)
        for name in carriers
        if swapped.get(name, name) in before.index
    }
    places = {
        name: _remembered(memories.get(old)).get("queue_place") or number_of(old)
        for name, old in kept.items()
    }
    free = sorted({*range(1, len(carriers) + 1)}.difference(places.values()))
    return places | dict(zip([name for name in carriers if name not in places], free, strict=False))


def _pairs(some: Sequence[str], others: Sequence[str]) -> dict[str, str]:
    """Each name that is only in one of both sequences, with its partner."""
    pairs = list(
        zip(
            [name for name in some if name not in others],
            [name for name in others if name not in some],
            strict=True,
        )
    )
    return dict(pairs) | {other: name for name, other in pairs}


def _renamed(data: Any, swapped: Names) -> Any:
    """Return plain data with names swapped in all of it, also in what is packed in it."""
    match data:
        case dict():
            return {_renamed(key, swapped): _renamed(value, swapped) for key, value in data.items()}
        case list() | tuple():
            return [_renamed(value, swapped) for value in data]
        case str():
            return swapped.get(data, data)
        case bytes() if swapped and data:
            return pack(_renamed(unpack(data, Any), swapped))
    return data


# -- the world


def _world(before: World, world: World, swapped: Names, places: Mapping[str, int]) -> World:
    """Let a new world go on from one before. Raises ScenarioError for a new body without a place."""
    index = world.index
    kept = [name for name in index if swapped.get(name, name) in before.index]
    here, there = (
        [index[name] for name in kept],
        [before.index[swapped.get(name, name)] for name in kept],
    )
    bodies, place = len(before.layout.names), dict(zip(there, here, strict=True))
    for name, value in before.state.items():
        if isinstance(value, np.ndarray) and len(value) == bodies and name != "row_ends":
            getattr(world, name)[here] = value[there]
        else:
            setattr(world, name, value)
    world.coupled[here] = [place.get(j, NONE) for j in before.coupled[there].tolist()]
    for name in [name for name in index if name not in kept and kind_of(name) == "carrier"]:
        _put_into_its_line(world, name, places[name] - 1)
    for name in index:
        if name not in kept and (other := _in_the_way(world, name)):
            raise NotNow([_refused(f"{name} has no place at this moment: {other} is there")])
    return world


def _put_into_its_line(world: World, carrier: str, number: int) -> None:
    """Put a new carrier, with its bin, to the free place of its line that is nearest to its own, `number` from 0, if there is one."""
    i, queue = world.index[carrier], world.layout.queue
    first = number - number % queue.places
    bin_ = int(world.coupled[i])
    for place in sorted(range(first, first + queue.places), key=lambda place: abs(place - number)):
        world.pose[[i, bin_], :2] += np.subtract(queue.place(place)[:2], world.pose[i, :2])
        if not any(_in_the_way(world, world.layout.names[body]) for body in (i, bin_)):
            break
    world.reckoned[[i, bin_]] = world.pose[[i, bin_]]


def _in_the_way(world: World, name: str) -> str:
    """The body or obstacle that a body overlaps; '' if there is none."""
    pairs = (what.removeprefix("inside ").split(" ", 1) for what, _ in overlapping_bodies(world))
    return next((other if one == name else one for one, other in pairs if name in (one, other)), "")


# -- what agents remember


def _memories(
    before: Layout,
    now: Layout,
    memories: Mapping[str, bytes | None],
    elsewhere: Collection[str],
    places: Mapping[str, int],
) -> dict[str, bytes | None]:
    """Return the memories with which agents go on. Their courses are those of the layout now. An agent of another class, or one in place
    of a client elsewhere, begins anew if the memory is not its own; so does the dispatcher if the policy or the carriers are others: it
    hears of all bins within 2 s."""
    old, new = make_agents(before), make_agents(now)
    is_other = (
        before.scenario.dispatch != now.scenario.dispatch
        or before.scenario.carrier_count != now.scenario.carrier_count
    )
    kept = dict[str, bytes | None]()
    for name, memory in memories.items():
        if name not in new or (name == DISPATCH and is_other):
            continue
        try:
            remembered = None if memory is None else unpack(memory, new[name].Memory)
        except ValueError:
            if before.scenario.own_classes == now.scenario.own_classes and name not in elsewhere:
                raise
            continue
        course, other = (getattr(agents[name].agent, "course", None) for agents in (old, new))
        if remembered is not None and course and other:
            if isinstance(remembered, CarrierMemory):
                remembered.queue_place = places[name]
            remembered.plan = _plan(remembered.plan, course(remembered), other(remembered))
            memory = pack(remembered)
        kept[name] = memory
    begun = {
        name: agent.begin(places[name])
        for name in places
        if isinstance(agent := new[name].agent, Carrier)
    }
    return {name: pack(memory) for name, memory in begun.items()} | kept


def _plan(plan: list[Step], before: list[Step], now: list[Step]) -> list[Step]:
    """Return a plan that was a part of a course as a part of the course now. A plan that was done ends where the course ends now."""
    steps = [(was, step) for was, step in zip(before, now, strict=True) if was != step]
    if not plan and steps and before[-1] != now[-1]:
        return now[-1:]
    return [next((step for was, step in steps if was == present), present) for present in plan]
