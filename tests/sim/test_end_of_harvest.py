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


MISSING = {
    "row": lambda end, carrier: end.world.row_picked.__setitem__(-1, 69.9),
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
