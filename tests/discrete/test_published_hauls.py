"""What shipped scenarios with trailers bring, as a table of docs/how-to.md tells it.

Each line of the table is a test: its first cells name the scenario, its last ones the limit and the
rate, bins an hour.
"""

from pathlib import Path
from statistics import fmean
from typing import Any

import pytest

from orchard.discrete.harvest import DiscreteHarvest
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.field.shipped import shipped
from orchard.report.bounds import Bounds

HOW_TO = Path(__file__).parents[2] / "docs" / "how-to.md"
HEAD = (
    "| scenario | bins/h of a picker | carriers | trailers | bins of each | away, s | limit |"
    " bins/h |"
)
NOBODY: dict[str, Any] = {
    "people": {"workers": 0, "visitors": 0},
    "animals": {"dogs": 0, "cats": 0},
    "tractor": False,
    "dispatch": "predictive",
}
# Harvests of which the table has the mean: with seeds 1 and 2.
SEEDS = 2


def lines_of_table() -> list[list[str]]:
    """Return the cells of each line of the table below its head."""
    _, _, below = HOW_TO.read_text().partition(f"{HEAD}\n")
    table, _, _ = below.partition("\n\n")
    lines = table.splitlines()[1:]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def harvest_of(line: list[str]) -> dict[str, Any]:
    """Return the scenario that a line of the table names, with the values of its cells."""
    name, picking_rate, carriers, count, bins, seconds_away, *_ = line
    load_out: dict[str, Any] = {}
    if count != "endless":
        trailers = {"count": int(count), "bins": int(bins)}
        load_out = {"trailers": trailers, "seconds_away": float(seconds_away)}
    values = {
        "picking_rate": float(picking_rate),
        "carriers": int(carriers),
        "load_out": load_out,
    }
    return shipped()[name.strip("`")].model_dump() | NOBODY | values


def rate(values: dict[str, Any]) -> float:
    """Return the bins an hour in the middle of harvests, as the mean over some seeds.

    The first and the last fifth of the bins are left out: then some pickers begin or are done.
    """
    rates = []
    for seed in range(1, SEEDS + 1):
        scenario = Scenario.model_validate(values | {"seed": seed})
        harvest = DiscreteHarvest(lay_out(scenario)).run()
        assert harvest.is_over
        deliveries = harvest.deliveries
        first = len(deliveries) // 5
        last = 4 * first
        rates.append(3600.0 * (last - first) / (deliveries[last] - deliveries[first]))
    return fmean(rates)


def test_the_table_of_hauls_has_two_shipped_scenarios() -> None:
    """If the table was not found, the tests below would have no lines to test."""
    assert {line[0] for line in lines_of_table()} == {"`tractor_trailers`", "`forklift`"}


@pytest.mark.parametrize("line", lines_of_table(), ids=" ".join)
def test_hauls_have_the_limits_that_are_told(line: list[str]) -> None:
    """No harvest brings more in the long run than the limit in the table."""
    bounds = Bounds(lay_out(Scenario.model_validate(harvest_of(line))))
    limit = bounds.bins_per_hour
    assert f"{limit:.1f}" == line[-2]
    assert float(line[-1]) <= limit


@pytest.mark.soak
@pytest.mark.parametrize("line", lines_of_table(), ids=" ".join)
def test_soak_hauls_bring_what_is_told(line: list[str]) -> None:
    """Each line of the table in docs/how-to.md, measured again."""
    assert f"{rate(harvest_of(line)):.1f}" == line[-1]
