"""Roads on which no robot is in another's way, in both event models."""

import pytest

pytest.importorskip("simpy", reason="the extra `study` is not installed")

from both_models import differences
from quiet import quiet_layouts

from orchard.event_model.harvest import EventHarvest

LAYOUTS = list(quiet_layouts(seed=31, count=30))


def test_free_roads_have_the_same_ticks_in_both_models() -> None:
    differ = [layout.scenario for layout in LAYOUTS if differences(layout, free_roads=True)]
    assert not differ


def test_no_robot_waits_for_places_on_free_roads() -> None:
    harvest = EventHarvest(LAYOUTS[0], free_roads=True).run()
    assert len(set(harvest.model.robots.roads)) == len(harvest.names)
    assert not harvest.model.robots.wish.any()
