"""The abilities of every robot: sense, turn, move, realign, tow a bin, and stand after a
collision.
"""

import math

import msgspec
import pytest
from stage import Driven, Stage, Standing, empty_orchard, meadow, one_guest

from orchard.contract.agent import IN_TURN
from orchard.field.geometry import HEADINGS, Pose, Twist, from_frame
from orchard.field.kinds import KINDS, kind_of
from orchard.plans.robot import Step
from orchard.plans.sense import stop_zone
from orchard.plans.steps import Again, Ahead, BeginPickingAt, DriveTo, Face, MoveTo, Realign
from orchard.sim.world import NONE


def test_sensing_a_robot_stops_for_what_its_laser_sees():
    stage = one_guest("worker", 0.0, 18.0)
    stage.local.agents["worker_01"] = Standing()
    stage.put("carrier_01", -10.0, 18.0)
    stage.give("carrier_01", [DriveTo(x=10.0)])
    stage.run(30)
    # The carrier is 1.8 m long, and the worker at x = 0 is 0.55 m long. The carrier stops 0.8 m
    # before the worker (`STOP_DISTANCE`), or up to two steps of 0.1 m nearer.
    front_of_carrier = stage.pose("carrier_01")[0] + 1.8 / 2
    back_of_worker = -0.55 / 2
    assert 0.6 < back_of_worker - front_of_carrier <= 0.8
    stage.assert_no_collisions()


def test_a_renamed_step_keeps_its_name_in_snapshots():
    """The class was once `PickFrom`, and snapshots of that time must still be read."""
    assert msgspec.to_builtins(BeginPickingAt(-31.3)) == {"step": "PickFrom", "x": -31.3}


@pytest.mark.parametrize(("heading", "seconds"), [("NORTH", 4.0), ("SOUTH", 4.0), ("WEST", 8.0)])
def test_a_turn_by_ninety_degrees_is_exact_in_four_seconds(heading, seconds):
    stage = meadow()
    stage.put("carrier_01", 0.0, 20.0)
    # It takes a tick more to see that it is done.
    took = stage.follow("carrier_01", [Face(heading)], 20)
    assert took == pytest.approx(seconds + 0.1)
    stage.assert_at("carrier_01", 0.0, 20.0, heading)


def test_turning_waits_for_what_the_bin_will_sweep():
    stage = one_guest("worker", -2.0, 21.6)
    stage.local.agents["worker_01"] = Standing()
    stage.put("carrier_01", 0.0, 20.0)
    # The carrier would turn to the right. So its bin would swing to the north, where the worker
    # stands.
    stage.give("carrier_01", [Face("SOUTH")])
    stage.run(10)
    stage.assert_at("carrier_01", 0.0, 20.0, "EAST")
    stage.assert_no_collisions()
    assert stage.local.actions["carrier_01"].waits_for == "an obstacle in its turn"


@pytest.mark.parametrize("metres", [3.0, 2.55, 0.04])
def test_a_movement_by_x_metres_ends_with_a_slower_remainder(metres):
    """A tick moves the robot by 0.1 m at most. In the last one it drives only what is left, so the
    movement ends at the metre.
    """
    stage = meadow()
    stage.put("carrier_01", 0.0, 20.0)
    stage.give("carrier_01", [Ahead(metres)])
    stage.run(metres + 1)
    stage.assert_at("carrier_01", metres, 20.0, "EAST")


def test_a_movement_to_a_point_goes_along_its_own_axis_first():
    stage = meadow()
    stage.put("carrier_01", 0.0, 18.0)
    stage.give("carrier_01", [MoveTo(6.0, 24.0)])
    stage.run_until(lambda: stage.pose("carrier_01")[1] > 18.1, 60)
    stage.assert_at("carrier_01", x=6.0, heading="NORTH")


@pytest.mark.parametrize(("x", "y", "heading"), [(6.0, 24.0, "NORTH"), (-5.0, 18.0, "WEST")])
def test_a_movement_ends_at_its_point_also_behind_the_robot(x, y, heading):
    stage = meadow()
    stage.put("carrier_01", 0.0, 18.0)
    stage.follow("carrier_01", [MoveTo(x, y)])
    stage.assert_at("carrier_01", x, y, heading)


def test_a_movement_ends_right_after_something_in_the_way():
    stage = one_guest("worker", 0.0, 18.0, "NORTH")
    stage.local.agents["worker_01"] = Standing()
    stage.put("carrier_01", -6.0, 18.0)
    stage.give("carrier_01", [DriveTo(x=4.3)])
    stage.tick()
    stage.run_until(lambda: stage.local.actions["carrier_01"].waits_for == "an obstacle ahead", 20)
    # It walks away to the north.
    stage.local.agents["worker_01"] = Driven(Twist(x=1.0))
    stage.run_until(lambda: not stage.local.memories["carrier_01"].plan, 60)
    stage.assert_at("carrier_01", 4.3, 18.0, "EAST")


@pytest.mark.parametrize("off", [0.3, -0.3, 0.02, -1e-5])
def test_a_robot_realigns_to_the_nearest_heading_exactly(off):
    """`off`: how far it has turned off north, rad."""
    stage = meadow()
    stage.put("carrier_01", 0.0, 20.0)
    # Without its bin, which stands elsewhere, the carrier turns freely.
    carrier = stage.world.index["carrier_01"]
    bin_ = stage.world.index[stage.bin_of("carrier_01")]
    stage.world.coupled[[carrier, bin_]] = NONE
    stage.world.pose[bin_] = 20.0, 20.0, 0.0
    stage.world.pose[carrier, 2] = HEADINGS["NORTH"] + off
    stage.follow("carrier_01", [Realign()], 20)
    stage.assert_at("carrier_01", 0.0, 20.0, "NORTH")


# The fastest machines that a scenario allows: m/s, and degrees/s.
FASTEST = {
    "picking": {"driving_speed": 2.5, "turning": 60.0},
    "carrying": {"speed": 2.5, "turning": 60.0},
}


@pytest.mark.parametrize(
    ("machines", "most", "refused_steps"),
    [({}, 0.15, 0), (FASTEST, 0.35, 1)],
    ids=["usual", "fastest"],
)
@pytest.mark.parametrize("robot", ["picker_01", "carrier_01"])
def test_following_a_bin_keeps_its_place_behind_its_robot(robot, machines, most, refused_steps):
    """The bin is at most `most` m off its place while its robot drives and turns.

    At its fastest the robot is refused a step where it ends a turn, and stands for a tick.
    """
    stage = meadow(**machines)
    stage.put(robot, -15.0, 20.0)
    stage.give(
        robot,
        [MoveTo(-5.0, 26.0), MoveTo(10.0, 20.0), Face("NORTH"), Face("SOUTH"), DriveTo(y=19.0)],
    )
    bin_name = stage.bin_of(robot)
    furthest_off = 0.0
    while stage.local.memories[robot].plan:
        assert stage.seconds < 120
        stage.tick()
        furthest_off = max(furthest_off, off_its_place(stage, robot, bin_name))
    stage.run(0.2)
    # It follows a tick late, so it is off by what the robot moves in a tick: if it were less than a
    # third of `most`, the bound would prove little.
    assert most / 3 < furthest_off <= most
    assert off_its_place(stage, robot, bin_name) < 1e-9, "exactly on its place at rest"
    assert stage.world.refused.sum() == refused_steps


def off_its_place(stage: Stage, robot: str, bin_name: str) -> float:
    """Return how far a bin is from where its robot tows it, m."""
    x, y = from_frame(Pose(*stage.pose(robot)), -KINDS[kind_of(robot)].tows, 0.0)
    bin_x, bin_y, _ = stage.pose(bin_name)
    return math.hypot(bin_x - x, bin_y - y)


def test_a_robot_stands_a_second_after_a_refused_step():
    """Its memory says that it drove, and it stands: so the simulator refused its last step.

    carrier_02 stands out of its way.
    """
    stage = meadow()
    stage.put("carrier_01", 0.0, 20.0)
    stage.put("carrier_02", 0.0, 17.0)
    stage.local.agents["carrier_02"] = Driven(Twist(x=0.0))
    stage.give("carrier_01", [Again([DriveTo(x=5.0)])], moving=True)
    stage.tick()
    assert stage.pose("carrier_01")[0] == 0.0
    assert stage.local.actions["carrier_01"].waits_for == "what it collided with"
    stage.run(1.0)
    assert stage.pose("carrier_01")[0] > 0.0


def test_a_robot_with_a_bin_that_turns_is_asked_at_every_tick():
    """It looks at what the bin will sweep in each tick, so it holds its velocity for none."""
    stage = Stage(empty_orchard())
    stage.give("carrier_01", [Face("NORTH")])
    stage.tick()
    assert stage.local.actions["carrier_01"].hold is None


def turning(begins="EAST", ends="WEST"):
    """Return a tractor that begins to turn about on the driveway."""
    stage = Stage(empty_orchard(tractor=True))
    stage.put("tractor_01", -35.0, 29.0, begins)
    stage.give("tractor_01", [Face(ends)])
    return stage


class Nudge(Step, frozen=True):
    """A step of the user's own that turns by almost nothing, and is done in the same tick."""

    def act(self, robot):
        robot.turn(1e-9, 1e-9, [])
        return True


def test_a_drive_after_a_turn_of_the_same_tick_looks_ahead():
    """A step that is done at once, and then a drive in the same tick: the drive must watch the stop
    zone ahead of it, as it would without the step. Else it would not see the carrier 15 m ahead.
    """
    stage = Stage(empty_orchard(tractor=True))
    stage.put("tractor_01", -45.0, 29.0)
    stage.put("carrier_01", -30.0, 29.0)
    stage.give("tractor_01", [Nudge(), DriveTo(x=-10.0)])
    stage.tick()
    assert stage.local.actions["tractor_01"].hold.watch == (
        stop_zone(stage.local.engine.observe()["tractor_01"]),
    )


def test_a_robot_with_nothing_near_is_asked_at_its_turns_end():
    """After the first tick it holds its rate of turning up to the last tick, which is slower."""
    stage = turning()
    asked = []
    # A half turn takes 8 s.
    for tick in range(80):
        stage.tick()
        if "tractor_01" in stage.local.answers:
            asked.append(tick)
    stage.assert_at("tractor_01", x=-35.0, y=29.0, heading="WEST")
    assert asked[1:] == [79], "only for the slower last tick"


def test_a_turning_robot_is_asked_when_something_comes_near():
    """A carrier drives up at 1 m/s from 5.5 m before it. While it is far, the tractor holds."""
    stage = turning("WEST", "EAST")
    stage.put("carrier_01", -40.5, 29.0)
    stage.local.agents["carrier_01"] = Driven(Twist(x=1.0))
    stage.tick()
    stage.tick()
    assert "tractor_01" not in stage.local.answers
    stage.run_until(lambda: stage.local.actions["tractor_01"].waits_for == IN_TURN, seconds=3.0)
