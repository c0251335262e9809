"""The fastest machines of a scenario: their bins follow them, and hold none."""

import pytest
from quiet import NOBODY

from orchard.field.scenario import Scenario
from orchard.local import Local

FASTEST_TURN = 60.0  # degrees/s


@pytest.mark.parametrize("route", ["one-way", "two-way"])
def test_no_bin_holds_a_robot_at_the_fastest_values(route: str) -> None:
    """A bin learns a tick late that its robot turns, and has then driven on for 0.25 m, at 2.5 m/s.

    If it were then too far from its place, the robot would be refused a step.
    """
    orchard = {"rows": 4, "row_length": 30.0, "pickers": 2, "carriers": 2, "route": route}
    picking = {"driving_speed": 2.5, "turning": FASTEST_TURN}
    carrying = {"speed": 2.5, "turning": FASTEST_TURN}
    values = NOBODY | orchard | {"picking": picking, "carrying": carrying, "picking_speed": 1.0}
    run = Local(Scenario.model_validate(values), is_hashed=False)
    while not run.ended:
        run.tick()
    assert run.ended == "harvested"
    assert not run.engine.world.refused.any()
