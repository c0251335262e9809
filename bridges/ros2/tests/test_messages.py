"""The conversion without ROS: each message can be built by rclpy's classes and by rosbags', and says what the Orchard said."""

import ast
import importlib
import math
from array import array
from pathlib import Path

import msgpack
import numpy
import pytest
from hypothesis import given
from hypothesis import strategies as st
from orchard_ros2 import messages, topics, wire
from rclpy.serialization import serialize_message
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)
PACKAGE = Path(messages.__file__).parent

ticks = st.integers(0, 10**9)
metres = st.floats(-1e6, 1e6)
speeds = st.floats(-100.0, 100.0)
yaws = st.floats(-math.pi, math.pi)
states = st.tuples(metres, metres, yaws, speeds, speeds, speeds).map(lambda s: (s[0], s[1], math.sin(s[2] / 2), math.cos(s[2] / 2), *s[3:]))

EXAMPLES = [
    messages.clock(7),
    messages.odometry("picker_01", 7, (1.0, 2.0, 0.0, 1.0, 0.5, 0.0, 0.1)),
    messages.velocity("picker_01", 7, 0.5, 0.1),
    messages.twist(0.5, 0.0, 0.1),
    messages.scan("picker_01", 7, array("f", [1.0, math.inf]), -1.0, 2.0, 0.0, 10.0),
    messages.transforms(7, {"picker_01": (1.0, 2.0, 0.0, 1.0, 0.5, 0.0, 0.1)}),
    messages.static_transforms([("picker_01", 1.25)]),
    messages.occupancy(array("b", [0, 100, 0, 0, 0, 100]), 3, 0.5, -1.0, -2.0),
    messages.text("<robot/>"),
]


def rclpy_type(name):
    package, _, kind = name.partition("/msg/")
    return getattr(importlib.import_module(f"{package}.msg"), kind)


def in_bag(message):
    return messages.build(message, STORE.types.__getitem__, numpy.asarray)


@pytest.mark.parametrize("message", EXAMPLES, ids=lambda message: message.type)
def test_a_message_is_whole_in_a_bag(message):
    """Each field of the type is given, and what is read back is what was written."""
    written = in_bag(message)
    assert set(message.fields) == {name for name in written.__dataclass_fields__ if not name.startswith("__")}
    data = bytes(STORE.serialize_cdr(written, message.type))
    assert bytes(STORE.serialize_cdr(STORE.deserialize_cdr(data, message.type), message.type)) == data


@pytest.mark.parametrize("message", [m for m in EXAMPLES if not m.type.startswith("tf2_msgs")], ids=lambda message: message.type)
def test_rclpy_sends_what_a_bag_holds(message):
    sent = STORE.deserialize_cdr(serialize_message(messages.build(message, rclpy_type)), message.type)
    assert bytes(STORE.serialize_cdr(sent, message.type)) == bytes(STORE.serialize_cdr(in_bag(message), message.type))


@given(tick=ticks)
def test_a_stamp_is_the_ticks_time(tick):
    fields = messages.stamp(tick).fields
    assert fields["sec"] * 10**9 + fields["nanosec"] == tick * 10**8 and fields["nanosec"] < 10**9


@given(tick=ticks, state=states)
def test_odometry_and_the_transform_are_the_wires_pose(tick, state):
    x, y, z, w, forward, left, turn = state
    turned, linear = {"x": 0.0, "y": 0.0, "z": z, "w": w}, {"x": forward, "y": left, "z": 0.0}
    sent = {
        "tick": tick,
        "pose": {"position": {"x": x, "y": y, "z": 0.0}, "orientation": turned},
        "twist": {"linear": linear, "angular": {"z": turn}},
    }
    pose = msgpack.unpackb(msgpack.packb(sent))
    odometry = in_bag(wire.odometry_of("picker_01", pose))
    (moved,) = in_bag(messages.transforms(tick, {"picker_01": wire.state_of(pose)})).transforms
    position, orientation = odometry.pose.pose.position, odometry.pose.pose.orientation
    assert (position.x, position.y, orientation.z, orientation.w) == state[:4]
    assert (odometry.twist.twist.linear.x, odometry.twist.twist.linear.y, odometry.twist.twist.angular.z) == state[4:]
    assert (moved.transform.translation.x, moved.transform.translation.y, moved.transform.rotation.z, moved.transform.rotation.w) == state[
        :4
    ]
    assert (moved.header.frame_id, moved.child_frame_id) == (odometry.header.frame_id, odometry.child_frame_id)
    assert moved.header.stamp == odometry.header.stamp


@given(tick=ticks, ranges=st.lists(st.floats(0.0, 10.0, width=32) | st.just(math.inf), min_size=1, max_size=180))
def test_a_scan_keeps_each_range(tick, ranges):
    sent = {"tick": tick, "angle_min": 0.0, "angle_increment": 0.5, "range_max": 10.0, "ranges": array("f", ranges).tobytes()}
    scan = in_bag(wire.scan_of("bin_01", sent))
    assert scan.ranges.tolist() == ranges and scan.header.frame_id == "bin_01/laser"
    assert scan.angle_max == 0.5 * (len(ranges) - 1)


def test_a_covariance_has_variances_on_its_diagonal_only():
    matrix = numpy.asarray(messages.covariance(4.0)).reshape(6, 6)
    assert (matrix == 4.0 * numpy.eye(6)).all()


def test_frames_make_one_tree_below_map():
    names = ["picker_01", "bin_01"]
    links = messages.static_transforms([(name, 1.0) for name in names]).fields["transforms"]
    links += messages.transforms(3, dict.fromkeys(names, (0.0,) * 7)).fields["transforms"]
    parents = {link.fields["child_frame_id"]: link.fields["header"].fields["frame_id"] for link in links}
    assert len(parents) == len(links)
    for name in names:
        way = [topics.laser(name)]
        while way[-1] in parents:
            way.append(parents[way[-1]])
        assert way == [topics.laser(name), topics.base_link(name), topics.odom(name), topics.MAP]


def test_nothing_of_the_orchard_is_imported():
    """It lives from keyspace.md: a distribution's numpy and the Orchard's need not agree."""
    for file in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not [name for name in names if name.split(".")[0] == "orchard"], file
