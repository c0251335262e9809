"""The deeds that physics does or refuses: coupling, uncoupling, flattening.

A `Yard` is a field without agents: `do` does one deed in a step, and `drive` steps with velocities.
A bin couples if its centre is within 0.1 m of the robot's coupling point, and turned by at most 5
degrees from a quarter turn. Names go on: picker_01, bin_02. The coupling point lies 2.25 m behind
the centre of a picker, 1.9 m behind that of a carrier.
"""

import math

import numpy as np
import pytest
from bare_world import Yard, yard

from orchard.contract.agent import Action
from orchard.contract.messages import Couple, Flatten, Uncouple
from orchard.field.geometry import EAST, NORTH, Pose, Twist
from orchard.field.kinds import kind_of
from orchard.field.scenario import Scenario
from orchard.sim.engine import Engine


def beside(kind: str = "picker", off: float = 0.0, aside: float = 0.0, yaw: float = 0.0) -> Yard:
    """Return a robot that faces north, and a bin that is so far off the coupling point.

    `off`: m ahead; `aside`: m to the left; `yaw`: how far it is turned, rad.
    """
    distance = {"picker": 2.25, "carrier": 1.9, "tractor": 5.0}[kind]
    return yard(
        (kind, Pose(1, 1, NORTH)), ("bin", Pose(1 - aside, 1 - distance + off, NORTH + yaw))
    )


@pytest.mark.parametrize("kind", ["picker", "carrier"])
@pytest.mark.parametrize(
    "yaw",
    [0.0, math.pi / 2, -math.pi / 2, math.pi, math.radians(4.9), math.pi / 2 - math.radians(4.9)],
)
def test_a_bin_couples_at_any_quarter_turn_and_stays(kind, yaw):
    """6 cm ahead and 6 cm to the side are 8.5 cm off the coupling point."""
    spot = beside(kind, off=0.06, aside=-0.06, yaw=yaw)
    before = spot.world.pose.copy()
    assert [event.what for event in spot.do(f"{kind}_01", Couple("bin_02"))] == ["coupled"]
    assert spot.coupled(f"{kind}_01") == "bin_02"
    assert spot.coupled("bin_02") == f"{kind}_01"
    assert np.array_equal(spot.world.pose, before)


# A robot and a bin that do not couple, and a word of the reason. 8 cm ahead and 8 cm to the side
# are 11.3 cm.
UNCOUPLED = {
    "11 cm ahead": (beside(off=0.11), "coupling point"),
    "11 cm aslant": (beside(aside=0.08, off=0.08), "coupling point"),
    "a little askew": (beside(yaw=math.radians(5.1)), "square"),
    "askew": (beside(yaw=math.radians(40)), "square"),
    "behind a tractor": (beside("tractor"), "tows nothing"),
}


@pytest.mark.parametrize(("spot", "why"), UNCOUPLED.values(), ids=UNCOUPLED)
def test_a_bin_elsewhere_or_askew_does_not_couple(spot, why):
    robot = spot.world.layout.names[0]
    (refusal,) = spot.do(robot, Couple("bin_02"))
    assert refusal.what == "deed refused"
    assert refusal.who == robot
    assert refusal.whom == "bin_02"
    assert why in refusal.detail
    assert spot.coupled(robot) == ""


def test_coupling_and_uncoupling_want_both_to_stand():
    spot = beside()
    spot.drive(1, picker_01=Twist(0.5))
    # The picker moved a tick ago.
    assert "moves" in spot.do("picker_01", Couple("bin_02"))[0].detail
    # It stands, and drives off in the tick of the deed.
    (refusal,) = spot.drive(1, deeds=[("picker_01", Couple("bin_02"))], picker_01=Twist(0.5))
    assert "moves" in refusal.detail
    spot = beside()
    assert spot.do("picker_01", Couple("bin_02"))[0].what == "coupled"
    # The bin drives off in this tick, and has moved in the next one.
    (refusal,) = spot.drive(1, deeds=[("picker_01", Uncouple())], bin_02=Twist(0.1))
    assert "bin_02 moves" in refusal.detail
    assert "bin_02 moves" in spot.do("picker_01", Uncouple())[0].detail
    assert spot.do("picker_01", Uncouple())[0].what == "uncoupled"
    assert spot.coupled("bin_02") == ""


def test_a_bin_is_coupled_to_one_robot_and_a_robot_to_one_bin():
    bins = ("bin", Pose(-2.25, 0, EAST)), ("bin", Pose(-2.25, 9, EAST))
    # bin_02 is at the coupling point of the picker, and at that of the carrier, which faces west:
    # 2.25 m + 1.9 m are 4.15 m.
    pair = yard(
        ("picker", Pose(0, 0, EAST)), bins[0], ("carrier", Pose(-4.15, 0, math.pi)), bins[1]
    )
    pair.do("picker_01", Couple("bin_02"))
    assert "coupled" in pair.do("carrier_03", Couple("bin_02"))[0].detail
    assert "has a bin" in pair.do("picker_01", Couple("bin_04"))[0].detail
    assert "no bin" in pair.do("carrier_03", Uncouple())[0].detail
    assert "no such bin" in pair.do("carrier_03", Couple("carrier_03"))[0].detail
    assert "no such bin" in pair.do("carrier_03", Couple("bin_99"))[0].detail


def weed_and_worker(distance: float) -> Yard:
    """Return a worker and a weed with this distance between their edges, m.

    The worker faces north, and is 1.0 m wide; the weed is 0.5 m long.
    """
    return yard(("worker", Pose(0, 0, NORTH)), ("weed", Pose(0.5 + distance + 0.25, 0, EAST)))


def test_a_weed_is_flattened_when_something_moves_within_a_metre():
    near = weed_and_worker(0.99)
    near.drive(1, worker_01=Twist(0.1))
    assert [(e.what, e.whom) for e in near.do("weed_02", Flatten())] == [
        ("weed flattened", "worker_01")
    ]
    assert not near.of("alive", "weed_02")
    assert near.do("weed_02", Flatten())[0].what == "deed refused"


def test_a_weed_is_not_flattened_by_what_stands_or_is_farther():
    far = weed_and_worker(1.01)
    far.drive(1, worker_01=Twist(0.1))
    assert far.do("weed_02", Flatten())[0].what == "deed refused"
    still = weed_and_worker(0.5)
    assert still.do("weed_02", Flatten())[0].what == "deed refused"
    assert still.of("alive", "weed_02")


def test_a_weed_is_flattened_by_the_straight_distance():
    """From corner to corner: 0.8 m in x and y are 1.13 m, and 0.7 m are 0.99 m.

    A dog is 1.0 m long and 0.8 m wide, and a weed 0.5 m by 0.5 m.
    """
    corner = yard(
        ("dog", Pose(0, 0, EAST)), ("weed", Pose(0.5 + 0.25 + 0.8, 0.4 + 0.25 + 0.8, EAST))
    )
    corner.drive(1, dog_01=Twist(0.001))
    assert corner.do("weed_02", Flatten())[0].what == "deed refused"
    corner.put("weed_02", 0.5 + 0.25 + 0.7, 0.4 + 0.25 + 0.7, EAST)
    corner.drive(1, dog_01=Twist(0.001))
    assert corner.do("weed_02", Flatten())[0].what == "weed flattened"


def test_only_weeds_are_flattened():
    near = yard(("worker", Pose(0, 0, NORTH)), ("visitor", Pose(1.1, 0, NORTH)))
    near.drive(1, worker_01=Twist(0.1))
    assert near.do("visitor_02", Flatten())[0].what == "deed refused"


def test_deeds_are_done_in_body_order():
    """They are given in the reverse order, and done in that of the layout."""
    engine = Engine.begin(Scenario())
    weeds = [name for name in engine.layout.names if kind_of(name) == "weed"]
    engine.observe()
    events = engine.advance({name: Action(deeds=[Flatten()]) for name in reversed(weeds)}, {})
    assert [event.who for event in events] == weeds
