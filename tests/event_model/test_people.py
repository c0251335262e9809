"""Robots that stop for people and animals, in both event models."""

from random import Random
from typing import Any

import pytest

pytest.importorskip("simpy", reason="the extra `study` is not installed")

from both_models import differences
from quiet import random_layouts

from orchard.event_model.draws import FIRST
from orchard.event_model.harvest import EventHarvest
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario

# As in quiet orchards: robots that act in one tick take turns by name here, and by chance in the
# model of generators.
MOST_DIFFER = 5


def with_people(chances: Random) -> dict[str, Any]:
    """Return values of a scenario in which people and animals are about."""
    return {
        "people": {"workers": chances.randint(0, 4), "visitors": chances.randint(0, 4)},
        "animals": {"dogs": chances.randint(0, 2), "cats": chances.randint(0, 2)},
    }


def test_harvests_with_people_have_the_same_ticks_in_both_models() -> None:
    layouts = random_layouts(seed=51, count=40, values_of=with_people)
    differ = [layout.scenario for layout in layouts if differences(layout)]
    assert len(differ) <= MOST_DIFFER


def test_more_is_drawn_when_a_robot_has_used_all() -> None:
    layout = lay_out(Scenario(rows=8, pickers=2, carriers=2, dispatch="predictive"))
    robots = EventHarvest(layout).run().model.robots
    assert robots.turns.max() > FIRST
    assert robots.meetings.max() > 0
