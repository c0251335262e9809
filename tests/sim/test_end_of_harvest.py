"""The conditions for the end of the harvest."""

import pytest
from bare_world import Yard, everybody

from orchard.contract.messages import Uncouple
from orchard.field.geometry import Twist
from orchard.sim.physics import harvest_is_over


def finished() -> Yard:
    """Return a harvest that is over."""
    end = everybody()
    end.world.row_picked[:] = 70.0
    end.drive(1)
    return end


def test_the_harvest_is_over_when_all_is_picked_unloaded_and_back():
    assert harvest_is_over(finished().world)


@pytest.mark.parametrize("missing", ["row", "bin", "place", "heading", "hitch", "rest", "picker"])
def test_the_harvest_is_not_over_before(missing):
    end = finished()
    world, carrier = end.world, end.world.index["carrier_01"]
    if missing == "row":
        world.row_picked[-1] = 69.9
    elif missing == "bin":
        world.fill[world.index["bin_01"]] = 70.0
    elif missing == "place":
        world.pose[carrier, :2] = 40.0, 24.5
    elif missing == "heading":
        world.pose[carrier, 2] = 1e-5
    elif missing == "hitch":
        end.do("carrier_01", Uncouple())
    elif missing == "rest":
        end.drive(1, carrier_01=Twist(0.001))
    else:
        end.drive(1, picker_01=Twist(0.001))
    assert not harvest_is_over(world)
