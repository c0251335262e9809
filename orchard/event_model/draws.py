"""The random draws of a harvest: when robots fail, whom they meet, how long they look before turns.

They are drawn in advance, FIRST of each kind for each robot, and twice as many of a kind when a
robot has used all of its own. Each draw belongs to the seed, the robot and its number, so more of
them change none. They are kept: fleets that are compared have the same seeds.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from types import MappingProxyType
from typing import Any

import numpy as np

from orchard.event_model import columns
from orchard.event_model.bystanders import Bystanders
from orchard.field.layout import Layout
from orchard.field.picking import failure
from orchard.field.scenario import Scenario

# Draws of each kind for each robot, at first.
FIRST = MappingProxyType({"failures": 8, "encounters": 8, "looks": 8})
NO_DRAWS = MappingProxyType(dict.fromkeys(FIRST, 0))
# Of each kind the column of a robot that tells how many it has used.
USED = MappingProxyType({"failures": "failures", "encounters": "meetings", "looks": "turns"})
# The machine wants so many draws of each robot that are not used yet.
RESERVE = 1
# Draws of one robot that are made together, at first.
PART = 8
# Parts of the draws of robots that are kept: those of some hundred robots and seeds.
KEPT = 4096


def draws(
    layout: Layout, names: Sequence[str], counts: Mapping[str, int], failure_seed: int | None
) -> dict[str, np.ndarray]:
    """Return arrays of a model with draws for each robot; none of what does not happen.

    `counts`: of each array how many of each robot. `failure_seed`: that of failures; None: no robot
    fails.
    """
    bystanders = Bystanders.of(layout)
    if not bystanders.density:
        counts = {**counts, "encounters": 0, "looks": 0}
    if failure_seed is None:
        counts = {**counts, "failures": 0}
    return {
        "failures": _table(_failures, failure_seed, names, counts["failures"], columns.FAILURE),
        "encounters": _table(
            _encounters, bystanders, names, counts["encounters"], columns.ENCOUNTER
        ),
        "looks": _table(_looks, bystanders, names, counts["looks"], columns.LOOK),
    }


def more_draws(counts: Mapping[str, int], robots: np.recarray) -> dict[str, int]:
    """Return how many draws of each robot are needed: twice as many of what one has used up."""
    more = dict(counts)
    for name, used in USED.items():
        if robots[used].max() + RESERVE >= counts[name]:
            more[name] *= 2
    return more


def has_failures(scenario: Scenario) -> bool:
    """Whether robots of any kind may fail."""
    return bool(scenario.picking.failure.mean_between or scenario.carrying.failure.mean_between)


def _table(
    drawn: Callable[..., np.ndarray],
    source: Any,
    names: Sequence[str],
    count: int,
    columns: np.dtype[Any],
) -> np.ndarray:
    """Return the draws of all robots, (r, count).

    `drawn`: returns those of a robot from one number up to another one. `source`: on what they
    depend beside that.
    """
    table = np.zeros((len(names), count), columns).view(np.recarray)
    for robot, name in enumerate(names):
        # In parts that double, so that those of a harvest with more draws are found in the cache.
        first = 0
        while first < count:
            last = min(count, max(PART, 2 * first))
            table[robot, first:last] = drawn(source, name, first, last)
            first = last
    return table


@lru_cache(maxsize=KEPT)
def _failures(seed: int, name: str, first: int, last: int) -> np.ndarray:
    """Return failures of a robot, as shares of the mean times."""
    failures = [failure(seed, name, number, 1.0, 1.0) for number in range(first, last)]
    return np.array(failures, columns.FAILURE)


@lru_cache(maxsize=KEPT)
def _encounters(bystanders: Bystanders, name: str, first: int, last: int) -> np.ndarray:
    """Return whom a robot meets on its ways."""
    encounters = []
    for number in range(first, last):
        metres = bystanders.metres_to(name, number)
        encounters.append((metres, bystanders.meeting_ticks(name, number)))
    return np.array(encounters, columns.ENCOUNTER)


@lru_cache(maxsize=KEPT)
def _looks(bystanders: Bystanders, name: str, first: int, last: int) -> np.ndarray:
    """Return how long a robot stands before its turns. Turns count from 1."""
    looks = bystanders.turning_ticks(name, first + 1, last + 1)
    return np.array(looks, columns.LOOK)
