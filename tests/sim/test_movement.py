"""The effect of a velocity: distance, turn and arc, and the limits of each kind."""

import math

import numpy as np
import pytest
from bare_world import AHEAD, LANE, TURN_LEFT, everybody, picker_with_bin, yard
from hypothesis import example, given, settings
from hypothesis import strategies as st

from orchard.field.geometry import EAST, NORTH, Pose, Twist
from orchard.field.layout import ROW_WEST
from orchard.sim.kernels import move


def test_ten_ticks_at_1_m_per_s_are_1_m():
    moved = yard(("picker", Pose(0, 0, EAST)))
    moved.drive(10, picker_01=AHEAD)
    assert moved.pose("picker_01") == pytest.approx((1.0, 0.0, 0.0), abs=1e-12)
    assert moved.of("distance", "picker_01") == pytest.approx(1.0)
    assert moved.world.tick == 10


def test_40_ticks_of_an_eighth_turn_per_second_are_exactly_90_degrees():
    turned = yard(("picker", Pose(0, 0, EAST)))
    turned.drive(40, picker_01=TURN_LEFT)
    assert turned.pose("picker_01") == pytest.approx((0.0, 0.0, NORTH), abs=1e-14)
    turned.drive(120, picker_01=TURN_LEFT)
    assert turned.pose("picker_01").yaw == pytest.approx(0.0, abs=2e-14)


@settings(max_examples=200)
@given(st.floats(-3, 3), st.floats(-3, 3), st.one_of(st.floats(-6.3, 6.3), st.floats(-1e-7, 1e-7), st.just(0.0)), st.floats(-3.1, 3.1))
@example(1.0, 0.0, 1e-300, 0.5)
@example(1.0, 0.0, 5e-324, 0.5)
def test_a_step_follows_its_arc(forward, left, turn, yaw):
    """Compare with the closed form where that is well conditioned, else with a thousand small straight steps."""
    x, y, end = move.arc(2.0, -1.0, yaw, forward, left, turn, 0.1)
    if abs(turn) > 1e-3:
        north, east = math.sin(yaw + turn * 0.1) - math.sin(yaw), math.cos(yaw + turn * 0.1) - math.cos(yaw)
        expected = 2.0 + (forward * north + left * east) / turn, -1.0 + (left * north - forward * east) / turn
    else:
        middle = yaw + turn * (np.arange(1000) + 0.5) * 1e-4
        expected = (
            2.0 + 1e-4 * np.sum(forward * np.cos(middle) - left * np.sin(middle)),
            -1.0 + 1e-4 * np.sum(forward * np.sin(middle) + left * np.cos(middle)),
        )
    assert (x, y) == pytest.approx(expected, abs=1e-12)
    assert math.cos(end - yaw - turn * 0.1) == pytest.approx(1.0, abs=1e-12)


def test_driving_and_turning_makes_a_circle():
    round_ = yard(("picker", Pose(0, 0, EAST)))
    round_.drive(160, picker_01=Twist(1.0, 0.0, math.pi / 8))
    assert round_.pose("picker_01") == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)
    assert round_.of("distance", "picker_01") == pytest.approx(16.0)


@pytest.mark.parametrize(("kind", "speed", "eighths"), [("picker", 1, 1), ("tractor", 1, 1), ("worker", 1, 8), ("dog", 3, 16)])
def test_nothing_is_faster_than_its_kind(kind, speed, eighths):
    fast = yard((kind, Pose(0, 0, EAST)))
    fast.drive(1, **{f"{kind}_01": Twist(x=-99.0)})
    assert fast.pose(f"{kind}_01").x == pytest.approx(-0.1 * speed)
    fast.drive(1, **{f"{kind}_01": Twist(yaw=99.0)})
    assert fast.pose(f"{kind}_01").yaw == pytest.approx(0.1 * eighths * math.pi / 8)


def test_a_bin_is_not_faster_askew_than_straight_on():
    askew = picker_with_bin()
    askew.drive(1, bin_02=Twist(-99.0, 99.0))
    assert math.dist(askew.pose("bin_02")[:2], (ROW_WEST - 2.25, LANE)) == pytest.approx(0.3)


def test_only_a_coupled_bin_moves_sideways_and_one_by_itself_not_at_all():
    side = picker_with_bin()
    side.drive(1, picker_01=Twist(y=1.0), bin_02=Twist(y=1.0))
    assert side.pose("picker_01").y == LANE
    assert side.pose("bin_02").y == pytest.approx(LANE + 0.1)
    alone = yard(("bin", Pose(0, 0, EAST)))
    alone.drive(1, bin_01=Twist(1.0, 1.0, 1.0))
    assert alone.pose("bin_01") == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
def test_a_velocity_that_is_no_number_stands_still(wrong):
    still = yard(("dog", Pose(0, 0, EAST)))
    still.drive(1, dog_01=Twist(1.0, 0.0, wrong))
    assert still.pose("dog_01") == (0.0, 0.0, 0.0)


def test_nothing_moves_that_is_not_driven():
    quiet = everybody()
    before = quiet.world.pose.copy()
    quiet.drive(50)
    assert np.array_equal(quiet.world.pose, before)
