"""Coupling and uncoupling, from poses alone."""

from math import cos, sin

from hypothesis import given
from hypothesis import strategies as st
from orchard_ros2.deeds import COUPLE, PATIENCE_TICKS, UNCOUPLE, Handling, bin_behind

metres = st.floats(-100.0, 100.0)


def pose(x=0.0, y=0.0, yaw=0.0, forward=0.0, hitch=None, tick=0):
    """Return a message `pose` of the Orchard. `forward`: m/s. `hitch`: the bin on the bar."""
    twist = {
        "linear": {"x": forward, "y": 0.0, "z": 0.0},
        "angular": {"x": 0.0, "y": 0.0, "z": 0.0},
    }
    place = {
        "position": {"x": x, "y": y, "z": 0.0},
        "orientation": {"x": 0.0, "y": 0.0, "z": sin(yaw / 2), "w": cos(yaw / 2)},
    }
    return {"tick": tick, "pose": place, "twist": twist, "hitch": hitch}


@given(
    x=metres,
    y=metres,
    yaw=st.floats(-3.14, 3.14),
    tows=st.floats(0.1, 5.0),
    off=st.floats(-0.1, 0.1),
)
def test_the_bin_behind_is_the_one_at_the_coupling_point(x, y, yaw, tows, off):
    """One bin stands there, up to 10 cm off, and another one as far ahead of the robot."""
    bins = {
        "bin_01": pose(x - tows * cos(yaw) + off, y - tows * sin(yaw)),
        "bin_02": pose(x + tows * cos(yaw), y + tows * sin(yaw)),
    }
    assert bin_behind("picker_01", tows, bins | {"picker_01": pose(x, y, yaw)}) == "bin_01"


def test_without_a_bin_there_is_none_behind():
    assert bin_behind("picker_01", 2.25, {"picker_01": pose()}) == ""


def test_a_deed_waits_until_robot_and_bin_stand():
    couple = Handling("picker_01", COUPLE, "bin_01", began=0)
    uncouple = Handling("picker_01", UNCOUPLE, "", began=0)
    rolling_bin = {"name": "bin_01", **pose(forward=0.5)}
    standing_bin = {"name": "bin_01", **pose()}
    assert couple.deeds(pose(forward=0.5)) == []
    assert uncouple.deeds(pose(hitch=rolling_bin)) == []
    assert couple.deeds(pose()) == [{"type": "couple", "bin": "bin_01"}]
    assert uncouple.deeds(pose(hitch=standing_bin)) == [{"type": "uncouple"}]


def test_a_deed_is_done_when_the_bar_shows_it():
    """An outcome is '' when it is done, None while it goes on, and words when it is given up."""
    couple = Handling("picker_01", COUPLE, "bin_01", began=7)
    uncouple = Handling("picker_01", UNCOUPLE, "", began=7)
    on_bar = {"name": "bin_01", **pose()}
    assert couple.outcome(pose(hitch=on_bar, tick=8)) == ""
    assert uncouple.outcome(pose(tick=8)) == ""
    assert couple.outcome(pose(tick=8)) is None
    assert uncouple.outcome(pose(hitch=on_bar, tick=8)) is None
    assert "can couple only while" in couple.outcome(pose(tick=8 + PATIENCE_TICKS))
