"""The discrete-event model beside the simulator: the same harvests take the same time."""

from typing import Any

import pytest

pytest.importorskip("simpy", reason="the extra `study` is not installed")

from orchard.discrete.harvest import DiscreteHarvest
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.local import Local

NOBODY: dict[str, Any] = {"people": {"workers": 0, "visitors": 0}, "animals": {"dogs": 0, "cats": 0}, "weeds": 0, "tractor": False}
VARIED = {"spread": {"distribution": "gamma", "cv": 0.3}, "failure": {"mean_between": 300.0, "mean_repair": 60.0}}


def orchard(**values: Any) -> Scenario:
    return Scenario(**NOBODY | values)


def simulated(scenario: Scenario) -> float:
    """The length of a harvest in the simulator, s."""
    run = Local(scenario)
    while not run.engine.over:
        run.tick()
    return run.engine.world.seconds


@pytest.mark.parametrize(
    "values",
    [
        {"rows": 4, "pickers": 2, "carriers": 1},
        {"rows": 5, "pickers": 3, "carriers": 2, "dispatch": "farthest-first", "rows_to_pickers": "manual"},
        {"rows": 6, "pickers": 6, "carriers": 3, "dispatch": "predictive", "route": "two-way", "rows_to_pickers": "balanced-ends"},
        {"rows": 4, "pickers": 2, "carriers": 2, "row_length": 40.0, "picking_speed": 0.5, "picking": VARIED, "seed": 3},
    ],
    ids=["nearest", "farthest-first", "predictive, two-way", "picking that varies"],
)
def test_a_harvest_takes_as_long_as_in_the_simulator(values: dict[str, Any]) -> None:
    scenario = orchard(**values)
    harvest = DiscreteHarvest(lay_out(scenario)).run()
    assert harvest.delivered == scenario.rows
    assert harvest.seconds == pytest.approx(simulated(scenario), rel=0.01)


MEASURED = {  # rows, pickers, carriers, picking speed -> bins/h in the simulator: nearest, farthest-first, predictive (docs/policies.md)
    (10, 10, 10, 1.0): (61.4, 76.7, 85.1),
    (10, 5, 5, 1.0): (42.0, 45.4, 48.8),
    (10, 5, 2, 0.03): (6.05, 6.12, 6.37),
    (10, 5, 5, 0.03): (6.96, 7.01, 7.26),
    (20, 10, 10, 1.0): (59.5, 68.8, 72.8),
    (20, 5, 5, 1.0): (36.1, 37.3, 38.4),
}


@pytest.mark.soak
def test_the_rates_are_those_that_were_measured_in_the_simulator() -> None:
    errors = []
    for (rows, pickers, carriers, speed), rates in MEASURED.items():
        for policy, rate in zip(("nearest", "farthest-first", "predictive"), rates, strict=True):
            scenario = orchard(rows=rows, pickers=pickers, carriers=carriers, picking_speed=speed, dispatch=policy)
            errors.append(abs(3600 * rows / DiscreteHarvest(lay_out(scenario)).run().seconds / rate - 1.0))
    assert max(errors) <= 0.01
    assert sum(errors) / len(errors) <= 0.005


def test_agents_of_the_users_own_need_the_simulator() -> None:
    with pytest.raises(ValueError, match=r"built-in agents only, and not picker_01; run the simulator"):
        DiscreteHarvest(lay_out(orchard(agents={"picker_01": "tests.own_agents.Eastward"})))
