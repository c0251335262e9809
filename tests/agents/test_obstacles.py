"""The obstacles of a body: walls, other bodies, and the bar to its bin."""

import math

import numpy as np
import pytest
from bare_world import AHEAD, TURN_LEFT, overlapping, picker_with_bin, train, yard
from hypothesis import given, settings
from hypothesis import strategies as st
from raycaster import world_of

from orchard.agents import sense
from orchard.field.geometry import EAST, Pose, Twist
from orchard.field.kinds import ANIMALS, KINDS, PEOPLE
from orchard.field.layout import ROW_WEST
from orchard.field.repeatable import PI
from orchard.report.metrics import collisions
from orchard.sim.physics import step

CROWD = [
    ("bin", Pose(-2.25, 0, 0)), ("picker", Pose(0, 0, 0)), ("carrier", Pose(0, 2, 0)), ("tractor", Pose(0, -3, 0.3)),
    ("worker", Pose(2, 0, 3)), ("visitor", Pose(2, 1.5, -2)), ("dog", Pose(-2, 2, 1)), ("cat", Pose(3.3, 1.0, 0)), ("weed", Pose(0, 0, 0)),
]  # fmt: skip
PEN = [(-5.0, 0.0, 0.5, 6.0), (5.0, 0.0, 0.5, 6.0), (0.0, -6.0, 5.0, 0.5), (0.0, 5.0, 5.0, 0.5), (2.0, 3.0, 0.25, 0.25)]
twist = st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.floats(-6, 6))


@settings(max_examples=60)
@given(st.lists(st.lists(twist, min_size=len(CROWD), max_size=len(CROWD)), min_size=1, max_size=4))
def test_no_two_solid_things_ever_overlap(courses):
    world = world_of(*CROWD, walls=PEN)
    world.coupled[[0, 1]] = 1, 0
    assert [pair for pair in overlapping(world) if "weed_09" not in pair] == []
    for course in courses:
        for _ in range(12):
            step(world, np.array(course), [])
            assert [pair for pair in overlapping(world) if "weed_09" not in pair] == []


def test_what_is_in_the_way_stops_a_body_and_is_told_once():
    wall = yard(("picker", Pose(0, 0, EAST)), walls=[(1.25 + 0.25 + 0.5, 0, 0.5, 3)])
    wall.drive(5, picker_01=AHEAD)
    assert wall.pose("picker_01").x == pytest.approx(0.2)
    assert not wall.of("twist", "picker_01").any()
    assert [(event.tick, event.who, event.whom) for event in wall.told("collision")] == [(2, "picker_01", "")]
    assert "fence" in wall.told("collision")[0].detail
    wall.drive(1, picker_01=Twist(-1.0))
    wall.drive(3, picker_01=AHEAD)
    assert len(wall.told("collision")) == collisions(wall.world) == 2


def test_a_body_may_drive_until_it_touches():
    touch = yard(("picker", Pose(0, 0, EAST)), ("tractor", Pose(1.25 + 2.5 + 0.3, 0, EAST)))
    touch.drive(3, picker_01=AHEAD)
    assert touch.pose("picker_01").x == pytest.approx(0.3)
    touch.drive(1, picker_01=AHEAD)
    assert touch.told("collision")[0].whom == "tractor_02"


def test_robots_and_guests_are_counted_apart():
    both = yard(("picker", Pose(0, 0, EAST)), ("worker", Pose(1.25 + 0.275, 0, EAST)))
    both.drive(2, picker_01=AHEAD, worker_02=Twist(-1.0))
    assert (collisions(both.world), collisions(both.world, PEOPLE + ANIMALS)) == (1, 1)


def test_who_moves_first_gets_the_place():
    """The gap is 0.15 m, and both bodies want to move 0.1 m into it."""
    race = yard(("picker", Pose(0, 0, EAST)), ("worker", Pose(1.25 + 0.275 + 0.15, 0, EAST)))
    race.drive(1, picker_01=AHEAD, worker_02=Twist(-1.0))
    assert race.pose("picker_01").x == pytest.approx(0.1)
    assert race.pose("worker_02").x == 1.25 + 0.275 + 0.15


def test_a_turn_counts_the_whole_box():
    near = yard(("tractor", Pose(0, 0, EAST)), walls=[(0, 1.5 + 0.25 + 0.01, 3, 0.25)])
    near.drive(1, tractor_01=TURN_LEFT)
    assert near.pose("tractor_01").yaw == 0.0
    assert near.of("collisions", "tractor_01") == 1


def test_a_weed_stops_nobody():
    over = yard(("picker", Pose(0, 0, EAST)), ("weed", Pose(1.5, 0, EAST)))
    over.drive(30, picker_01=AHEAD)
    assert over.pose("picker_01").x == pytest.approx(3.0)


# -- the bar


def test_a_robot_cannot_leave_its_bin_behind():
    held = picker_with_bin()
    held.drive(10, picker_01=AHEAD)
    assert held.pose("picker_01").x == pytest.approx(ROW_WEST + 0.3)
    assert held.of("held", "picker_01") == 7
    assert held.of("collisions", "picker_01") == 0
    held.drive(1, bin_02=AHEAD)
    held.drive(4, **train(x=1.0))
    assert held.pose("picker_01").x == pytest.approx(ROW_WEST + 0.7)


def test_a_robot_that_touches_something_may_turn_away_from_it_but_not_towards_it():
    boxes = [(0.0, 0.9, 0.75)]
    touched = np.array([[0.8, 0.76]])  # on its left, near its front
    assert not sense._swept(touched, boxes, -0.3)
    assert sense._swept(touched, boxes, 0.3)


def test_without_a_bin_the_bar_holds_nobody():
    free = yard(("picker", Pose(0, 0, EAST)), ("bin", Pose(-2.25, 0, EAST)))
    free.drive(10, picker_01=AHEAD)
    assert free.pose("picker_01").x == pytest.approx(1.0)


@given(st.sampled_from(["picker", "carrier", "tractor"]), st.floats(-PI, PI), st.floats(-PI, PI))
def test_a_turn_sweeps_nothing_beyond_its_reach_but_nearly_all_within(name, angle, turn):
    kind = KINDS[name]
    boxes = [(0.0, kind.length / 2, kind.width / 2), *([(-kind.tows, 0.5, 0.5)] if kind.tows else [])]
    reach = sense._reach(kind, bool(kind.tows))
    for metres, may_be_swept in ((reach, False), (reach - 3 * sense.TURN_MARGIN, True)):
        points = np.array([[metres * math.cos(angle), metres * math.sin(angle)]])
        assert may_be_swept or not sense._swept(points, boxes, turn)
        is_clear = all(sense._gaps(points[:, 0], np.abs(points[:, 1]), box) >= sense.TURN_MARGIN for box in boxes)
        assert not (may_be_swept and is_clear) or sense._swept(points, boxes, 2.0 * PI)
