"""Picking: fruit goes from the rows into a bin."""

import math
from functools import partial

import pytest
from bare_world import AHEAD, LANE, Yard, picker_with_bin, train, yard
from hypothesis import given, settings
from hypothesis import strategies as st

from orchard.field.geometry import EAST, Pose, Twist
from orchard.field.layout import ROW_WEST
from orchard.sim.physics import is_full


def test_a_row_from_end_to_end_fills_a_bin():
    row = picker_with_bin(x=ROW_WEST - 0.55)
    row.drive(710, **train(x=1.0))
    assert row.world.row_picked.tolist() == [70.0, 0.0, 0.0]
    assert row.of("fill", "bin_02") == 70.0
    assert is_full(row.world, row.world.index["bin_02"])
    assert [(e.what, e.who, e.whom) for e in row.events] == [("row picked", "picker_01", "bin_02"), ("bin full", "bin_02", "picker_01")]
    assert row.events[0].tick == 705  # 70.55 m at 0.1 m a tick
    assert row.events[0].detail == "row 1"


def test_a_row_is_picked_westward_as_well():
    row = picker_with_bin(x=34.55, yaw=math.pi)
    row.drive(300, **train(x=1.0))
    assert row.world.row_from[0] == 1
    assert row.world.row_picked[0] == row.of("fill", "bin_02") == pytest.approx(29.95)


def test_what_grows_in_the_row_goes_into_the_bin_and_driving_back_and_forth_adds_nothing():
    row = picker_with_bin()
    row.drive(100, **train(x=1.0))
    row.drive(50, **train(x=-1.0))
    assert row.of("fill", "bin_02") == pytest.approx(10.0)
    row.drive(60, **train(x=1.0))
    assert row.of("fill", "bin_02") == pytest.approx(11.0)


def carrier_with_bin() -> Yard:
    pair = yard(("carrier", Pose(ROW_WEST, LANE, EAST)), ("bin", Pose(ROW_WEST - 1.9, LANE, EAST)))
    pair.couple("carrier_01", "bin_02")
    return pair


def picker_with_full_bin() -> Yard:
    full = picker_with_bin()
    full.world.fill[1] = 70.0
    return full


NOTHING_IS_PICKED = {
    "by one that begins amid a row": partial(picker_with_bin, x=0.0),
    "into a full bin": picker_with_full_bin,
    "north of the lane": partial(picker_with_bin, y=LANE + 1.01),
    "south of the lane": partial(picker_with_bin, y=LANE - 1.01),
    "between two lanes": partial(picker_with_bin, y=LANE - 2.75),
    "without a bin": partial(yard, ("picker", Pose(ROW_WEST, LANE, EAST))),
    "by a carrier": carrier_with_bin,
    "by one that passes on the headland": partial(picker_with_bin, x=ROW_WEST - 0.05, y=LANE + 3, yaw=-math.pi / 2),
}


@pytest.mark.parametrize("case", NOTHING_IS_PICKED)
def test_nothing_is_picked(case):
    row = NOTHING_IS_PICKED[case]()
    row.drive(100, **dict.fromkeys(row.world.layout.names, AHEAD))
    assert row.of("distance", row.world.layout.names[0]) > 9.9
    assert not row.world.row_picked.any() and not row.world.row_from.any()


def test_a_second_bin_goes_on_where_the_first_one_ended_and_not_beyond_a_gap():
    row = picker_with_bin(x=-20.0)
    row.world.row_picked[0], row.world.row_from[0] = 10.0, -1  # picked up to x = -25.5
    row.drive(10, **train(x=1.0))
    assert row.world.row_picked[0] == 10.0
    row.drive(70, **train(x=-1.0))
    row.drive(20, **train(x=1.0))
    assert row.world.row_picked[0] == pytest.approx(11.5)
    assert row.of("fill", "bin_02") == pytest.approx(1.5)


def test_a_bin_takes_70_m_and_the_row_keeps_the_rest():
    row = picker_with_bin()
    row.world.fill[1] = 68.05
    row.drive(40, **train(x=1.0))
    assert row.of("fill", "bin_02") == 70.0
    assert row.world.row_picked[0] == pytest.approx(1.95)
    assert [event.what for event in row.events] == ["bin full"]


def test_a_picker_picks_at_the_picking_speed_and_drives_on_at_its_own():
    row = picker_with_bin(picking_speed=0.25)
    row.drive(10, **train(x=0.25))
    row.drive(1, picker_01=AHEAD)
    assert row.of("twist", "picker_01")[0] == 0.25
    row.drive(1, picker_01=Twist(-1.0))
    assert row.of("twist", "picker_01")[0] == -0.25
    row.drive(1, picker_01=Twist(-1.0))
    assert row.of("twist", "picker_01")[0] == -1.0  # over what is picked
    row.world.fill[1] = 70.0
    row.put("picker_01", 0.0, LANE, EAST)
    row.put("bin_02", -2.25, LANE, EAST)
    row.drive(1, **train(x=1.0))
    assert row.of("twist", "picker_01")[0] == 1.0  # its bin is full


@settings(max_examples=30)
@given(st.lists(st.tuples(st.floats(-1, 1), st.integers(1, 80)), max_size=12))
def test_the_fruit_is_kept(course):
    """The bin holds exactly what was picked from the rows, and both only grow."""
    row = picker_with_bin(x=ROW_WEST + 0.1)
    last = 0.0
    for speed, ticks in course:
        row.drive(ticks, **train(x=speed))
        assert row.of("fill", "bin_02") == pytest.approx(row.world.row_picked.sum(), abs=2e-6)
        assert row.of("fill", "bin_02") >= last
        last = row.of("fill", "bin_02")
    assert last <= max(row.of("distance", "picker_01"), 0.0) + 0.2
