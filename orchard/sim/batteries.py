"""The batteries of carriers: each is used with time, and charged where its carrier stands in a charging line and has a charger. A carrier
that stands in the queue or in a charging line is off: it uses nothing.

A charger reaches each place of the charging lines. It goes to the carrier that stands there nearest to a head, and stays with it until the
battery is full. A carrier whose battery is flat stands still.
"""

import numpy as np

from orchard.contract.events import Event, What
from orchard.contract.messages import Deed
from orchard.field.queue import BESIDE
from orchard.field.scenario import TIME_STEP
from orchard.sim.world import World

HOUR = 3600.0  # s
TOP_UP = 0.95  # charge below which a carrier that waits in a charging line is given a charger: a full one that stands there needs none yet
NEWS: tuple[What, ...] = (
    "charging",
    "charged",
    "flat",
)  # events after which a carrier may act otherwise


def without_flat(
    world: World, twists: np.ndarray, deeds: list[tuple[int, Deed]]
) -> tuple[np.ndarray, list[tuple[int, Deed]]]:
    """Return what bodies want, velocities (n, 3) and deeds, without those of which the battery is flat."""
    flat = world.charge <= 0.0
    if not flat.any():
        return twists, deeds
    return np.where(flat[:, None], 0.0, twists), [(i, deed) for i, deed in deeds if not flat[i]]


def advance(world: World) -> list[Event]:
    """Use and charge the batteries for one tick, after all bodies have moved. Return the events."""
    carriers, battery = world.fixed.carriers, world.layout.scenario.carrying.battery
    stands, before = ~world.twist[carriers].any(axis=1), world.charge[carriers]
    had = world.plugged[carriers]
    has = _with_chargers(world, stands, before)
    (x, y, _), area = world.pose[carriers].T, world.layout.queue.area
    is_off = stands & (x >= area.west) & (x <= area.east) & (y >= area.south) & (y <= area.north)
    use = np.select([is_off, stands], [0.0, battery.standing], 1.0) * (
        -TIME_STEP / HOUR / (battery.hours or np.inf)
    )
    after = np.clip(
        before + np.where(has & stands, TIME_STEP / HOUR / battery.hours_to_charge, use), 0.0, 1.0
    )
    world.charge[carriers], world.plugged[carriers] = after, has & (after < 1.0)
    happened = (
        ("charging", has & ~had),
        ("charged", has & (after >= 1.0)),
        ("flat", (after <= 0.0) & (before > 0.0)),
    )
    return [
        Event(world.tick, what, world.layout.names[carriers[k]])
        for what, which in happened
        for k in which.nonzero()[0].tolist()
    ]


def _with_chargers(world: World, stands: np.ndarray, charge: np.ndarray) -> np.ndarray:
    """Return which of the carriers have a charger now, bool."""
    x, y, _ = world.pose[world.fixed.carriers].T
    area = world.layout.queue.area
    near = np.abs(y[:, None] - np.array(world.layout.charging_lines)).min(axis=1) < BESIDE
    inside = near & (x >= area.west) & (x <= area.east)
    has: np.ndarray = world.plugged[world.fixed.carriers] & inside
    waiting = (inside & stands & ~has & (charge < TOP_UP)).nonzero()[0]
    free = max(0, world.layout.scenario.chargers - int(has.sum()))
    has[waiting[np.argsort(-x[waiting], kind="stable")[:free]]] = True
    return has
