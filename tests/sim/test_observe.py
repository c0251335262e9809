"""The observations that physics makes for each body."""

import pytest
from bare_world import picker_with_bin

from orchard.field.geometry import NORTH, Twist
from orchard.sim.scan import Scanner, observe
from orchard.sim.world import NONE


def test_everybody_is_told_its_place_and_its_hitch():
    told = picker_with_bin(yaw=NORTH)
    told.world.fill[1] = 70.0
    told.drive(1, picker_01=Twist(0.3))
    scans = Scanner(told.world).scan(told.world)
    seen = observe(told.world, scans)
    picker, bin_ = seen["picker_01"], seen["bin_02"]
    assert picker.pose == pytest.approx(told.pose("picker_01"), abs=1e-15)
    assert (picker.tick, picker.twist, picker.full) == (1, (0.3, 0.0, 0.0), False)
    assert (
        picker.hitch.name == "bin_02" and picker.hitch.scan.tobytes() == scans[1].tobytes() and picker.scan.tobytes() == scans[0].tobytes()
    )
    assert picker.hitch.pose == pytest.approx(told.pose("bin_02"), abs=1e-15)
    assert bin_.hitch.name == "picker_01" and bin_.hitch.scan is None and bin_.hitch.twist == (0.3, 0.0, 0.0)
    assert (bin_.fill, bin_.full) == (70.0, True)
    told.world.coupled[:] = NONE
    assert observe(told.world, scans)["picker_01"].hitch is None
