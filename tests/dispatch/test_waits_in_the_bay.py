"""What it costs that the policy `rolling` foresees no waits for trailers and the truck.

Without a trailer, or without an empty bin that a truck brings, a carrier waits in the bay with its
full bin. `rolling` looks ahead, but not at these waits.
"""

from random import Random
from statistics import fmean
from typing import Any

import pytest
from quiet import NOBODY

from orchard.discrete.harvest import DiscreteHarvest
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario

# How many random harvests are compared.
HARVESTS = 150


def at_the_bay(chances: Random) -> dict[str, Any]:
    """Return values of a bay that often takes bins too slowly for the harvest."""
    bins = chances.randint(1, 4)
    if chances.random() < 0.5:
        truck = {"every": float(chances.randint(100, 600)), "bins": bins}
        return {"empty_bins": bins + chances.randint(0, 3), "truck": truck}
    trailers = {"count": chances.randint(1, 3), "bins": bins}
    return {"seconds_away": float(chances.randint(50, 500)), "trailers": trailers}


def harvests(count: int) -> list[dict[str, Any]]:
    """Return the values of random harvests of fast pickers, in which decisions matter."""
    chances = Random("waits in the bay")
    drawn = []
    for _ in range(count):
        values = {
            "rows": chances.randint(10, 20),
            "pickers": chances.randint(4, 10),
            "carriers": chances.randint(1, 10),
            "row_length": float(chances.randint(30, 80)),
            "picking_speed": chances.choice([1.0, 0.6, 0.4]),
            "route": chances.choice(["one-way", "two-way"]),
        }
        drawn.append(NOBODY | values | {"load_out": at_the_bay(chances)})
    return drawn


def seconds(values: dict[str, Any], dispatch: str) -> float:
    """Return how long a harvest with a policy takes, s."""
    layout = lay_out(Scenario.model_validate(values | {"dispatch": dispatch}))
    harvest = DiscreteHarvest(layout).run()
    assert harvest.is_over
    return harvest.seconds


@pytest.mark.soak
def test_soak_rolling_is_no_worse_where_carriers_wait() -> None:
    """`rolling` foresees no waits for trailers and the truck.

    On average that costs nothing against `predictive`, which foresees none either.
    """
    # By how many per cent a harvest takes longer with `rolling`.
    more = []
    for values in harvests(HARVESTS):
        predictive = seconds(values, "predictive")
        more.append(100.0 * (seconds(values, "rolling") / predictive - 1.0))
    print(f"\nrolling, beside predictive: {fmean(more):+.2f} % on average", end=", ")
    print(f"{min(more):+.2f} to {max(more):+.2f} %; {sum(each > 0.5 for each in more)} above 0.5 %")
    assert fmean(more) < 0.0
