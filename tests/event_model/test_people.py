"""Robots that stop for people and animals."""

from orchard.event_model.draws import FIRST
from orchard.event_model.harvest import EventHarvest
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario


def test_more_is_drawn_when_a_robot_has_used_all() -> None:
    """FIRST meetings are drawn for each robot. Here one robot needs more."""
    layout = lay_out(Scenario(rows=8, pickers=2, carriers=2, dispatch="predictive"))
    robots = EventHarvest(layout).run().model.robots
    assert robots.turns.max() > FIRST["looks"]
    assert robots.meetings.max() > 0
