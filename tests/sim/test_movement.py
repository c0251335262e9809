"""The effect of a velocity: distance, turn and arc, the limits of each kind, and what stops a body:
walls, others, the bar to its bin.

`yard` makes a field without agents (tests/support/bare_world.py): its bodies have the names
picker_01, worker_02 ... in their order. Poses are x, y, m, and yaw, rad. A wall is (x, y, half
length, half width), m. AHEAD is 1 m/s, and TURN_LEFT an eighth of pi a second.
"""

import math

import numpy as np
import pytest
from bare_world import AHEAD, LANE, TURN_LEFT, everybody, overlapping, picker_with_bin, train, yard
from hypothesis import example, given, settings
from hypothesis import strategies as st
from raycaster import world_of

from orchard.field.geometry import EAST, NORTH, Pose, Twist
from orchard.field.kinds import ANIMALS, KINDS, PEOPLE
from orchard.field.lanes import ROW_WEST
from orchard.field.repeatable import PI
from orchard.plans import sense
from orchard.report.metrics import collisions
from orchard.sim.kernels import move
from orchard.sim.physics import step

# m from the middle of a body to its front, and of the tractor to its side.
PICKER_FRONT = KINDS["picker"].length / 2
WORKER_FRONT = KINDS["worker"].length / 2
TRACTOR_FRONT = KINDS["tractor"].length / 2
TRACTOR_SIDE = KINDS["tractor"].width / 2


def test_ten_ticks_at_1_m_per_s_are_1_m():
    moved = yard(("picker", Pose(0, 0, EAST)))
    moved.drive(10, picker_01=AHEAD)
    assert moved.pose("picker_01") == pytest.approx((1.0, 0.0, 0.0), abs=1e-12)
    assert moved.of("distance", "picker_01") == pytest.approx(1.0)
    assert moved.world.tick == 10


def test_40_ticks_of_an_eighth_turn_a_second_are_90_degrees():
    turned = yard(("picker", Pose(0, 0, EAST)))
    turned.drive(40, picker_01=TURN_LEFT)
    assert turned.pose("picker_01") == pytest.approx((0.0, 0.0, NORTH), abs=1e-14)
    turned.drive(120, picker_01=TURN_LEFT)
    assert turned.pose("picker_01").yaw == pytest.approx(0.0, abs=2e-14)


@given(
    st.floats(-3, 3),
    st.floats(-3, 3),
    st.one_of(st.floats(-6.3, 6.3), st.floats(-1e-7, 1e-7), st.just(0.0)),
    st.floats(-3.1, 3.1),
)
@example(1.0, 0.0, 1e-300, 0.5)
@example(1.0, 0.0, 5e-324, 0.5)
def test_a_step_follows_its_arc(forward, left, turn, yaw):
    """A step of 0.1 s from (2, -1) m is compared with the closed form of an arc.

    For turns that are so slow that the form divides by almost nothing, it is compared with a
    thousand straight steps of 0.1 ms. `forward`, `left`: m/s; `turn`: rad/s; `yaw`: rad.
    """
    x, y, end = move.arc(2.0, -1.0, yaw, forward, left, turn, 0.1)
    if abs(turn) > 1e-3:
        north = math.sin(yaw + turn * 0.1) - math.sin(yaw)
        east = math.cos(yaw + turn * 0.1) - math.cos(yaw)
        expected = (
            2.0 + (forward * north + left * east) / turn,
            -1.0 + (left * north - forward * east) / turn,
        )
    else:
        middle = yaw + turn * (np.arange(1000) + 0.5) * 1e-4
        expected = (
            2.0 + 1e-4 * np.sum(forward * np.cos(middle) - left * np.sin(middle)),
            -1.0 + 1e-4 * np.sum(forward * np.sin(middle) + left * np.cos(middle)),
        )
    assert (x, y) == pytest.approx(expected, abs=1e-12)
    assert math.cos(end - yaw - turn * 0.1) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(
    ("kind", "speed", "eighths"),
    [("picker", 1, 1), ("tractor", 1, 1), ("worker", 1, 8), ("dog", 3, 16)],
)
def test_nothing_is_faster_than_its_kind(kind, speed, eighths):
    """`speed`: m/s at most, also backwards; `eighths`: rad/s at most, in eighths of pi."""
    fast = yard((kind, Pose(0, 0, EAST)))
    fast.drive(1, **{f"{kind}_01": Twist(x=-99.0)})
    assert fast.pose(f"{kind}_01").x == pytest.approx(-0.1 * speed)
    fast.drive(1, **{f"{kind}_01": Twist(yaw=99.0)})
    assert fast.pose(f"{kind}_01").yaw == pytest.approx(0.1 * eighths * math.pi / 8)


def test_a_bin_is_not_faster_askew_than_straight_on():
    """A bin drives 3 m/s at most, 0.3 m a tick, whichever way."""
    askew = picker_with_bin()
    askew.drive(1, bin_02=Twist(-99.0, 99.0))
    assert math.dist(askew.pose("bin_02")[:2], (ROW_WEST - 2.25, LANE)) == pytest.approx(0.3)


def test_only_a_coupled_bin_moves_sideways():
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


# Bodies near each other, the first two coupled, in a pen of four fences and a post.
CROWD = [
    ("bin", Pose(-2.25, 0, 0)),
    ("picker", Pose(0, 0, 0)),
    ("carrier", Pose(0, 2, 0)),
    ("tractor", Pose(0, -3, 0.3)),
    ("worker", Pose(2, 0, 3)),
    ("visitor", Pose(2, 1.5, -2)),
    ("dog", Pose(-2, 2, 1)),
    ("cat", Pose(3.3, 1.0, 0)),
    ("weed", Pose(0, 0, 0)),
]
PEN = [
    (-5.0, 0.0, 0.5, 6.0),
    (5.0, 0.0, 0.5, 6.0),
    (0.0, -6.0, 5.0, 0.5),
    (0.0, 5.0, 5.0, 0.5),
    (2.0, 3.0, 0.25, 0.25),
]
twist = st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.floats(-6, 6))


@settings(max_examples=60)
@given(st.lists(st.lists(twist, min_size=len(CROWD), max_size=len(CROWD)), min_size=1, max_size=4))
def test_no_two_solid_things_ever_overlap(courses):
    """`courses`: velocities of all bodies, each for 12 ticks. A weed is not solid."""
    world = world_of(*CROWD, walls=PEN)
    world.coupled[[0, 1]] = 1, 0
    assert [pair for pair in overlapping(world) if "weed_09" not in pair] == []
    for course in courses:
        for _ in range(12):
            step(world, np.array(course), [])
            assert [pair for pair in overlapping(world) if "weed_09" not in pair] == []


def test_what_is_in_the_way_stops_a_body_and_is_told_once():
    # 0.25 m ahead of the picker, which drives 0.1 m a tick: the third step meets it.
    fence = (PICKER_FRONT + 0.25 + 0.5, 0, 0.5, 3)
    wall = yard(("picker", Pose(0, 0, EAST)), walls=[fence])
    wall.drive(5, picker_01=AHEAD)
    assert wall.pose("picker_01").x == pytest.approx(0.2)
    assert not wall.of("twist", "picker_01").any()
    assert [(event.tick, event.who, event.whom) for event in wall.happened("collision")] == [
        (2, "picker_01", "")
    ]
    assert "fence" in wall.happened("collision")[0].detail
    wall.drive(1, picker_01=Twist(-1.0))
    wall.drive(3, picker_01=AHEAD)
    assert len(wall.happened("collision")) == collisions(wall.world) == 2


def test_a_body_may_drive_until_it_touches():
    tractor = Pose(PICKER_FRONT + TRACTOR_FRONT + 0.3, 0, EAST)
    touch = yard(("picker", Pose(0, 0, EAST)), ("tractor", tractor))
    touch.drive(3, picker_01=AHEAD)
    assert touch.pose("picker_01").x == pytest.approx(0.3)
    touch.drive(1, picker_01=AHEAD)
    assert touch.happened("collision")[0].whom == "tractor_02"


def test_robots_and_guests_are_counted_apart():
    touching = Pose(PICKER_FRONT + WORKER_FRONT, 0, EAST)
    both = yard(("picker", Pose(0, 0, EAST)), ("worker", touching))
    both.drive(2, picker_01=AHEAD, worker_02=Twist(-1.0))
    assert collisions(both.world) == 1
    assert collisions(both.world, PEOPLE + ANIMALS) == 1


def test_the_body_that_moves_first_gets_the_place():
    """The gap is 0.15 m, and both bodies want to move 0.1 m into it."""
    x_of_worker = PICKER_FRONT + WORKER_FRONT + 0.15
    race = yard(("picker", Pose(0, 0, EAST)), ("worker", Pose(x_of_worker, 0, EAST)))
    race.drive(1, picker_01=AHEAD, worker_02=Twist(-1.0))
    assert race.pose("picker_01").x == pytest.approx(0.1)
    assert race.pose("worker_02").x == x_of_worker


def test_a_turn_counts_the_whole_box():
    # A wall 1 cm beside the tractor: the tractor's corner would swing into it.
    beside = (0, TRACTOR_SIDE + 0.25 + 0.01, 3, 0.25)
    near = yard(("tractor", Pose(0, 0, EAST)), walls=[beside])
    near.drive(1, tractor_01=TURN_LEFT)
    assert near.pose("tractor_01").yaw == 0.0
    assert near.of("collisions", "tractor_01") == 1


@pytest.mark.parametrize("other", [("weed", Pose(1.5, 0, EAST)), ("bin", Pose(-2.25, 0, EAST))])
def test_a_weed_and_a_bin_that_is_not_coupled_hold_no_robot(other):
    over = yard(("picker", Pose(0, 0, EAST)), other)
    over.drive(30, picker_01=AHEAD)
    assert over.pose("picker_01").x == pytest.approx(3.0)


def test_a_robot_cannot_leave_its_bin_behind():
    """The bar lets it drive 0.3 m away from its bin: of ten steps of 0.1 m seven are refused.

    When the bin has come on by a step, four more steps with the bin are done.
    """
    held = picker_with_bin()
    held.drive(10, picker_01=AHEAD)
    assert held.pose("picker_01").x == pytest.approx(ROW_WEST + 0.3)
    assert held.of("refused", "picker_01") == 7
    assert held.of("collisions", "picker_01") == 0
    held.drive(1, bin_02=AHEAD)
    held.drive(4, **train(x=1.0))
    assert held.pose("picker_01").x == pytest.approx(ROW_WEST + 0.7)


def test_a_touching_robot_may_only_turn_away():
    # The outline of a carrier, as half its length and half its width, and a point 1 cm to its left,
    # near its front. A turn to the right, below 0, takes the front away from the point.
    boxes = [sense._Part(Pose(0.0, 0.0, 0.0), 0.9, 0.75)]
    touched = np.array([[0.8, 0.76]])
    assert not sense._swept(touched, boxes, -0.3)
    assert sense._swept(touched, boxes, 0.3)


@given(st.sampled_from(["picker", "carrier", "tractor"]), st.floats(-PI, PI), st.floats(-PI, PI))
def test_a_turn_sweeps_only_what_is_within_its_reach(name, angle, turn):
    """A point beyond the reach is swept by no turn. A point that lies within it, by three margins,
    and is clear of robot and bin, is swept by a full turn.

    `angle`: the direction of the point from the robot, rad.
    """
    kind = KINDS[name]
    boxes = [sense._Part(Pose(0.0, 0.0, 0.0), kind.length / 2, kind.width / 2)]
    if kind.tows:
        boxes.append(sense._Part(Pose(-kind.tows, 0.0, 0.0), 0.5, 0.5))
    reach = sense._reach(kind, bool(kind.tows))
    direction = np.array([[math.cos(angle), math.sin(angle)]])
    assert not sense._swept(reach * direction, boxes, turn)
    within = (reach - 3 * sense.TURN_MARGIN) * direction
    is_clear = all(
        sense._gaps(within[:, 0], within[:, 1], box) >= sense.TURN_MARGIN for box in boxes
    )
    if is_clear:
        assert sense._swept(within, boxes, 2.0 * PI)
