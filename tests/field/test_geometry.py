"""Headings, frames, quaternions; the boxes of the kernels against plain reckoning; and the
project's own sine, arc tangent, logarithm (`repeatable`), whose bits are equal on all machines.

Points are compared with points on the edges of boxes, so tolerances of metres are what lies between
two of these. All others are some units in the last place of a float64.
"""

import ast
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from orchard.field import repeatable
from orchard.field.geometry import (
    EAST,
    NORTH,
    SOUTH,
    WEST,
    Pose,
    Rect,
    angle_between,
    from_frame,
    nearest_heading,
    to_frame,
    yaw_of,
)
from orchard.sim.kernels import cache, jit
from orchard.sim.kernels.boxes import boxes_of, gap, overlap, place
from orchard.sim.kernels.grid import cell_of, grid_of
from orchard.sim.kernels.move import quaternions

metres = st.floats(-60.0, 60.0)
yaws = st.floats(-math.pi, math.pi, exclude_min=True)
poses = st.builds(Pose, metres, metres, yaws)
halves = st.floats(0.1, 3.0)
# (x, y, yaw, half length, half width) in m and rad. They are so near to each other that many meet.
boxes = st.tuples(st.floats(-4.0, 4.0), st.floats(-4.0, 4.0), yaws, halves, halves)


def box_of(x, y, yaw, half_length, half_width) -> np.ndarray:
    """Return a box as the kernels have it."""
    box = boxes_of(np.zeros((1, 2)), np.array([[half_length, half_width]]))
    place(np.array([[x, y, yaw]]), box)
    return box[0]


def edge_points(x, y, yaw, half_length, half_width) -> np.ndarray:
    """Return 41 points on each side of a box, (164, 2) m."""
    # From one end of a side to the other, and the side itself, as shares of half the box.
    t = np.linspace(-1.0, 1.0, 41)
    ones = np.ones_like(t)
    along = half_length * np.concatenate([t, t, ones, -ones])
    across = half_width * np.concatenate([ones, -ones, t, t])
    c, s = math.cos(yaw), math.sin(yaw)
    return np.column_stack([x + c * along - s * across, y + s * along + c * across])


def depth(points: np.ndarray, box: tuple) -> np.ndarray:
    """Return how far points, (n, 2) m, are outside of a box: (n,) m; negative inside.

    It is the greater one of the distances along and across the box.
    """
    x, y, yaw, half_length, half_width = box
    c, s = math.cos(yaw), math.sin(yaw)
    dx, dy = points[:, 0] - x, points[:, 1] - y
    return np.maximum(np.abs(c * dx + s * dy) - half_length, np.abs(c * dy - s * dx) - half_width)


@given(poses, metres, metres)
def test_into_a_frame_and_back_is_the_same_point(pose, x, y):
    assert from_frame(pose, *to_frame(pose, x, y)) == pytest.approx((x, y), abs=1e-12)


def test_north_is_ahead_and_west_left_of_a_robot_facing_north():
    assert from_frame(Pose(1.0, 2.0, NORTH), 3.0, 0.5) == pytest.approx((0.5, 5.0))


@given(yaws)
def test_a_yaw_survives_its_quaternion(yaw):
    z, w = quaternions(np.array([[0.0, 0.0, yaw]]))[0].tolist()
    assert abs(angle_between(yaw_of(z, w), yaw)) < 4e-15


@given(st.sampled_from([EAST, NORTH, WEST, SOUTH]), st.floats(-0.78, 0.78))
def test_the_nearest_heading_is_within_an_eighth_of_a_turn(heading, off):
    """An eighth of a turn is 0.785 rad."""
    names = {EAST: "EAST", NORTH: "NORTH", WEST: "WEST", SOUTH: "SOUTH"}
    assert nearest_heading(heading + off) == names[heading]


@pytest.mark.parametrize(
    ("start", "end", "turn"),
    [(EAST, NORTH, NORTH), (WEST, SOUTH, NORTH), (NORTH, WEST, NORTH), (SOUTH, WEST, SOUTH)],
)
def test_the_turn_between_neighbouring_headings_is_a_quarter(start, end, turn):
    assert angle_between(start, end) == pytest.approx(turn, abs=1e-15)


def test_a_rect_contains_its_edges():
    rect = Rect(0.0, 0.0, 2.0, 1.0)
    assert rect.contains(0.0, 1.0)
    assert rect.contains(2.0, 0.0)
    assert not rect.contains(2.001, 0.5)
    assert not rect.contains(1.0, -0.001)


@settings(max_examples=300)
@given(boxes, boxes)
def test_boxes_overlap_where_an_edge_lies_in_the_other(a, b):
    # How far the points of both edges are outside of the other box, at least; negative: inside.
    outside = min(depth(edge_points(*a), b).min(), depth(edge_points(*b), a).min())
    is_inside = outside < -1e-6
    is_apart = outside > 0.2 or gap(box_of(*a), box_of(*b)) > 1e-6
    # Where boxes barely overlap, a corner may lie between two points of an edge, at most 0.2 m
    # apart: then the points say nothing.
    assume(is_inside or is_apart)
    assert overlap(box_of(*a), box_of(*b)) == (outside < 0.0)
    assert overlap(box_of(*b), box_of(*a)) == (outside < 0.0)


@settings(max_examples=300)
@given(boxes, boxes)
def test_the_gap_is_the_shortest_way_between_two_edges(a, b):
    # (points of a, points of b, 2), m.
    between = edge_points(*a)[:, None, :] - edge_points(*b)[None, :, :]
    shortest = np.sqrt((between**2).sum(axis=2)).min()
    width = gap(box_of(*a), box_of(*b))
    if overlap(box_of(*a), box_of(*b)):
        assert width == 0.0
    else:
        assert width <= shortest + 1e-9
        # 0.08 m: half of what lies between two points of an edge of 6 m.
        assert width >= shortest - 0.08


def test_boxes_side_by_side_touch_and_do_not_overlap():
    """What overlaps by 1 nm or less only touches: rounding must make no collision."""
    assert not overlap(box_of(0, 0, 0, 1, 1), box_of(2, 0, 0, 1, 1))
    assert not overlap(box_of(0, 0, 0, 1, 1), box_of(2 - 0.9e-9, 0.5, math.pi / 2, 1, 1))
    assert overlap(box_of(0, 0, 0, 1, 1), box_of(2 - 1.1e-9, 0.5, 0, 1, 1))


@given(
    st.lists(st.tuples(metres, metres, halves, halves), min_size=1, max_size=12),
    metres,
    metres,
    st.floats(0.5, 12.0),
)
def test_the_grid_forgets_no_wall_within_reach(walls, x, y, reach):
    walls = np.array(walls)
    grid = grid_of(boxes_of(walls[:, :2], walls[:, 2:]), reach)
    cell = cell_of(grid, x, y)
    away = np.maximum(np.abs(walls[:, :2] - [x, y]) - walls[:, 2:], 0.0)
    near = np.flatnonzero((away**2).sum(axis=1) <= reach**2)
    assert set(near) <= set(grid.members[grid.begin[cell] : grid.begin[cell + 1]])


ROOT = Path(__file__).parents[2]
# Of results around 1: two units in the last place.
ERROR = 4e-16
# Functions of numpy and math whose last bits differ between processors or libraries.
NOT_REPEATABLE = {"sin", "cos", "tan", "arctan2", "arctan", "hypot", "exp", "log", "power"}
NOT_REPEATABLE |= {"dot", "matmul"}
angles = st.one_of(
    st.floats(-10.0, 10.0),
    st.floats(-6000.0, 6000.0),
    st.integers(-40, 40).map(lambda eighth: eighth * math.pi / 8),
)
lengths = st.one_of(st.floats(-100.0, 100.0), st.floats(-1e-6, 1e-6), st.integers(-3, 3).map(float))


@settings(max_examples=500)
@given(angles, lengths, lengths, st.floats(1e-300, 1e300), st.floats(-700.0, 700.0))
def test_the_functions_are_right_to_the_last_digits(angle, y, x, positive, power):
    assert repeatable.sin_cos(angle) == pytest.approx(
        (math.sin(angle), math.cos(angle)), abs=ERROR, rel=0
    )
    # Adding 0.0 makes 0.0 of -0.0.
    assert repeatable.atan2(y, x) == pytest.approx(
        math.atan2(y + 0.0, x + 0.0), abs=2 * ERROR, rel=0
    )
    assert repeatable.log(positive) == pytest.approx(math.log(positive), abs=ERROR, rel=ERROR)
    assert repeatable.exp(power) == pytest.approx(math.exp(power), rel=4 * ERROR, abs=0)


@settings(max_examples=300)
@given(angles, lengths, lengths, st.floats(1e-300, 1e300))
def test_compiled_and_plain_give_the_same_bits(angle, y, x, positive):
    assert jit.sin_cos(angle) == repeatable.sin_cos(angle)
    assert jit.atan2(y, x) == repeatable.atan2(y, x)
    assert jit.wrap(angle) == repeatable.wrap(angle)
    assert jit.log(positive) == repeatable.log(positive)


def test_east_is_exact():
    assert repeatable.sin_cos(0.0) == (0.0, 1.0)
    assert repeatable.atan2(0.0, 1.0) == 0.0
    assert repeatable.atan2(1.0, 0.0) == repeatable.QUARTER
    assert repeatable.atan2(0.0, -1.0) == repeatable.PI


@settings(max_examples=300)
@given(angles)
def test_wrapping_keeps_the_direction(angle):
    wrapped = repeatable.wrap(angle)
    assert -repeatable.PI < wrapped <= repeatable.PI
    assert math.cos(wrapped - angle) == pytest.approx(1.0, abs=1e-12)
    assert repeatable.wrap(wrapped) == wrapped
    if -repeatable.PI < angle <= repeatable.PI:
        assert wrapped == angle


def test_the_bits_that_every_machine_must_give():
    """A compiler or a processor that gives other bits is found out."""
    assert [part.hex() for part in repeatable.sin_cos(0.7)] == [
        "0x1.49d6e694619b8p-1",
        "0x1.87996529f9d93p-1",
    ]
    assert repeatable.atan2(-2.0, -0.3).hex() == "-0x1.b83d5c13f26b8p+0"


def test_what_a_kernel_is_made_from_is_all_told_to_the_cache():
    """Each module from which a kernel takes constants is a source of the cache: if it changes, the
    kernels are compiled anew. A kernel with old constants would move robots by old rules.
    """
    sources = {
        path.relative_to(ROOT).with_suffix("").as_posix().replace("/", ".")
        for path in cache._SOURCES
    }
    for path in (ROOT / "orchard/sim/kernels").glob("*.py"):
        imports = [
            node
            for node in ast.walk(ast.parse(path.read_text()))
            if isinstance(node, ast.ImportFrom)
        ]
        for node in imports:
            names = {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
            # `orchard.folders` only stores kernels.
            is_ours = node.module.startswith("orchard.") and node.module != "orchard.folders"
            assert not is_ours or names & sources, (path, node.module)


def test_kernels_use_no_other_trigonometry():
    for path in set((ROOT / "orchard/sim/kernels").glob("*.py")) - {Path(jit.__file__)}:
        called = {
            node.attr
            for node in ast.walk(ast.parse(path.read_text()))
            if isinstance(node, ast.Attribute)
        }
        assert not called & NOT_REPEATABLE, path
