"""The conversion without ROS: rclpy and rosbags read each message as it was meant, and it says what
the Orchard said.
"""

import ast
import importlib
import math
import tomllib
from array import array
from pathlib import Path

import msgpack
import numpy
import pytest
from hypothesis import given
from hypothesis import strategies as st
from orchard_ros2 import wire
from orchard_ros2.plain import cdr, messages, topics
from orchard_ros2.plain.messages import Message
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)

ticks = st.integers(0, 10**9)
metres = st.floats(-1e6, 1e6)
near = st.floats(-1e3, 1e3)
speeds = st.floats(-100.0, 100.0)
yaws = st.floats(-math.pi, math.pi)


def states_within(places):
    parts = st.tuples(places, places, yaws, speeds, speeds, speeds)
    return parts.map(lambda s: (s[0], s[1], math.sin(s[2] / 2), math.cos(s[2] / 2), *s[3:]))


states, near_states = states_within(metres), states_within(near)
EAST = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)

EXAMPLES = [
    messages.clock(7),
    messages.odometry("picker_01", 7, (1.0, 2.0, 0.0, 1.0, 0.5, 0.0, 0.1)),
    messages.odometry("picker_01", 7, (1.0, 2.0, 0.0, 1.0, 0.5, 0.0, 0.1), "map"),
    messages.measured_pose(7, (1.0, 2.0, 0.0, 1.0, 0.5, 0.0, 0.1), 0.02),
    messages.velocity("picker_01", 7, 0.5, 0.1),
    messages.twist(0.5, 0.0, 0.1),
    messages.scan("picker_01", 7, array("f", [1.0, math.inf]), -1.0, 2.0, 0.0, 10.0),
    messages.battery_state("carrier_01", 7, 0.75),
    messages.transforms(7, {"picker_01": (1.0, 2.0, 0.0, 1.0, 0.5, 0.0, 0.1)}),
    messages.static_transforms([("picker_01", 1.25)]),
    messages.occupancy(array("b", [0, 100, 0, 0, 0, 100]), 3, 0.5, -1.0, -2.0),
    messages.text("<robot/>"),
]


def rclpy_type(name):
    package, _, kind = name.partition("/msg/")
    return getattr(importlib.import_module(f"{package}.msg"), kind)


def read(message):
    """What rosbags reads in a message's bytes."""
    return STORE.deserialize_cdr(cdr.encoded(message), message.type)


def fields_in(names):
    """Those that are no constants."""
    return [name for name in names if not name.startswith("__") and not name.isupper()]


def names_in(message):
    """The fields of a message and of those in it, and those of their types."""
    yield list(message.fields), fields_in(STORE.types[message.type].__dataclass_fields__)
    for value in message.fields.values():
        for inner in value if isinstance(value, list) else [value]:
            yield from names_in(inner) if isinstance(inner, Message) else ()


def plain(value):
    """A message that was read, or one of its fields, as numbers, texts and lists.

    Some numbers are float32.
    """
    if isinstance(value, float):
        return "nan" if math.isnan(value) else round(value, 6)
    if isinstance(value, array | numpy.ndarray):
        return value.tolist()
    if isinstance(value, list):
        return [plain(item) for item in value]
    fields = getattr(value, "__dataclass_fields__", {}) or getattr(value, "fields", {})
    of = (
        value.fields.__getitem__
        if isinstance(value, Message)
        else lambda name: getattr(value, name)
    )
    return {name: plain(of(name)) for name in fields_in(fields)} or value


@pytest.mark.parametrize("message", EXAMPLES, ids=lambda message: message.type)
def test_a_message_is_whole_in_a_bag(message):
    """Each field of each type is given, in its place, and what is read is what was meant."""
    assert all(given == wanted for given, wanted in names_in(message))
    assert plain(read(message)) == plain(message)
    assert bytes(STORE.serialize_cdr(read(message), message.type)) == cdr.encoded(message)


@pytest.mark.parametrize(
    "message",
    [m for m in EXAMPLES if not m.type.startswith("tf2_msgs")],
    ids=lambda message: message.type,
)
def test_rclpy_reads_what_a_bag_holds(message):
    received = deserialize_message(cdr.encoded(message), rclpy_type(message.type))
    assert plain(STORE.deserialize_cdr(serialize_message(received), message.type)) == plain(message)


@given(tick=ticks)
def test_a_stamp_is_the_ticks_time(tick):
    fields = messages.stamp(tick).fields
    assert fields["sec"] * 10**9 + fields["nanosec"] == tick * 10**8 and fields["nanosec"] < 10**9


def on_the_wire(tick, state, accuracy=0.0):
    """What the Orchard sends as `pose`, `odometry` or `truth`."""
    x, y, z, w, forward, left, turn = state
    turned, linear = {"x": 0.0, "y": 0.0, "z": z, "w": w}, {"x": forward, "y": left, "z": 0.0}
    place = {"position": {"x": x, "y": y, "z": 0.0}, "orientation": turned}
    sent = {
        "tick": tick,
        "pose": place,
        "twist": {"linear": linear, "angular": {"z": turn}},
        "accuracy": accuracy,
    }
    return msgpack.unpackb(msgpack.packb(sent))


@given(tick=ticks, state=states)
def test_odometry_and_the_transform_are_the_wires_pose(tick, state):
    pose = on_the_wire(tick, state)
    odometry = read(wire.odometry_of("picker_01", pose))
    (moved,) = read(messages.transforms(tick, {"picker_01": wire.state_of(pose)})).transforms
    position, orientation = odometry.pose.pose.position, odometry.pose.pose.orientation
    assert (position.x, position.y, orientation.z, orientation.w) == state[:4]
    assert (
        odometry.twist.twist.linear.x,
        odometry.twist.twist.linear.y,
        odometry.twist.twist.angular.z,
    ) == state[4:]
    assert (
        moved.transform.translation.x,
        moved.transform.translation.y,
        moved.transform.rotation.z,
        moved.transform.rotation.w,
    ) == state[:4]
    assert (moved.header.frame_id, moved.child_frame_id) == (
        odometry.header.frame_id,
        odometry.child_frame_id,
    )
    assert moved.header.stamp == odometry.header.stamp


@given(
    tick=ticks,
    ranges=st.lists(st.floats(0.0, 10.0, width=32) | st.just(math.inf), min_size=1, max_size=180),
)
def test_a_scan_keeps_each_range(tick, ranges):
    sent = {
        "tick": tick,
        "angle_min": 0.0,
        "angle_increment": 0.5,
        "range_max": 10.0,
        "ranges": array("f", ranges).tobytes(),
    }
    scan = read(wire.scan_of("bin_01", sent))
    assert scan.ranges.tolist() == ranges and scan.header.frame_id == "bin_01/laser"
    assert scan.angle_max == 0.5 * (len(ranges) - 1)


@given(tick=ticks, state=states, accuracy=st.sampled_from([0.0, 1e-6, 0.02, 0.5]))
def test_a_measured_pose_says_how_exact_it_is(tick, state, accuracy):
    """x and y are: the heading is exact, and so are the odometry and the truth."""
    wired = on_the_wire(tick, state, accuracy)
    measured, truth, odometry = (
        read(of("picker_01", wired))
        for of in (wire.measured_pose_of, wire.ground_truth_of, wire.odometry_of)
    )
    expected = numpy.diag([max(accuracy**2, 1e-6)] * 2 + [1e-6] * 4)
    assert (measured.pose.covariance.reshape(6, 6) == expected).all()
    for exact in (truth.pose, truth.twist, odometry.pose, odometry.twist):
        assert (exact.covariance.reshape(6, 6) == 1e-6 * numpy.eye(6)).all()
    assert (measured.header, measured.pose.pose) == (truth.header, truth.pose.pose)
    assert truth.header.frame_id == topics.MAP and (truth.child_frame_id, truth.twist.twist) == (
        odometry.child_frame_id,
        odometry.twist.twist,
    )


def place_of(link):
    turned, moved = link.transform.rotation, link.transform.translation
    return moved.x, moved.y, 2.0 * math.atan2(turned.z, turned.w)


@given(pose=near_states, odometry=near_states)
def test_the_chain_of_frames_ends_at_the_measured_pose(pose, odometry):
    """map -> NAME/odom -> NAME/base_link is pose * odometry^-1 * odometry."""
    reckoned, drift = read(
        messages.transforms(7, {"picker_01": odometry}, {"picker_01": pose})
    ).transforms
    assert (drift.header.frame_id, drift.child_frame_id) == (
        "map",
        "picker_01/odom",
    ) and drift.header.stamp == reckoned.header.stamp
    (x, y, yaw), (ahead, left, turn) = place_of(drift), place_of(reckoned)
    assert x + math.cos(yaw) * ahead - math.sin(yaw) * left == pytest.approx(pose[0], abs=1e-9)
    assert y + math.sin(yaw) * ahead + math.cos(yaw) * left == pytest.approx(pose[1], abs=1e-9)
    off = yaw + turn - 2.0 * math.atan2(pose[2], pose[3])
    assert abs(math.remainder(off, math.tau)) < 1e-9


@given(state=states)
def test_a_frame_of_exact_odometry_lies_on_map(state):
    x, y, z, w = messages.odom_in_map(state, state)
    assert (x, y, z) == pytest.approx((0.0, 0.0, 0.0), abs=1e-8) and w == pytest.approx(1.0)


NONE = {
    "gnss": {"white": 0.0, "bias": 0.0, "bias_time": 300.0},
    "odometry": {"distance": 0.0, "heading": 0.0},
}


@pytest.mark.parametrize(
    "error", ["gnss white", "gnss bias", "odometry distance", "odometry heading"]
)
def test_any_error_of_a_sensor_counts(error):
    sensor, what = error.split()
    assert not wire.has_errors({"sensors": NONE})
    assert wire.has_errors({"sensors": NONE | {sensor: NONE[sensor] | {what: 0.001}}})


SCAN = {"angle_min": 0.0, "angle_increment": 0.5, "range_max": 10.0, "ranges": b""}


def test_only_what_is_needed_is_heard():
    assert list(wire.views_of(False, False)) == ["pose", "scan"]
    assert [*wire.views_of(True, False)] == ["pose", "scan", "odometry"] and [
        *wire.views_of(False, True)
    ] == ["pose", "scan", "truth"]
    for has_errors in (False, True):
        views = wire.views_of(has_errors, True).values()
        assert len({topic for topic, _ in views}) == len(views)
        assert all(
            of("picker_01", on_the_wire(7, EAST) | SCAN).type == topic.type for topic, of in views
        )


@pytest.mark.parametrize("drifting", [(), ("picker_01",), ("picker_01", "bin_01")])
def test_frames_make_one_tree_below_map(drifting):
    names = ["picker_01", "bin_01"]
    links = messages.static_transforms([(name, 1.0) for name in names], drifting).fields[
        "transforms"
    ]
    links += messages.transforms(
        3, dict.fromkeys(names, EAST), dict.fromkeys(drifting, EAST)
    ).fields["transforms"]
    parents = {
        link.fields["child_frame_id"]: link.fields["header"].fields["frame_id"] for link in links
    }
    assert len(parents) == len(links)
    for name in names:
        way = [topics.laser(name)]
        while way[-1] in parents:
            way.append(parents[way[-1]])
        assert way == [topics.laser(name), topics.base_link(name), topics.odom(name), topics.MAP]


def test_nothing_of_the_orchard_is_imported():
    """The distribution lives from keyspace.md: its numpy and the Orchard's need not agree.

    `bags/` is only in the Orchard's own wheel.
    """
    folder = Path(__file__).parent.parent
    packages = tomllib.loads((folder / "pyproject.toml").read_text())["tool"]["setuptools"][
        "packages"
    ]
    for file in [
        file for package in packages for file in (folder / package.replace(".", "/")).glob("*.py")
    ]:
        for node in ast.walk(ast.parse(file.read_text())):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not [name for name in names if name.split(".")[0] == "orchard"], file
