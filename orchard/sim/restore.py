"""Converts the data of a snapshot to a world, and refuses data that cannot be.

A snapshot is a file that anybody may have changed. So each value is checked before it is simulated.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from orchard.contract.messages import FASTEST, LAST_TICK
from orchard.field.kinds import HAULERS
from orchard.field.layout import lay_out
from orchard.field.problems import ScenarioError
from orchard.field.scenario import check
from orchard.sim.snapshot import Snapshot, SnapshotError
from orchard.sim.world import NONE, World

# m. No body drives so far by LAST_TICK: at the top speed of 100 m/s (FASTEST) it drives 6.9e11 m.
FURTHEST = 1e12


@contextmanager
def fitting(snapshot: Snapshot) -> Iterator[None]:
    """Convert errors that are raised while a snapshot is read to SnapshotError.

    They mean that the snapshot is inconsistent.
    """
    try:
        yield
    except (ScenarioError, KeyError, ValueError, TypeError, OverflowError) as error:
        fault = str(error)
        if isinstance(error, KeyError):
            fault = f"{error} is missing"
        tick = snapshot.world.get("tick")
        raise SnapshotError(f"the snapshot of tick {tick} is inconsistent: {fault}") from error


def world_from(snapshot: Snapshot) -> World:
    """Return the world of a snapshot.

    Raises SnapshotError if it does not fit its scenario, or a value is impossible.
    """
    # What is raised within, also the ValueError below, becomes a SnapshotError.
    with fitting(snapshot):
        world = World(lay_out(check(snapshot.scenario, "the snapshot's scenario")))
        for name, value in world.state.items():
            setattr(world, name, _like(value, snapshot.world[name]))
        faults = list(_faults(world))
        unknown = {*snapshot.owned, *snapshot.memories} - set(world.layout.agents)
        for name in sorted(unknown):
            faults.append(f"{name}: there is no such agent")
        if faults:
            # A few are enough for people.
            raise ValueError("; ".join(faults[:5]))
    return world


def _like(old: Any, value: Any) -> Any:
    """Return a field's value from a snapshot, of the type and shape of the world's own one.

    Raises ValueError if it cannot have them.
    """
    if not isinstance(old, np.ndarray):
        if type(value) is not type(old):
            raise ValueError(f"{value!r} is not of type {type(old).__name__}")
        return value
    if old.dtype == bool and not set(value) <= {0, 1}:
        raise ValueError("a boolean must be 0 or 1")
    return np.frombuffer(value, old.dtype).reshape(old.shape).copy()


def _faults(world: World) -> Iterator[str]:
    """Yield a sentence for each field with an impossible value."""
    west, south = world.layout.walls[:, :2].min(axis=0)
    east, north = world.layout.walls[:, :2].max(axis=0)
    x, y, yaw = world.pose.T
    load_out = world.layout.scenario.load_out
    # Field -> its value or values, the least and the most that each may be.
    spans: dict[str, tuple[Any, float, Any]] = {
        "tick": (world.tick, 0, LAST_TICK),
        "pose": (x, west, east),
        "pose's y": (y, south, north),
        # Yaw is kept within half a turn, 3.2 rad. Anything of that size does no harm.
        "pose's yaw": (yaw, -10.0, 10.0),
        "twist": (world.twist, -FASTEST, FASTEST),
        "fill": (world.fill, 0.0, world.fixed.bin_full),
        # (4, r) against (r,): no part of a row is longer than the row.
        "row_ends": (world.row_ends.T, 0.0, world.fixed.row_length),
        "pick_from": (world.pick_from, -FURTHEST, FURTHEST),
        "bay_ticks": (world.bay_ticks, 0, LAST_TICK),
        "hauling": (world.hauling, 0, world.layout.machines["carrier"].haul_ticks),
        "trailers": (world.trailers, 0, LAST_TICK),
        "waiting_bins": (world.waiting_bins, 0, load_out.empty_bins or 0),
        "delivered": (world.delivered, 0, LAST_TICK),
        "delivered_metres": (world.delivered_metres, 0.0, FURTHEST),
        "distance": (world.distance, 0.0, FURTHEST),
        "collisions": (world.collisions, 0, LAST_TICK),
        "charge": (world.charge, 0.0, 1.0),
        "bias": (world.bias, -FURTHEST, FURTHEST),
        "reckoned": (world.reckoned, -FURTHEST, FURTHEST),
        "refused": (world.refused, 0, LAST_TICK),
    }
    for name, (value, least, most) in spans.items():
        # Both comparisons are false for NaN.
        is_within = np.greater_equal(value, least) & np.less_equal(value, most)
        if not is_within.all():
            yield f"{name}: must be from {least:g} to {np.max(most):g}"
    if not _are_pairs(world):
        yield "coupled: must be pairs of a robot that tows and a bin"


def _are_pairs(world: World) -> bool:
    """Whether each coupling is one of a robot that tows and a bin, and both know of it."""
    starts = world.layout.starts
    coupled = world.coupled.tolist()
    for i, j in enumerate(coupled):
        if j == NONE:
            continue
        is_mutual = 0 <= j < len(coupled) and coupled[j] == i
        if not is_mutual:
            return False
        kind = starts[i].kind
        kind_of_partner = starts[j].kind
        if not (_tows(kind, kind_of_partner) or _tows(kind_of_partner, kind)):
            return False
    return True


def _tows(kind: str, kind_of_partner: str) -> bool:
    """Whether a body of a kind can tow one of the partner's kind."""
    return kind in HAULERS and kind_of_partner == "bin"
