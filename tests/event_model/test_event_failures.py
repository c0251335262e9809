"""Robots that fail."""

from quiet import NOBODY

from orchard.event_model.harvest import EventHarvest
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario


def test_a_repair_of_an_hour_is_no_jam() -> None:
    """It is longer than the ten minutes in which a jam is one."""
    values = NOBODY | {"rows": 3, "pickers": 2, "carriers": 1, "row_length": 30.0}
    hour = {"failure": {"mean_between": 100.0, "mean_repair": 3600.0}}
    layout = lay_out(Scenario(**values, dispatch="predictive", carrying=hour))
    assert EventHarvest(layout).run().is_over


def test_more_failures_are_drawn_when_a_robot_has_had_all() -> None:
    """`robots.failures`: how many each robot has had."""
    values = NOBODY | {"rows": 8, "pickers": 2, "carriers": 1, "row_length": 90.0}
    often = {"failure": {"mean_between": 60.0, "mean_repair": 5.0}}
    layout = lay_out(Scenario(**values, dispatch="nearest", carrying=often, picking=often))
    harvest = EventHarvest(layout)
    _, drawn_at_first = harvest.model.failures.shape
    harvest.run()
    assert harvest.model.robots.failures.max() > drawn_at_first
