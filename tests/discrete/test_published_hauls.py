"""What is published of the transport of bins, asked with trailers that carry several."""

from statistics import fmean
from typing import Any

import pytest

from orchard.discrete.harvest import DiscreteHarvest
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.field.shipped import shipped

NOBODY: dict[str, Any] = {
    "people": {"workers": 0, "visitors": 0},
    "animals": {"dogs": 0, "cats": 0},
    "tractor": False,
    "dispatch": "predictive",
}
SEEDS = 2


def rate(name: str, **values: Any) -> float:
    """Return the bins an hour of the middle of harvests of a shipped scenario with other values,
    the mean of some seeds.
    """
    rates = []
    for seed in range(1, SEEDS + 1):
        scenario = shipped()[name].model_dump() | NOBODY | values | {"seed": seed}
        harvest = DiscreteHarvest(lay_out(Scenario.model_validate(scenario))).run()
        assert harvest.is_over
        deliveries = harvest.deliveries
        first = len(deliveries) // 5
        last = 4 * first
        rates.append(3600.0 * (last - first) / (deliveries[last] - deliveries[first]))
    return fmean(rates)


def trailers(count: int, bins: int, seconds_away: float) -> dict[str, Any]:
    return {"trailers": {"count": count, "bins": bins}, "seconds_away": seconds_away}


@pytest.mark.soak
def test_soak_published_hauls_are_told() -> None:
    """The figures of docs/how-to.md."""
    gangs = {}
    for count in (1, 2, 3, 4):
        gangs[count] = rate("tractor_trailers", load_out=trailers(count, 3, 600.0))
    many = {"carriers": 6, "picking_rate": 2.2}
    fork = rate("forklift", **many, load_out=trailers(1, 4, 906.0))
    straddle = rate("forklift", **many, load_out=trailers(1, 8, 771.0))
    alone = {}
    for carriers in (2, 3, 4, 6):
        endless = {"load_out": {}, "carriers": carriers}
        alone[carriers] = rate("tractor_trailers", **endless)
    print(f"\ngangs, trailers: {gangs}\nforklift {fork}, straddle {straddle}, bins/h")
    print(f"carriers alone: {alone}")
    assert gangs[1] < gangs[2] < gangs[4]
    assert straddle > 1.5 * fork
