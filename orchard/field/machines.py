"""What the machines of a scenario can: the one place from which robots, physics, the event model,
bounds and the proof of the optimum take it.
"""

from dataclasses import dataclass
from math import ceil

from orchard.field.kinds import KINDS
from orchard.field.scenario import TIME_STEP, Scenario

# Ticks of rounding.
_ROUNDING = 1e-6


@dataclass(frozen=True)
class Machine:
    """What the machines of a kind can, and how long they handle bins."""

    #: m/s, at most, and as it drives.
    speed: float
    #: Ticks at rest in the bay until a bin is empty.
    unloading_ticks: int


def machine_of(scenario: Scenario, kind: str) -> Machine:
    """Return what machines of a kind can in a scenario."""
    speed = KINDS[kind].speed
    if kind == "carrier":
        speed = scenario.carrying.speed
    elif kind == "picker":
        speed = scenario.picking.driving_speed
    return Machine(speed=speed, unloading_ticks=_ticks(scenario.handling.unloading))


def _ticks(seconds: float) -> int:
    """Return the whole ticks that a time takes."""
    return ceil(seconds / TIME_STEP - _ROUNDING)
