"""The behaviour of pickers."""

import pytest
from stage import Driven, Stage, Standing, empty_orchard

from orchard.agents.route import OneWay
from orchard.contract.agent import Action
from orchard.contract.messages import Claim
from orchard.field.geometry import Twist
from orchard.field.scenario import NEAREST, People


def test_pickers_begin_at_the_head_of_their_lane_and_pick_it_to_the_end():
    stage = Stage(empty_orchard(dispatch=NEAREST))  # no carrier passes the lane before the row is picked
    stage.assert_at("picker_01", x=-35.5, y=stage.world.layout.lane(1).y, heading="EAST")
    fruit = stage.bin_of("picker_01")
    took = stage.run_until(lambda: stage.is_full(fruit), 80)
    assert took == pytest.approx(70.0)
    stage.assert_at("picker_01", x=34.5, y=stage.world.layout.lane(1).y, heading="EAST")


def test_pickers_stop_for_an_obstacle_and_go_on_when_it_has_moved():
    stage = Stage(empty_orchard(people=People(workers=1, visitors=0)), worker_01=Standing())
    stage.put("worker_01", 0.0, stage.world.layout.lane(1).y, "NORTH")
    stage.run_until(lambda: stage.local.actions and stage.local.actions["picker_01"].waits_for == "an obstacle ahead", 60)
    stage.run(20)
    assert stage.pose("picker_01")[0] < 0.0
    stage.local.agents["worker_01"] = Driven(Twist(x=1.0))
    stage.run_until(lambda: stage.world.row_picked[0] == 70.0, 80)
    stage.assert_no_collisions()


def test_pickers_leave_the_full_bin_and_swap_it_for_an_empty_one_by_a_carrier():
    stage = Stage(empty_orchard())
    full = stage.bin_of("picker_01")
    stage.run_until(lambda: stage.is_full(full) and not stage.bin_of("picker_01"), 100)
    stage.assert_at(full, x=32.25)
    stage.run_until(lambda: bool(stage.bin_of("picker_01")), 200)
    assert stage.bin_of("picker_01") != full
    stage.assert_at("picker_01", x=OneWay.WAITING, heading="EAST")


def test_pickers_go_on_to_the_next_lane_with_their_empty_bin():
    stage = Stage(empty_orchard())
    stage.run_until(lambda: stage.world.row_picked[2] > 0.1, 400)  # picker_02 has rows 2 and 3
    stage.assert_at("picker_02", y=stage.world.layout.lane(3).y, heading="WEST")


@pytest.mark.parametrize("speed", [1.0, 0.05])
def test_pickers_ask_for_the_roads_three_seconds_before_they_must_stop_for_them(speed):
    stage = Stage(empty_orchard(pickers=3, carriers=1, row_length=20.0, picking_speed=speed, dispatch=NEAREST))
    stage.run_until(lambda: any(wanted(request) for request in stage.local.answers.get("picker_01", Action()).requests), 500)
    left = OneWay.PICKER_HOLD + stage.world.layout.shift - stage.pose("picker_01")[0]
    assert left / speed == pytest.approx(3.0, abs=0.3)


def wanted(request: tuple[str, object]) -> list[str]:
    """The places that a request asks for."""
    return request[1].want if isinstance(request[1], Claim) else []
