"""Harvests that were recorded, so that a change of the event model is noticed.

They are those in which an earlier model of other code, of generators, had each delivery in the same
tick. They were recorded anew when carriers began to tell with a claim what they give back in its
tick. Who changes a rule on purpose does so too, and compares with the simulator first.
"""

import json
from pathlib import Path
from typing import Any

import pytest

from orchard.event_model.harvest import EventHarvest
from orchard.field.layout import Layout, lay_out
from orchard.field.scenario import Scenario

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
