"""Whole harvests with batteries in both models: bins are delivered in nearly the same ticks.

A carrier that gets flat stands in both, wherever it is, and then neither harvest is complete.
"""

from collections.abc import Iterator
from random import Random
from typing import Any

import pytest
from quiet import NOBODY

from orchard.event_model.harvest import EventHarvest
from orchard.field.layout import lay_out
from orchard.field.scenario import TICKS_PER_SECOND, Scenario
from orchard.local import Local

# Ticks by which each delivery may differ.
NEAR = 5
HARVESTS_OF_SOAK = 100
# In so many of these each delivery is that near. In the others carriers meet where the model's do
# not look: docs/bounds.md.
NEAR_OF_SOAK = 80
# In the soak the lengths of harvests differ by less than MEAN_SHARE on average, and 95 % of them by
# less than SHARE.
MEAN_SHARE = 0.005
SHARE = 0.01
# A carrier gets flat on its way to the bay, and the other one stands behind it.
FLAT: dict[str, Any] = {
    "rows": 4,
    "pickers": 2,
    "carriers": 2,
    "row_length": 24.0,
    "picking_speed": 0.5,
    "chargers": 2,
    "route": "one-way",
    "dispatch": "predictive",
    "carrying": {
        "battery": {"hours": 0.1, "hours_to_charge": 0.05, "reserve": 0.5, "standing": 0.3}
    },
}


def charging_cells(seed: int, count: int, most_rows: int = 6) -> Iterator[dict[str, Any]]:
    """Yield so many small random orchards in which carriers charge."""
    chances = Random(seed)
    for _ in range(count):
        battery = {
            "hours": chances.choice([0.1, 0.2]),
            "hours_to_charge": chances.choice([0.02, 0.05]),
            "reserve": chances.choice([0.5, 0.8]),
            "standing": 0.3,
        }
        yield {
            "rows": chances.randint(3, most_rows),
            "pickers": chances.randint(2, 3),
            "carriers": chances.randint(1, 4),
            "row_length": 24.0,
            "picking_speed": chances.choice([1.0, 0.5]),
            "chargers": chances.randint(1, 3),
            "route": chances.choice(["one-way", "two-way"]),
            "dispatch": chances.choice(["nearest", "predictive", "farthest-first"]),
            "carrying": {"battery": battery},
        }


class BothModels:
    """A harvest in the simulator and in the event model."""

    def __init__(self, values: dict[str, Any]) -> None:
        scenario = Scenario.model_validate(NOBODY | values)
        run = Local(scenario, is_hashed=False)
        self.delivered: list[int] = []
        while not run.ended:
            before = run.engine.world.delivered
            run.tick()
            self.delivered += [run.engine.tick] * (run.engine.world.delivered - before)
        self.ended = run.ended
        self.ticks = run.engine.tick
        self.model = EventHarvest(lay_out(scenario)).run()

    @property
    def apart(self) -> float:
        """The most ticks between a delivery in one model and that of the same number in the other.

        If one model delivers fewer bins, it is the length of the harvest.
        """
        modelled = [round(TICKS_PER_SECOND * seconds) for seconds in self.model.deliveries]
        if len(modelled) != len(self.delivered):
            return float(self.ticks)
        return max((abs(a - b) for a, b in zip(modelled, self.delivered, strict=True)), default=0)

    @property
    def share_apart(self) -> float:
        """By which share of its length the harvest is longer or shorter in the event model."""
        return abs(TICKS_PER_SECOND * self.model.seconds - self.ticks) / self.ticks

    @property
    def end_alike(self) -> bool:
        """Whether both are complete, or neither is."""
        return self.model.is_over == (self.ended == "harvested")


@pytest.mark.parametrize("values", [*charging_cells(seed=5, count=3, most_rows=4)])
def test_carriers_that_charge_deliver_as_the_simulators(values: dict[str, Any]) -> None:
    both = BothModels(values)
    assert both.end_alike
    assert both.apart <= NEAR


def test_a_carrier_that_gets_flat_on_its_way_stands_there() -> None:
    """It does so in both models, and the harvest is not complete."""
    both = BothModels(FLAT)
    assert both.ended == "jammed"
    assert both.model.flat == ["carrier_01"]
    assert both.apart <= NEAR


@pytest.mark.soak
def test_soak_carriers_that_charge_deliver_as_the_simulators() -> None:
    near = 0
    shares = []
    for number, values in enumerate(charging_cells(seed=6, count=HARVESTS_OF_SOAK)):
        both = BothModels(values)
        assert both.end_alike, values
        near += both.apart <= NEAR
        if both.ended == "harvested":
            shares.append(both.share_apart)
        print(number, both.ended, f"{both.apart} ticks apart, {near} near so far")
    assert near >= NEAR_OF_SOAK
    assert sum(shares) / len(shares) <= MEAN_SHARE
    assert sum(share <= SHARE for share in shares) >= 0.95 * len(shares)
