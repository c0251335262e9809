"""Machines that are set in the scenario: what they can holds in the simulator and in the event
model alike.
"""

from statistics import fmean
from typing import Any

import pytest
from drawn_machines import drawn_machines
from quiet import NOBODY

from orchard.discrete.harvest import DiscreteHarvest
from orchard.field.kinds import HAULERS, kind_of
from orchard.field.layout import Layout, lay_out
from orchard.field.scenario import Scenario
from orchard.local import Local
from orchard.report.bounds import Bounds

SMALL: dict[str, Any] = NOBODY | {
    "rows": 4,
    "pickers": 2,
    "carriers": 2,
    "row_length": 24.0,
    "dispatch": "nearest",
}


def small(**machines: Any) -> Layout:
    return lay_out(Scenario.model_validate(SMALL | machines))


def simulated(layout: Layout) -> float:
    """Return how long a harvest takes in the simulator, s. No robot collides, and none jams."""
    run = Local(layout.scenario, is_hashed=False)
    while not run.ended:
        run.tick()
    assert run.ended == "harvested", run.jam
    world = run.engine.world
    collided = zip(layout.names, world.collisions.tolist(), strict=True)
    assert not [name for name, count in collided if count and kind_of(name) in HAULERS]
    return world.seconds


def modelled(layout: Layout) -> float:
    """Return how long it takes in the event model, s."""
    return DiscreteHarvest(layout).run().seconds


def errors(seed: int, count: int) -> list[float]:
    """Return by which share the event model is longer or shorter, of so many drawn harvests."""
    shares = []
    for layout in drawn_machines(seed, count):
        seconds = simulated(layout)
        shares.append(abs(modelled(layout) / seconds - 1.0))
    return shares


def test_both_models_agree_about_any_machines() -> None:
    assert fmean(errors(1, 6)) <= 0.005


@pytest.mark.soak
def test_soak_both_models_agree_about_a_hundred_machines() -> None:
    shares = sorted(errors(2, 100))
    assert fmean(shares) <= 0.005
    assert shares[94] <= 0.01


def test_a_bay_that_takes_longer_brings_fewer_bins() -> None:
    fast = small()
    slow = small(handling={"unloading": 120.0})
    assert simulated(slow) > simulated(fast) + 200.0
    assert modelled(slow) == pytest.approx(simulated(slow), rel=0.005)
    assert Bounds(slow).bay_seconds == pytest.approx(Bounds(fast).bay_seconds + 115.0, abs=0.5)
