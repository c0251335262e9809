"""The random draws of a harvest: as many as robots have used, and as many again.

Each draw belongs to the seed, the robot and its number, so more of them change none.
"""

from collections.abc import Sequence

import numpy as np

from orchard.event_model import columns as c
from orchard.event_model.bystanders import Bystanders
from orchard.field.layout import Layout
from orchard.field.picking import failure
from orchard.field.scenario import Scenario

# Of each kind for each robot, at first.
FIRST = 8


def draws(
    layout: Layout, names: Sequence[str], count: int, failure_seed: int | None
) -> dict[str, np.ndarray]:
    """Return arrays of a model with so many draws for each robot; none of what does not happen.

    `failure_seed`: that of failures; None: no robot fails.
    """
    bystanders = Bystanders(layout)
    return {
        "failures": _failures(failure_seed, names, count),
        "encounters": _encounters(bystanders, names, count),
        "looks": _looks(bystanders, names, count),
    }


def has_failures(scenario: Scenario) -> bool:
    """Whether robots of any kind may fail."""
    return bool(scenario.picking.failure.mean_between or scenario.carrying.failure.mean_between)


def _failures(seed: int | None, names: Sequence[str], count: int) -> np.ndarray:
    """Return the failures of robots, as shares of the mean times, (r, count)."""
    if seed is None:
        count = 0
    failures = np.zeros((len(names), count), c.FAILURE).view(np.recarray)
    for robot, name in enumerate(names):
        for number in range(count):
            assert seed is not None
            failures[robot, number] = failure(seed, name, number, 1.0, 1.0)
    return failures


def _encounters(bystanders: Bystanders, names: Sequence[str], count: int) -> np.ndarray:
    """Return whom robots meet on their ways, (r, count)."""
    if not bystanders.density:
        count = 0
    encounters = np.zeros((len(names), count), c.ENCOUNTER).view(np.recarray)
    for robot, name in enumerate(names):
        for number in range(count):
            metres = bystanders.metres_to(name, number)
            encounters[robot, number] = (metres, bystanders.meeting_ticks(name, number))
    return encounters


def _looks(bystanders: Bystanders, names: Sequence[str], count: int) -> np.ndarray:
    """Return how long robots stand before their turns, (r, count). Turns count from 1."""
    if not bystanders.density:
        count = 0
    looks = np.zeros((len(names), count), c.LOOK).view(np.recarray)
    for robot, name in enumerate(names):
        for number in range(count):
            without, towing = (
                bystanders.turning_ticks(name, number + 1, is_towing) for is_towing in (False, True)
            )
            looks[robot, number] = (without, towing)
    return looks
