"""Headings, frames, quaternions; and the boxes of the kernels against plain reckoning."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from orchard.field.geometry import EAST, NORTH, SOUTH, WEST, Pose, Rect, angle_between, from_frame, nearest_heading, to_frame, yaw_of
from orchard.sim.kernels.boxes import boxes_of, gap, overlap, place
from orchard.sim.kernels.grid import cell_of, grid_of
from orchard.sim.kernels.move import quaternions

metres = st.floats(-60.0, 60.0)
yaws = st.floats(-math.pi, math.pi, exclude_min=True)
poses = st.builds(Pose, metres, metres, yaws)
halves = st.floats(0.1, 3.0)
boxes = st.tuples(st.floats(-4.0, 4.0), st.floats(-4.0, 4.0), yaws, halves, halves)


def box_of(x, y, yaw, half_length, half_width) -> np.ndarray:
    box = boxes_of(np.zeros((1, 2)), np.array([[half_length, half_width]]))
    place(np.array([[x, y, yaw]]), box)
    return box[0]


def edge_points(x, y, yaw, half_length, half_width) -> np.ndarray:
    """Points all along a box's edge, its corners among them."""
    t = np.linspace(-1.0, 1.0, 41)
    one = np.ones_like(t)
    along = half_length * np.concatenate([t, t, one, -one])
    across = half_width * np.concatenate([one, -one, t, t])
    c, s = math.cos(yaw), math.sin(yaw)
    return np.column_stack([x + c * along - s * across, y + s * along + c * across])


def depth(points: np.ndarray, box: tuple) -> np.ndarray:
    """How far outside of a box points are along its worse axis; negative inside."""
    x, y, yaw, half_length, half_width = box
    c, s = math.cos(yaw), math.sin(yaw)
    dx, dy = points[:, 0] - x, points[:, 1] - y
    return np.maximum(np.abs(c * dx + s * dy) - half_length, np.abs(c * dy - s * dx) - half_width)


@given(poses, metres, metres)
def test_into_a_frame_and_back_is_the_same_point(pose, x, y):
    assert from_frame(pose, *to_frame(pose, x, y)) == pytest.approx((x, y), abs=1e-12)


def test_ahead_of_one_who_faces_north_lies_north_and_its_left_west():
    assert from_frame(Pose(1.0, 2.0, NORTH), 3.0, 0.5) == pytest.approx((0.5, 5.0))


@given(yaws)
def test_a_yaw_survives_its_quaternion(yaw):
    z, w = quaternions(np.array([[0.0, 0.0, yaw]]))[0].tolist()
    assert abs(angle_between(yaw_of(z, w), yaw)) < 1e-15 * 4


@given(st.sampled_from([EAST, NORTH, WEST, SOUTH]), st.floats(-0.78, 0.78))
def test_the_nearest_heading_is_within_an_eighth_of_a_turn(heading, off):
    names = {EAST: "EAST", NORTH: "NORTH", WEST: "WEST", SOUTH: "SOUTH"}
    assert nearest_heading(heading + off) == names[heading]


@pytest.mark.parametrize(("start", "end", "turn"), [(EAST, NORTH, NORTH), (WEST, SOUTH, NORTH), (NORTH, WEST, NORTH), (SOUTH, WEST, SOUTH)])
def test_the_turn_between_neighbouring_headings_is_a_quarter(start, end, turn):
    assert angle_between(start, end) == pytest.approx(turn, abs=1e-15)


def test_a_rect_contains_its_edges():
    rect = Rect(0.0, 0.0, 2.0, 1.0)
    assert rect.contains(0.0, 1.0) and rect.contains(2.0, 0.0)
    assert not rect.contains(2.001, 0.5) and not rect.contains(1.0, -0.001)


@settings(max_examples=300)
@given(boxes, boxes)
def test_boxes_overlap_just_where_a_point_of_one_edge_lies_in_the_other(a, b):
    inside = min(depth(edge_points(*a), b).min(), depth(edge_points(*b), a).min())
    assume(inside < -1e-6 or gap(box_of(*a), box_of(*b)) > 1e-6 or inside > 0.2)
    assert overlap(box_of(*a), box_of(*b)) == (inside < 0.0)
    assert overlap(box_of(*b), box_of(*a)) == (inside < 0.0)


@settings(max_examples=300)
@given(boxes, boxes)
def test_the_gap_is_the_shortest_way_between_two_edges(a, b):
    between = edge_points(*a)[:, None, :] - edge_points(*b)[None, :, :]
    shortest = np.sqrt((between**2).sum(axis=2)).min()
    found = gap(box_of(*a), box_of(*b))
    if overlap(box_of(*a), box_of(*b)):
        assert found == 0.0
    else:
        assert found <= shortest + 1e-9
        assert found >= shortest - 0.08  # half of what lies between two points of an edge of 6 m


def test_boxes_side_by_side_touch_and_do_not_overlap():
    assert not overlap(box_of(0, 0, 0, 1, 1), box_of(2, 0, 0, 1, 1))
    assert not overlap(box_of(0, 0, 0, 1, 1), box_of(2 - 0.9e-9, 0.5, math.pi / 2, 1, 1))
    assert overlap(box_of(0, 0, 0, 1, 1), box_of(2 - 1.1e-9, 0.5, 0, 1, 1))


@settings(max_examples=100)
@given(st.lists(st.tuples(metres, metres, halves, halves), min_size=1, max_size=12), metres, metres, st.floats(0.5, 12.0))
def test_the_grid_forgets_no_wall_within_reach(walls, x, y, reach):
    walls = np.array(walls)
    grid = grid_of(boxes_of(walls[:, :2], walls[:, 2:]), reach)
    cell = cell_of(grid, x, y)
    away = np.maximum(np.abs(walls[:, :2] - [x, y]) - walls[:, 2:], 0.0)
    near = np.flatnonzero((away**2).sum(axis=1) <= reach**2)
    assert set(near) <= set(grid.members[grid.begin[cell] : grid.begin[cell + 1]])
