"""From the row to the bay: fruit goes into a bin, the bin is unloaded, and the harvest ends.

A row is 70 m long, from x = -35.5 m (`ROW_WEST`) to 34.5 m, and a bin takes the fruit of 70 m.
`train(x=1.0)` are the velocities, m/s, of a picker and its bin. `row_ends` has for each row: the m
that are picked from its west end on, and from its east end on; and of a part inside, up to how many
m from the west end and up to how many from the east end it is picked.
"""

import math
from functools import partial

import pytest
from bare_world import AHEAD, LANE, Yard, everybody, picker_with_bin, train, yard
from hypothesis import given, settings
from hypothesis import strategies as st

from orchard.contract.messages import PickFrom, Uncouple
from orchard.field.geometry import EAST, Pose, Twist
from orchard.field.lanes import ROW_WEST
from orchard.field.layout import BAY
from orchard.sim.physics import harvest_is_over


def test_a_row_from_end_to_end_fills_a_bin():
    row = picker_with_bin(x=ROW_WEST - 0.55)
    row.drive(710, **train(x=1.0))
    assert row.world.row_picked.tolist() == [70.0, 0.0, 0.0]
    assert row.of("fill", "bin_02") == 70.0
    assert row.world.full[row.world.index["bin_02"]]
    assert [(e.what, e.who, e.whom) for e in row.events] == [
        ("row picked", "picker_01", "bin_02"),
        ("bin full", "bin_02", "picker_01"),
    ]
    # It starts 0.55 m before the row. So it has picked 70 m after 70.55 m, at 0.1 m a tick.
    assert row.events[0].tick == 705
    assert row.events[0].detail == "row 1"


def test_a_row_is_picked_westward_as_well():
    # It starts 5 cm before the east end, and drives 30 m.
    row = picker_with_bin(x=34.55, yaw=math.pi)
    row.drive(300, **train(x=1.0))
    assert row.world.row_ends[0, 0] == 0.0
    assert row.world.row_ends[0, 1] == row.of("fill", "bin_02") == pytest.approx(29.95)


def test_what_grows_in_the_row_goes_into_the_bin_once():
    """It drives 10 m, 5 m back and 6 m ahead: so 11 m are picked."""
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


# A picker picks within 1 m of the lane's centre line. Lanes are 5.5 m apart.
NOTHING_IS_PICKED = {
    "by one that begins amid a row": partial(picker_with_bin, x=0.0),
    "into a full bin": picker_with_full_bin,
    "north of the lane": partial(picker_with_bin, y=LANE + 1.01),
    "south of the lane": partial(picker_with_bin, y=LANE - 1.01),
    "between two lanes": partial(picker_with_bin, y=LANE - 2.75),
    "without a bin": partial(yard, ("picker", Pose(ROW_WEST, LANE, EAST))),
    "by a carrier": carrier_with_bin,
    "by one that passes on the headland": partial(
        picker_with_bin, x=ROW_WEST - 0.05, y=LANE + 3, yaw=-math.pi / 2
    ),
}


@pytest.mark.parametrize("case", NOTHING_IS_PICKED)
def test_nothing_is_picked(case):
    row = NOTHING_IS_PICKED[case]()
    row.drive(100, **dict.fromkeys(row.world.layout.names, AHEAD))
    assert row.of("distance", row.world.layout.names[0]) > 9.9
    assert not row.world.row_ends.any()


def test_a_second_bin_goes_on_where_the_first_ended():
    row = picker_with_bin(x=-20.0)
    # Picked up to x = -25.5.
    row.world.row_ends[0, 0] = 10.0
    # Beyond that it picks nothing. It drives to x = -19, back to -26, and on to -24: so it picks
    # 1.5 m.
    row.drive(10, **train(x=1.0))
    assert row.world.row_picked[0] == 10.0
    row.drive(70, **train(x=-1.0))
    row.drive(20, **train(x=1.0))
    assert row.world.row_picked[0] == pytest.approx(11.5)
    assert row.of("fill", "bin_02") == pytest.approx(1.5)


def test_a_part_inside_a_row_is_picked_up_to_the_edge():
    """The edge is where the part begins that was picked from the east end.

    The picker is told to pick from x = -31.3 on. It drives up to there at 1 m/s, and 10 cm less.
    """
    row = picker_with_bin(x=-36.0, picking_speed=0.5)
    row.drive(46, deeds=[("picker_01", PickFrom(-31.3))], **train(x=1.0))
    assert row.of("pose", "picker_01")[0] == pytest.approx(-31.4)
    assert not row.world.row_ends.any()
    row.drive(40, **train(x=0.5))
    # Inside: from x = -31.3, 65.8 m before the eastern end, to the picker, 6.1 m from the western.
    assert row.world.row_ends[0].tolist() == pytest.approx([0.0, 0.0, 6.1, 65.8])
    assert row.world.row_picked[0] == pytest.approx(1.9)
    assert row.of("fill", "bin_02") == pytest.approx(1.9)
    # Picked from the east end up to x = -28.5.
    row.world.row_ends[0, 1] = 63.0
    row.drive(20, **train(x=0.5))
    assert row.world.row_ends[0].tolist() == pytest.approx([0.0, 65.8, 0.0, 0.0])
    assert row.of("fill", "bin_02") == pytest.approx(2.8)


def test_a_bin_takes_70_m_and_the_row_keeps_the_rest():
    row = picker_with_bin()
    # Body 1 is the bin.
    row.world.fill[1] = 68.05
    row.drive(40, **train(x=1.0))
    assert row.of("fill", "bin_02") == 70.0
    assert row.world.row_picked[0] == pytest.approx(1.95)
    assert [event.what for event in row.events] == ["bin full"]


def test_a_picker_picks_at_one_speed_and_drives_at_another():
    row = picker_with_bin(picking_speed=0.25)
    row.drive(10, **train(x=0.25))
    row.drive(1, picker_01=AHEAD)
    assert row.of("twist", "picker_01")[0] == 0.25
    row.drive(1, picker_01=Twist(-1.0))
    assert row.of("twist", "picker_01")[0] == -0.25
    row.drive(1, picker_01=Twist(-1.0))
    # Over what is picked.
    assert row.of("twist", "picker_01")[0] == -1.0
    row.world.fill[1] = 70.0
    row.put("picker_01", 0.0, LANE, EAST)
    row.put("bin_02", -2.25, LANE, EAST)
    row.drive(1, **train(x=1.0))
    # Its bin is full.
    assert row.of("twist", "picker_01")[0] == 1.0


@settings(max_examples=30)
@given(st.lists(st.tuples(st.floats(-1, 1), st.integers(1, 80)), max_size=12))
def test_the_fruit_is_kept(course):
    """The bin holds exactly what was picked from the rows, and both only grow.

    `course`: velocities, m/s, each with its number of ticks. At most what was driven is picked, and
    the 0.1 m from the row's end to where it starts.
    """
    row = picker_with_bin(x=ROW_WEST + 0.1)
    last = 0.0
    for speed, ticks in course:
        row.drive(ticks, **train(x=speed))
        assert row.of("fill", "bin_02") == pytest.approx(row.world.row_picked.sum(), abs=2e-6)
        assert row.of("fill", "bin_02") >= last
        last = row.of("fill", "bin_02")
    # 0.1 m more lets sums of floats differ.
    assert last <= row.of("distance", "picker_01") + 0.1 + 0.1


BAY_X = (BAY.west + BAY.east) / 2
BAY_Y = (BAY.south + BAY.north) / 2


def carriers_in_bay(*x: float) -> Yard:
    """Return a yard with carriers and their full bins side by side in the bay, at these x, m.

    They are carrier_01, carrier_03 ... and bin_02, bin_04 ...
    """
    bodies = []
    for k, bin_x in enumerate(x):
        y = BAY_Y - 0.85 + 1.7 * k
        bodies += [("carrier", Pose(bin_x + 1.9, y, EAST)), ("bin", Pose(bin_x, y, EAST))]
    bay = yard(*bodies)
    for k in range(len(x)):
        bay.couple(f"carrier_{2 * k + 1:02d}", f"bin_{2 * k + 2:02d}")
        bay.world.fill[2 * k + 1] = 70.0
    return bay


def test_five_seconds_at_rest_in_the_bay_empty_a_full_bin():
    bay = carriers_in_bay(BAY_X)
    bay.drive(49)
    assert bay.of("fill", "bin_02") == 70.0
    (event,) = bay.drive(1)
    assert event.what == "unloaded"
    assert event.who == "bin_02"
    assert event.whom == "carrier_01"
    assert bay.of("fill", "bin_02") == 0.0
    assert bay.world.delivered == 1
    bay.drive(60)
    assert bay.world.delivered == 1


@pytest.mark.parametrize("moving", ["carrier_01", "bin_02"])
def test_a_carrier_or_bin_that_moves_in_the_bay_begins_again(moving):
    bay = carriers_in_bay(BAY_X)
    bay.drive(40)
    bay.drive(1, **{moving: Twist(0.01)})
    bay.drive(49)
    assert bay.world.delivered == 0
    bay.drive(1)
    assert bay.world.delivered == 1


def test_the_bay_is_the_bins_place():
    outside = carriers_in_bay(BAY.west - 0.1)
    outside.drive(60)
    assert outside.world.delivered == 0


def test_a_bin_not_full_or_not_on_a_carrier_stays_loaded():
    bay = carriers_in_bay(BAY_X)
    bay.world.fill[1] = 69.9
    bay.drive(60)
    assert bay.world.delivered == 0
    loose = carriers_in_bay(BAY_X)
    loose.do("carrier_01", Uncouple())
    loose.drive(60)
    assert loose.world.delivered == 0
    picker = picker_with_bin(x=BAY_X + 2.25, y=BAY_Y)
    picker.world.fill[1] = 70.0
    picker.drive(60)
    assert picker.world.delivered == 0


def test_one_bin_at_a_time_is_unloaded_from_begin_to_end():
    """To unload takes 50 ticks at rest. carrier_01 turns in the first one, so bin_04 begins."""
    bay = carriers_in_bay(BAY_X - 1.5, BAY_X + 1.7)
    bay.drive(1, carrier_01=Twist(yaw=0.01))
    bay.drive(48)
    assert bay.world.delivered == 0
    assert [event.who for event in bay.drive(1)] == ["bin_04"]
    assert bay.drive(49) == []
    assert [event.who for event in bay.drive(1)] == ["bin_02"]
    assert bay.world.delivered == 2


def finished() -> Yard:
    """Return an orchard in which all rows are picked, and all robots stand where they began."""
    end = everybody()
    end.world.row_ends[:, 0] = 70.0
    end.drive(1)
    return end


def test_the_harvest_is_over_when_all_is_unloaded_and_back():
    assert harvest_is_over(finished().world)


# What is not yet so, and what makes it so in an orchard that is finished.
MISSING = {
    "row": lambda end, carrier: end.world.row_ends.__setitem__((-1, 0), 69.9),
    "bin": lambda end, carrier: end.world.fill.__setitem__(end.world.index["bin_01"], 70.0),
    "place": lambda end, carrier: end.put(carrier, 40.0, 24.5, 0.0),
    "heading": lambda end, carrier: end.put(carrier, *end.pose(carrier)[:2], 1e-5),
    "hitch": lambda end, carrier: end.do(carrier, Uncouple()),
    "rest": lambda end, carrier: end.drive(1, carrier_01=Twist(0.001)),
    "picker": lambda end, carrier: end.drive(1, picker_01=Twist(0.001)),
}


@pytest.mark.parametrize("missing", MISSING)
def test_the_harvest_is_not_over_before(missing):
    end = finished()
    MISSING[missing](end, "carrier_01")
    assert not harvest_is_over(end.world)
