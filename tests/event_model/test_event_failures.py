"""Robots that fail, in both event models."""

from random import Random
from typing import Any

import pytest

pytest.importorskip("simpy", reason="the extra `study` is not installed")

from both_models import differences
from quiet import NOBODY, random_layouts

from orchard.event_model.harvest import EventHarvest
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.plans.failures import LONGEST_WAIT


def failing(chances: Random) -> dict[str, Any]:
    """Return values of a scenario in which robots of one kind fail, or of both."""
    kinds = chances.choice([["picking"], ["carrying"], ["picking", "carrying"]])
    return {kind: {"failure": failure(chances)} for kind in kinds}


def failure(chances: Random) -> dict[str, float]:
    """Return how robots of a kind fail, some before they have driven for a minute."""
    return {
        "mean_between": chances.choice([60.0, 200.0, 900.0]),
        "mean_repair": chances.choice([20.0, 120.0, 2.0 * LONGEST_WAIT]),
    }


# Harvests in which one event model differs from the other: two robots act in one tick, and their
# order is that of their names here and of chance in the model of generators.
MOST_DIFFER = 3


def test_failures_have_the_same_ticks_in_both_models() -> None:
    layouts = random_layouts(seed=21, count=40, values_of=failing)
    differ = [layout.scenario for layout in layouts if differences(layout)]
    assert len(differ) <= MOST_DIFFER


def test_a_repair_of_an_hour_is_no_jam() -> None:
    values = NOBODY | {"rows": 3, "pickers": 2, "carriers": 1, "row_length": 30.0}
    hour = {"failure": {"mean_between": 100.0, "mean_repair": 3600.0}}
    layout = lay_out(Scenario(**values, dispatch="predictive", carrying=hour))
    assert EventHarvest(layout).run().is_over
    assert not differences(layout)


def test_more_failures_are_drawn_when_a_robot_has_had_all() -> None:
    values = NOBODY | {"rows": 8, "pickers": 2, "carriers": 1, "row_length": 90.0}
    often = {"failure": {"mean_between": 60.0, "mean_repair": 5.0}}
    layout = lay_out(Scenario(**values, dispatch="nearest", carrying=often, picking=often))
    harvest = EventHarvest(layout)
    before = harvest.model.failures.shape
    harvest.run()
    assert harvest.model.robots.failures.max() > before[1]
    assert not differences(layout)
