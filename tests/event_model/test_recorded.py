"""Harvests that were recorded, so that a change of the event model is noticed.

An earlier event model, written as Python generators, had each delivery of them in the same tick. If
you change a rule on purpose, compare the event model with the simulator first, and then record the
harvests anew.
"""

import json
from pathlib import Path
from typing import Any

import pytest

from orchard.event_model.harvest import EventHarvest
from orchard.field.layout import Layout, lay_out
from orchard.field.scenario import Scenario

# Of each harvest: its scenario, the times of its deliveries, its length, and its length on free
# roads, s; and of what kind it is.
RECORDED: list[dict[str, Any]] = json.loads(
    Path(__file__).with_name("recorded_harvests.json").read_text(encoding="utf-8")
)


def layout_of(recorded: dict[str, Any]) -> Layout:
    """Return the layout of a recorded harvest."""
    return lay_out(Scenario.model_validate(recorded["scenario"]))


@pytest.mark.parametrize("number", range(len(RECORDED)))
def test_a_harvest_is_as_it_was_recorded(number: int) -> None:
    recorded = RECORDED[number]
    harvest = EventHarvest(layout_of(recorded)).run()
    assert [round(seconds, 1) for seconds in harvest.deliveries] == recorded["deliveries"]
    assert harvest.seconds == pytest.approx(recorded["seconds"], abs=0.01)


@pytest.mark.parametrize("number", range(len(RECORDED)))
def test_a_harvest_on_free_roads_is_as_it_was_recorded(number: int) -> None:
    recorded = RECORDED[number]
    harvest = EventHarvest(layout_of(recorded), free_roads=True).run()
    assert harvest.seconds == pytest.approx(recorded["on_free_roads"], abs=0.01)


def test_own_routes_and_policies_are_among_what_was_recorded() -> None:
    kinds = {recorded["of"] for recorded in RECORDED}
    assert kinds == {"quiet", "people", "failures", "batteries", "policies", "routes", "all"}
