"""Unloading of full bins in the bay."""

import pytest
from bare_world import Yard, picker_with_bin, yard

from orchard.contract.messages import Uncouple
from orchard.field.geometry import EAST, Pose, Twist
from orchard.field.layout import BAY

BAY_X, BAY_Y = (BAY.west + BAY.east) / 2, (BAY.south + BAY.north) / 2


def carriers_in_bay(*x: float) -> Yard:
    """Return a yard with carrier_01, carrier_03 ... and their full bins bin_02, bin_04 ... at these x in the bay, side by side."""
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
    assert (event.what, event.who, event.whom) == ("unloaded", "bin_02", "carrier_01")
    assert (bay.of("fill", "bin_02"), bay.world.delivered) == (0.0, 1)
    bay.drive(60)
    assert bay.world.delivered == 1


@pytest.mark.parametrize("moving", ["carrier_01", "bin_02"])
def test_who_moves_in_the_bay_begins_again(moving):
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


def test_a_bin_that_is_not_full_or_not_on_a_carrier_is_not_unloaded():
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


def test_one_bin_at_a_time_is_unloaded_and_who_began_goes_on():
    bay = carriers_in_bay(BAY_X - 1.5, BAY_X + 1.7)
    bay.drive(1, carrier_01=Twist(yaw=0.01))  # bin_04 begins
    bay.drive(48)
    assert bay.world.delivered == 0
    assert [event.who for event in bay.drive(1)] == ["bin_04"]
    assert bay.drive(49) == []
    assert [event.who for event in bay.drive(1)] == ["bin_02"]
    assert bay.world.delivered == 2
