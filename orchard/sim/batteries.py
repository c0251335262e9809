"""The batteries of carriers: each is used with time, and charged at a charger.

`orchard.sim.physics` calls `without_flat` before a step, and `advance` after it. A carrier that is
away at the load-out uses what the way there and back takes. The charging lines are the last lines
of the queue. A charger reaches each place of them. It goes to the carrier that stands nearest to
the head of its line, and stays with it until the battery is full: then the carrier is no longer
"plugged". A carrier that stands in the queue or in a charging line is off: it uses nothing. A
carrier with a flat battery stands still.

All arrays have one entry for each carrier, in their order in the layout. Charge goes from 0 (flat)
to 1 (full).
"""

import numpy as np

from orchard.contract.events import Event, What
from orchard.contract.messages import Deed
from orchard.field.machines import haul_charge
from orchard.field.queue import BESIDE
from orchard.field.scenario import TIME_STEP
from orchard.sim import hauls
from orchard.sim.world import World

HOUR = 3600.0  # s
# Charge below which a carrier that waits in a charging line is given a charger. A fuller one that
# stands there needs none yet. Chosen: otherwise a carrier that is nearly full keeps an empty one
# off the charger.
TOP_UP = 0.95
# Events after which a carrier may act otherwise, so that its agent must be asked.
NEWS: tuple[What, ...] = ("charging", "charged", "flat")


def without_flat(
    world: World, twists: np.ndarray, deeds: list[tuple[int, Deed]]
) -> tuple[np.ndarray, list[tuple[int, Deed]]]:
    """Return velocities (n, 3) and deeds in which bodies with a flat battery stand and do nothing.

    `deeds`: (body index, deed). Of bodies without a battery the charge is always 1.
    """
    is_flat = world.charge <= 0.0
    if not is_flat.any():
        return twists, deeds
    allowed = [(body, deed) for body, deed in deeds if not is_flat[body]]
    return np.where(is_flat[:, None], 0.0, twists), allowed


def advance(world: World) -> list[Event]:
    """Use and charge the batteries for one tick, after all bodies have moved. Return the events."""
    carriers = world.fixed.carriers
    before = world.charge[carriers]
    was_plugged = world.plugged[carriers]
    stands = ~world.twist[carriers].any(axis=1)
    is_plugged = _have_chargers(world, stands, before)
    # A plugged carrier that moves up its line keeps its charger, but is charged only where it
    # stands.
    change = np.where(is_plugged & stands, _gain(world), -_use(world, stands))
    after = np.clip(before + change, 0.0, 1.0)
    is_full = is_plugged & (after >= 1.0)
    world.charge[carriers] = after
    world.plugged[carriers] = is_plugged & ~is_full
    return [
        *_events(world, "charging", is_plugged & ~was_plugged),
        *_events(world, "charged", is_full),
        *_events(world, "flat", (after <= 0.0) & (before > 0.0)),
    ]


def _gain(world: World) -> float:
    """Return the charge that a charger gives in a tick."""
    battery = world.scenario.carrying.battery
    return TIME_STEP / HOUR / battery.hours_to_charge


def _use(world: World, stands: np.ndarray) -> np.ndarray:
    """Return the charge that each carrier uses in a tick, (c,)."""
    battery = world.scenario.carrying.battery
    x, y, _ = world.pose[world.fixed.carriers].T
    area = world.layout.queue.area
    is_in_queue = (x >= area.west) & (x <= area.east) & (y >= area.south) & (y <= area.north)
    # The share of the power of driving that each carrier uses.
    share = np.where(stands, battery.standing, 1.0)
    share[stands & is_in_queue] = 0.0
    # A battery without hours is endless.
    hours = battery.hours or np.inf
    used: np.ndarray = share * (TIME_STEP / HOUR / hours)
    carrier = world.layout.machines["carrier"]
    if carrier.haul_ticks:
        # The way to the load-out and back takes the same from the battery in each of its ticks.
        away = hauls.are_away(world)[world.fixed.carriers]
        used[away] += haul_charge(world.scenario, carrier) / carrier.haul_ticks
    return used


def _events(world: World, what: What, has_happened: np.ndarray) -> list[Event]:
    """Return an event for each carrier to which it has happened. `has_happened`: (c,) bool."""
    carriers = world.fixed.carriers[has_happened]
    return [Event(world.tick, what, name) for name in world.layout.names_at(carriers.tolist())]


def _have_chargers(world: World, stands: np.ndarray, charge: np.ndarray) -> np.ndarray:
    """Return which carriers have a charger now, (c,) bool. `stands`: (c,) bool; `charge`: (c,).

    Those that had one keep it while they are in a charging line; the free ones are given away.
    """
    x, y, _ = world.pose[world.fixed.carriers].T
    area = world.layout.queue.area
    lines = np.array(world.layout.charging_lines)
    # (carriers, lines) m: how far each carrier is beside each line.
    off_line = np.abs(y[:, None] - lines)
    is_in_line = off_line.min(axis=1) < BESIDE
    is_inside = is_in_line & (x >= area.west) & (x <= area.east)
    is_plugged: np.ndarray = world.plugged[world.fixed.carriers] & is_inside
    is_waiting = is_inside & stands & ~is_plugged & (charge < TOP_UP)
    is_waiting &= world.hauling[world.fixed.carriers] == 0
    waiting = is_waiting.nonzero()[0]
    # The head of a line is its east end.
    nearest_first = waiting[np.argsort(-x[waiting], kind="stable")]
    free_chargers = max(0, world.scenario.chargers - int(is_plugged.sum()))
    is_plugged[nearest_first[:free_chargers]] = True
    return is_plugged
