"""Between a world and its place in a snapshot."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields
from typing import Any

import numpy as np

from orchard.contract.messages import FASTEST, LAST_TICK, TRAFFIC
from orchard.field.kinds import KINDS
from orchard.field.layout import ROW_LENGTH, lay_out
from orchard.field.problems import ScenarioError
from orchard.field.scenario import check
from orchard.sim.snapshot import Snapshot, SnapshotError
from orchard.sim.world import NOBODY, World, new_world

FURTHEST = 1e12  # m that a body can have driven by then


def world_as_data(world: World) -> dict[str, Any]:
    """Every field of a world but its layout."""
    values = {field.name: getattr(world, field.name) for field in fields(world) if field.name != "layout"}
    return {name: value.tobytes() if isinstance(value, np.ndarray) else value for name, value in values.items()}


@contextmanager
def fitting(snapshot: Snapshot) -> Iterator[None]:
    """Within this, what a snapshot holds is looked at: where it does not fit together, SnapshotError is raised."""
    try:
        yield
    except (ScenarioError, KeyError, ValueError, TypeError, OverflowError) as error:
        words = f"there is no {error}" if isinstance(error, KeyError) else str(error)
        raise SnapshotError(f"the snapshot of tick {snapshot.world.get('tick')} does not fit together: {words}") from error


def world_from(snapshot: Snapshot) -> World:
    """The world of a snapshot. Raises SnapshotError for one that does not fit its scenario, or in which something cannot be."""
    with fitting(snapshot):
        world = new_world(lay_out(check(snapshot.scenario, "the snapshot's scenario")))
        for field in fields(world):
            if field.name != "layout":
                setattr(world, field.name, _like(getattr(world, field.name), snapshot.world[field.name]))
        strangers = {*snapshot.held, *snapshot.memories} - {*world.layout.names, TRAFFIC}
        faults = [*_faults(world), *(f"{name}: there is no such agent" for name in sorted(strangers))]
        if faults:
            raise ValueError("; ".join(faults[:5]))
    return world


def _like(old: Any, value: Any) -> Any:
    """A field's value, in the type and shape that it has at the beginning."""
    if not isinstance(old, np.ndarray):
        if type(value) is not type(old):
            raise ValueError(f"{value!r} is no {type(old).__name__}")
        return value
    if old.dtype == bool and not set(value) <= {0, 1}:
        raise ValueError("a truth is 0 or 1")
    return np.frombuffer(value, old.dtype).reshape(old.shape).copy()


def _faults(world: World) -> Iterator[str]:
    """The fields in which something stands that cannot be."""
    west, south = world.walls[:, :2].min(axis=0)
    east, north = world.walls[:, :2].max(axis=0)
    x, y, yaw = world.pose.T
    spans = {
        "tick": (world.tick, 0, LAST_TICK),
        "pose": (x, west, east),
        "pose's y": (y, south, north),
        "pose's yaw": (yaw, -10.0, 10.0),
        "twist": (world.twist, -FASTEST, FASTEST),
        "fill": (world.fill, 0.0, ROW_LENGTH),
        "row_picked": (world.row_picked, 0.0, ROW_LENGTH),
        "row_from": (world.row_from, -1, 1),
        "bay_ticks": (world.bay_ticks, 0, LAST_TICK),
        "delivered": (world.delivered, 0, LAST_TICK),
        "distance": (world.distance, 0.0, FURTHEST),
        "refused": (world.refused, 0, LAST_TICK),
        "held": (world.held, 0, LAST_TICK),
    }
    for name, (value, least, most) in spans.items():
        if not (np.greater_equal(value, least) & np.less_equal(value, most)).all():  # not so of what is not a number
            yield f"{name}: wanted is {least:g} to {most:g}"
    if not _are_pairs(world):
        yield "coupled: wanted are pairs of a robot that tows and a bin"


def _are_pairs(world: World) -> bool:
    """Whether who is coupled to another is coupled to it in turn, the one a bin, the other a robot that tows."""
    kinds, coupled = [start.kind for start in world.layout.starts], world.coupled.tolist()
    pairs = [(i, j) for i, j in enumerate(coupled) if j != NOBODY]
    return all(0 <= j < len(coupled) and coupled[j] == i and _tow(kinds[i], kinds[j]) for i, j in pairs)


def _tow(one: str, other: str) -> bool:
    return any(KINDS[robot].tows > 0.0 and towed == "bin" for robot, towed in ((one, other), (other, one)))
