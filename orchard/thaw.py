"""Between a world and its place in a snapshot."""

from dataclasses import fields
from typing import Any

import numpy as np

from orchard.config import ScenarioError, check
from orchard.layout import lay_out
from orchard.snapshot import Snapshot, SnapshotError
from orchard.world import World, new_world


def world_as_data(world: World) -> dict[str, Any]:
    """Every field of a world but its layout."""
    values = {field.name: getattr(world, field.name) for field in fields(world) if field.name != "layout"}
    return {name: value.tobytes() if isinstance(value, np.ndarray) else value for name, value in values.items()}


def world_from(snapshot: Snapshot) -> World:
    """The world of a snapshot. Raises SnapshotError for one that does not fit its scenario."""
    try:
        world = new_world(lay_out(check(snapshot.scenario, "the snapshot's scenario")))
        for field in fields(world):
            if field.name != "layout":
                setattr(world, field.name, _like(getattr(world, field.name), snapshot.world[field.name]))
    except (ScenarioError, KeyError, ValueError, TypeError) as error:
        raise SnapshotError(f"the snapshot of tick {snapshot.world.get('tick')} does not fit together: {error}") from error
    return world


def _like(old: Any, value: Any) -> Any:
    """A field's value, in the type and shape that it has at the beginning."""
    return np.frombuffer(value, old.dtype).reshape(old.shape).copy() if isinstance(old, np.ndarray) else type(old)(value)
