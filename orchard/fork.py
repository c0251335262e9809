"""A run that goes on with something changed: what may change under way, and the snapshot with the
changes.
"""

from collections.abc import Collection, Mapping, Sequence
from functools import reduce
from operator import getitem
from typing import Any

import numpy as np

from orchard.behaviour.carrier import Carrier, CarrierMemory
from orchard.behaviour.catalogue import make_agents
from orchard.contract.agent import STATES, Agent
from orchard.contract.guard import Guard
from orchard.contract.messages import Written, pack, unpack
from orchard.field.kinds import DISPATCH, kind_of, number_of
from orchard.field.layout import Layout, lay_out
from orchard.field.problems import Problem, ScenarioError
from orchard.field.scenario import with_changes
from orchard.plans.robot import Step
from orchard.sim.engine import Engine
from orchard.sim.invariants import overlapping_bodies
from orchard.sim.restore import fitting, world_from
from orchard.sim.snapshot import Snapshot
from orchard.sim.world import NONE, World

_GROUND = "the orchard, its roads and what fills a bin stay as they are while a run goes on"
_ROWS = "which picker picks which rows is settled when a run begins; a picker can be stopped"
_COURSES = "robots are on courses that were made for it"
_OF_THE_GROUND = (
    "rows",
    "row_length",
    "row_width",
    "survey",
    "bay",
    "bays",
    "route",
    "metres_per_bin",
    "bins_per_row",
    "crop",
)
_OF_THE_ROWS = ("pickers", "picker_absences", "rows_to_pickers", "order_in_row")
# What cannot change under way -> why.
FIXED: Mapping[str, str] = {
    **dict.fromkeys(_OF_THE_GROUND, _GROUND),
    **dict.fromkeys(_OF_THE_ROWS, _ROWS),
    "sensors": _COURSES,
    "load_out.trailers": "bins stand on the trailers that there are",
    "load_out.empty_bins": "all these bins are at the bay, or on trailers from there",
}
# What cannot become null, nor get a value if it was null.
NULL_OR_NOT = (
    "picking.failure.mean_between",
    "carrying.failure.mean_between",
    "carrying.battery.hours",
    "load_out.metres",
    "load_out.speed",
    "load_out.seconds_away",
)

# Pairs of names that are swapped: each name -> its partner.
Names = Mapping[str, str]


class NotNow(ScenarioError):
    """A change that cannot be at this moment, and may be at another one.

    What it adds has no place, or what it takes away is at work.
    """


def forked(snapshot: Snapshot, changes: Mapping[str, Any], stop: Sequence[str] = ()) -> Snapshot:
    """Return the snapshot of a run that goes on from this one with some values changed.

    `changes`: dotted path of a value of the scenario -> value, as for `with_changes`. `stop`: names
    or kinds of robots that stand from now on, until they are reset.

    What is random from now on follows from the seed: with another one people and animals walk
    elsewhere, robots fail at other times, and what remains of the rows takes another time. A
    carrier that is added begins at a free place of the queue; one that waits there with an empty
    bin is taken away, and the queue stays as long. People, animals and weeds begin at their starts.
    New robots have rested.

    Raises SnapshotError, ScenarioError for what cannot change, NotNow for what cannot now,
    ValueError for another word in `stop`.
    """
    before = world_from(snapshot)
    old_layout = before.layout
    layout = _changed_layout(old_layout, changes)
    # What cannot be made is a mistake of the changes, and not of the snapshot.
    make_agents(layout)
    swapped = _swapped(before, snapshot, layout)
    with fitting(snapshot):
        places = _places(old_layout, layout, snapshot.memories, swapped)
        renamed = _renamed(snapshot.memories, swapped)
        memories = _memories(old_layout, layout, renamed, snapshot.elsewhere, places)
        letters = _renamed_letters(snapshot, swapped)
    world = _world(before, World(layout), swapped, places)
    figures = _figures(_renamed(snapshot.figures, swapped), old_layout, layout, world.tick)
    engine = Engine(world, snapshot.digest, figures)
    if stop:
        engine.stop(stop)
    figures |= engine.figures_as_data()
    added = set(layout.agents).difference(old_layout.agents)
    owned = [name for name in layout.agents if name in snapshot.owned or name in added]
    return Snapshot(
        run=snapshot.run,
        scenario=layout.scenario.model_dump(),
        world=engine.as_data(),
        digest=engine.digest,
        memories=memories,
        letters=letters,
        figures=figures,
        owned=sorted(owned),
        lost=snapshot.lost,
        elsewhere=snapshot.elsewhere,
    )


def _changed_layout(before: Layout, changes: Mapping[str, Any]) -> Layout:
    """Return the layout with some values changed. Raises ScenarioError for what cannot change."""
    old = before.scenario
    scenario = with_changes(old, **changes)
    # The queue stays at least as long as before: carriers are on their way to it.
    if scenario.queue_carriers < old.queue_carriers:
        scenario = with_changes(scenario, queue_room=old.queue_carriers)
    layout = lay_out(scenario)
    _check_changes(before, layout)
    return layout


def _renamed_letters(snapshot: Snapshot, swapped: Names) -> list[tuple[int, dict[str, Written]]]:
    """Return the letters that are under way, with names swapped in all of them."""
    plain = unpack(pack(snapshot.letters), Any)
    letters: list[tuple[int, dict[str, Written]]] = unpack(
        pack(_renamed(plain, swapped)), list[tuple[int, dict[str, Written]]]
    )
    return letters


def _figures(figures: dict[str, Any], before: Layout, after: Layout, tick: int) -> dict[str, Any]:
    """Return the figures so far. A robot that is new has rested until now."""
    states = figures["states"]
    resting = [tick - states["since"] if state == "resting" else 0 for state in STATES]
    states["ticks"] = {name: list(resting) for name in after.names} | states["ticks"]
    is_changed = figures.get("is_changed", False) or after.scenario != before.scenario
    return figures | {"is_changed": is_changed}


def _check_changes(before: Layout, after: Layout) -> None:
    """Raise ScenarioError if the scenarios differ in what cannot change under way."""
    old_values = before.scenario.model_dump()
    new_values = after.scenario.model_dump()
    reasons = {
        path: why
        for path, why in FIXED.items()
        if _value_at(old_values, path) != _value_at(new_values, path)
    }
    for path in NULL_OR_NOT:
        was_null = _value_at(old_values, path) is None
        is_null = _value_at(new_values, path) is None
        if was_null != is_null:
            reasons[path] = _COURSES
    if not reasons and _queue_lines(before) != _queue_lines(after):
        reasons = _too_many_carriers(before, after)
    problems = []
    for path, why in reasons.items():
        value = _value_at(new_values, path)
        problems.append(_problem(f"cannot change under way: {why}", path, value))
    if problems:
        raise ScenarioError(problems)


def _too_many_carriers(before: Layout, after: Layout) -> dict[str, str]:
    """Return why the queue cannot grow so much, by the key that asks for it."""
    most = before.scenario.queue_carriers
    for count in range(most + 1, after.scenario.queue_carriers):
        larger = lay_out(with_changes(after.scenario, carriers=count, queue_room=None))
        if _queue_lines(larger) == _queue_lines(before):
            most = count
    is_by_carriers = after.scenario.queue_carriers == after.scenario.carrier_count
    if is_by_carriers:
        key = "carriers"
    else:
        key = "queue_room"
    why = (
        "the lines of the queue would be others, "
        "and carriers are on their way to those that there are"
    )
    return {key: f"{why}; expected at most {most}"}


def _problem(why: str, path: str = "", value: object = "") -> Problem:
    return Problem("changes", why, path, str(value))


def _queue_lines(layout: Layout) -> tuple[Any, ...]:
    """Return what says in which line of the queue each carrier waits.

    A single line may become longer.
    """
    queue = layout.queue
    places = queue.places if len(queue.lines) > 1 else 0
    return queue.lines, layout.first_charging, places


def _value_at(values: Mapping[str, Any], path: str) -> Any:
    """Return the value at a dotted path."""
    return reduce(getitem, path.split("."), values)


# -- names: the carriers that are taken away, and their bins, change names with the last ones


def _swapped(before: World, snapshot: Snapshot, after: Layout) -> Names:
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
        raise NotNow([_problem(text, "carriers", after.scenario.carrier_count)])
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


def _places(
    before: Layout, after: Layout, memories: Mapping[str, bytes | None], swapped: Names
) -> dict[str, int]:
    """Return the place in the queue of each carrier, from 1.

    It is what it was until now, or the first free one.
    """
    carriers = after.names_of("carrier")
    places = {}
    added = []
    for name in carriers:
        old_name = swapped.get(name, name)
        if old_name in before.index:
            remembered_place = _remembered(memories.get(old_name)).get("queue_place")
            places[name] = remembered_place or number_of(old_name)
        else:
            added.append(name)
    taken = set(places.values())
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
    """Let a new world go on from one before. Raises NotNow for a new body without a place.

    `places`: carrier -> its place in the queue, from 1.
    """
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
            raise NotNow([_problem(f"{name} has no place at this moment: {obstacle} is there")])
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
    are_away = world.trailers[:, 1] > world.tick
    back = world.trailers[are_away, 1] + new.trailer_ticks - old.trailer_ticks
    world.trailers[are_away, 1] = np.maximum(world.tick, back)


def _put_into_its_line(world: World, carrier: str, number: int) -> None:
    """Put a new carrier, with its bin, to a free place of its line, if there is one.

    It is the one that is nearest to its own, `number` from 0.
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
    for fault, _ in overlapping_bodies(world):
        body, other = fault.removeprefix("inside ").split(" ", 1)
        if body == name:
            return other
        if other == name:
            return body
    return ""


# -- what agents remember


def _memories(
    before: Layout,
    after: Layout,
    memories: Mapping[str, bytes | None],
    elsewhere: Collection[str],
    places: Mapping[str, int],
) -> dict[str, bytes | None]:
    """Return the memories with which agents go on: agent -> memory.

    `memories`: those until now. `elsewhere`: agents that clients elsewhere replaced. `places`:
    carrier -> its place in the queue, from 1. An agent of another class, or one in place of a
    client elsewhere, begins anew if the memory is not its own. So does the dispatcher if the policy
    or the carriers are others: it hears of all bins within 2 s. Raises ValueError for a memory
    that should fit.
    """
    old_agents = make_agents(before)
    new_agents = make_agents(after)
    staying = {name: memory for name, memory in memories.items() if name in new_agents}
    if _dispatches_otherwise(before, after):
        staying.pop(DISPATCH, None)
    has_other_classes = before.scenario.own_classes != after.scenario.own_classes
    may_begin_anew = elsewhere
    if has_other_classes:
        may_begin_anew = new_agents
    going_on: dict[str, bytes | None] = _begun_carriers(new_agents, places)
    for name, remembered in _fitting(staying, new_agents, may_begin_anew).items():
        if name in places and isinstance(remembered, CarrierMemory):
            remembered.queue_place = places[name]
        is_replanned = staying[name] is not None and _replan(
            remembered, old_agents[name].agent, new_agents[name].agent
        )
        going_on[name] = staying[name]
        if is_replanned:
            going_on[name] = pack(remembered)
    return going_on


def _begun_carriers(
    agents: Mapping[str, Guard], places: Mapping[str, int]
) -> dict[str, bytes | None]:
    """Return the memories of carriers that begin at their places in the queue.

    A carrier of another class than `Carrier` begins without a memory, and is left out.
    """
    begun = dict[str, bytes | None]()
    for name, place in places.items():
        carrier = agents[name].agent
        if isinstance(carrier, Carrier):
            begun[name] = pack(carrier.begin(place))
    return begun


def _fitting(
    memories: Mapping[str, bytes | None],
    agents: Mapping[str, Guard],
    may_begin_anew: Collection[str],
) -> dict[str, Any]:
    """Return the memories that fit their agents, unpacked: agent -> memory, None if it has none.

    `may_begin_anew`: agents whose memory is left out if it does not fit. Raises ValueError for
    another one that does not.
    """
    fitting = dict[str, Any]()
    for name, memory in memories.items():
        if memory is None:
            fitting[name] = None
            continue
        try:
            fitting[name] = unpack(memory, agents[name].Memory)
        except ValueError:
            if name not in may_begin_anew:
                raise
    return fitting


def _replan(memory: Any, before: Agent, after: Agent) -> bool:
    """Let the plan in a memory follow the course that its agent has now.

    Return whether both agents, the one before and the one after, have a course.
    """
    old_course = getattr(before, "course", None)
    new_course = getattr(after, "course", None)
    if not old_course or not new_course:
        return False
    memory.plan = _plan(memory.plan, old_course(memory), new_course(memory))
    return True


def _dispatches_otherwise(before: Layout, after: Layout) -> bool:
    """Whether the dispatcher begins anew: with another policy, or other carriers."""
    has_other_policy = before.scenario.dispatch != after.scenario.dispatch
    has_other_carriers = before.scenario.carrier_count != after.scenario.carrier_count
    return has_other_policy or has_other_carriers


def _plan(plan: list[Step], before: list[Step], after: list[Step]) -> list[Step]:
    """Return a plan that was a part of a course as a part of the course now.

    A plan that was done ends where the course ends now.
    """
    changed = [(old, new) for old, new in zip(before, after, strict=True) if old != new]
    if not plan and changed and before[-1] != after[-1]:
        return after[-1:]
    return [next((new for old, new in changed if old == step), step) for step in plan]
