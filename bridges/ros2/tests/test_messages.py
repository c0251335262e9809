"""The messages that the bridge writes without ROS.

rclpy and rosbags, which the bridge does not use for writing, read each message as it was meant,
and a message says what the Orchard said. An Orchard message counts time in ticks of 0.1 s.

A state here is what `orchard_ros2.plain` calls one: x and y in m, z and w of the quaternion of
the heading, then the speeds forward and to the left in m/s and the turning in rad/s.
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
# Small enough that float64 keeps a nanometre after two frames are chained.
near_metres = st.floats(-1e3, 1e3)
speeds = st.floats(-100.0, 100.0)  # in m/s, and in rad/s for the turning
yaws = st.floats(-math.pi, math.pi)


def state_with_yaw(x, y, yaw, forward, left, turning):
    return (x, y, math.sin(yaw / 2), math.cos(yaw / 2), forward, left, turning)


def states_within(places):
    """Random states whose x and y are drawn from `places`."""
    return st.builds(state_with_yaw, places, places, yaws, speeds, speeds, speeds)


states = states_within(metres)
near_states = states_within(near_metres)

# The state of a robot that stands at the origin and faces east.
EAST = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
# The state of a robot that drives and turns.
MOVING = (1.0, 2.0, 0.0, 1.0, 0.5, 0.0, 0.1)

EXAMPLES = [
    messages.clock(7),
    messages.odometry("picker_01", 7, MOVING),
    messages.odometry("picker_01", 7, MOVING, "map"),
    messages.measured_pose(7, MOVING, 0.02),
    messages.velocity("picker_01", 7, 0.5, 0.1),
    messages.twist(0.5, 0.0, 0.1),
    messages.scan("picker_01", 7, array("f", [1.0, math.inf]), -1.0, 2.0, 0.0, 10.0),
    messages.battery_state("carrier_01", 7, 0.75),
    messages.transforms(7, {"picker_01": MOVING}),
    messages.static_transforms([("picker_01", 1.25)]),
    messages.occupancy(array("b", [0, 100, 0, 0, 0, 100]), 3, 0.5, -1.0, -2.0),
    messages.text("<robot/>"),
]


def rclpy_type(name):
    """The class of rclpy for a type such as `nav_msgs/msg/Odometry`."""
    package, _, kind = name.partition("/msg/")
    return getattr(importlib.import_module(f"{package}.msg"), kind)


def read(message):
    """What rosbags reads in a message's bytes."""
    return STORE.deserialize_cdr(cdr.encoded(message), message.type)


def fields_in(names):
    """The names of fields among the names of a generated class: its constants are left out."""
    return [name for name in names if not name.startswith("__") and not name.isupper()]


def names_in(message):
    """Pairs of lists of field names, for a message and for each message within it.

    The first list has the fields that are given, the second those that the type has.
    """
    yield list(message.fields), fields_in(STORE.types[message.type].__dataclass_fields__)
    for value in message.fields.values():
        for inner in value if isinstance(value, list) else [value]:
            if isinstance(inner, Message):
                yield from names_in(inner)


def plain(value):
    """A message that was read, or one of its fields, as numbers, texts and lists.

    Some fields are float32, so numbers are rounded; a nan equals nothing, so it becomes a text.
    """
    if isinstance(value, float):
        return "nan" if math.isnan(value) else round(value, 6)
    if isinstance(value, array | numpy.ndarray):
        return value.tolist()
    if isinstance(value, list):
        return [plain(item) for item in value]
    if isinstance(value, Message):
        fields = value.fields
    else:
        names = getattr(value, "__dataclass_fields__", {})
        fields = {name: getattr(value, name) for name in fields_in(names)}
    return {name: plain(field) for name, field in fields.items()} or value


@pytest.mark.parametrize("message", EXAMPLES, ids=lambda message: message.type)
def test_a_message_is_whole_in_a_bag(message):
    """Each field of each type is given, in its place, and what is read is what was meant."""
    for names_given, names_of_type in names_in(message):
        assert names_given == names_of_type
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
    nanoseconds_in_a_tick = 10**8
    fields = messages.stamp(tick).fields
    assert fields["nanosec"] < 10**9
    assert fields["sec"] * 10**9 + fields["nanosec"] == tick * nanoseconds_in_a_tick


def on_the_wire(tick, state, accuracy=0.0):
    """What the Orchard sends as `pose`, `odometry` or `truth`."""
    x, y, z, w, forward, left, turning = state
    sent = {
        "tick": tick,
        "pose": {
            "position": {"x": x, "y": y, "z": 0.0},
            "orientation": {"x": 0.0, "y": 0.0, "z": z, "w": w},
        },
        "twist": {
            "linear": {"x": forward, "y": left, "z": 0.0},
            "angular": {"z": turning},
        },
        "accuracy": accuracy,
    }
    return msgpack.unpackb(msgpack.packb(sent))


@given(tick=ticks, state=states)
def test_odometry_and_the_transform_are_the_wires_pose(tick, state):
    pose = on_the_wire(tick, state)
    odometry = read(wire.odometry_of("picker_01", pose))
    (moved,) = read(messages.transforms(tick, {"picker_01": wire.state_of(pose)})).transforms
    x, y, z, w, forward, left, turning = state
    position = odometry.pose.pose.position
    orientation = odometry.pose.pose.orientation
    linear = odometry.twist.twist.linear
    assert (position.x, position.y, orientation.z, orientation.w) == (x, y, z, w)
    assert (linear.x, linear.y, odometry.twist.twist.angular.z) == (forward, left, turning)
    translation = moved.transform.translation
    rotation = moved.transform.rotation
    assert (translation.x, translation.y, rotation.z, rotation.w) == (x, y, z, w)
    assert moved.header == odometry.header
    assert moved.child_frame_id == odometry.child_frame_id


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
    """Only x and y have an error: the heading, the odometry and the truth are exact.

    What is exact has a variance of 1e-6 and not 0, since filters of ROS divide by it.
    """
    sent = on_the_wire(tick, state, accuracy)
    measured = read(wire.measured_pose_of("picker_01", sent))
    truth = read(wire.ground_truth_of("picker_01", sent))
    odometry = read(wire.odometry_of("picker_01", sent))
    expected = numpy.diag([max(accuracy**2, 1e-6)] * 2 + [1e-6] * 4)
    assert (measured.pose.covariance.reshape(6, 6) == expected).all()
    for exact in (truth.pose, truth.twist, odometry.pose, odometry.twist):
        assert (exact.covariance.reshape(6, 6) == 1e-6 * numpy.eye(6)).all()
    assert measured.header == truth.header
    assert measured.pose.pose == truth.pose.pose
    assert truth.header.frame_id == topics.MAP
    assert truth.child_frame_id == odometry.child_frame_id
    assert truth.twist.twist == odometry.twist.twist


def place_of(link):
    """Where a transform puts its child frame: x and y in m, and the yaw in rad."""
    moved = link.transform.translation
    turned = link.transform.rotation
    return moved.x, moved.y, 2.0 * math.atan2(turned.z, turned.w)


@given(pose=near_states, odometry=near_states)
def test_the_chain_of_frames_ends_at_the_measured_pose(pose, odometry):
    """Where odometry drifts, map -> NAME/odom takes the drift out again.

    map -> NAME/odom is pose * odometry^-1, and NAME/odom -> NAME/base_link is the odometry.
    """
    sent = messages.transforms(7, {"picker_01": odometry}, {"picker_01": pose})
    reckoned, drift = read(sent).transforms
    assert (drift.header.frame_id, drift.child_frame_id) == ("map", "picker_01/odom")
    assert drift.header.stamp == reckoned.header.stamp
    x, y, yaw = place_of(drift)
    ahead, left, turn = place_of(reckoned)
    assert x + math.cos(yaw) * ahead - math.sin(yaw) * left == pytest.approx(pose[0], abs=1e-9)
    assert y + math.sin(yaw) * ahead + math.cos(yaw) * left == pytest.approx(pose[1], abs=1e-9)
    off = yaw + turn - 2.0 * math.atan2(pose[2], pose[3])
    assert abs(math.remainder(off, math.tau)) < 1e-9


@given(state=states)
def test_a_frame_of_exact_odometry_lies_on_map(state):
    x, y, z, w = messages.odom_in_map(state, state)
    assert (x, y, z) == pytest.approx((0.0, 0.0, 0.0), abs=1e-8) and w == pytest.approx(1.0)


# The errors of the sensors of a run without errors, as its layout tells them.
NO_ERRORS = {
    "gnss": {"white": 0.0, "bias": 0.0, "bias_time": 300.0},
    "odometry": {"distance": 0.0, "heading": 0.0},
}


@pytest.mark.parametrize(
    "error", ["gnss white", "gnss bias", "odometry distance", "odometry heading"]
)
def test_any_error_of_a_sensor_counts(error):
    sensor, name = error.split()
    assert not wire.has_errors({"sensors": NO_ERRORS})
    with_one = NO_ERRORS | {sensor: NO_ERRORS[sensor] | {name: 0.001}}
    assert wire.has_errors({"sensors": with_one})


# The fields of a scan on the wire, but for its tick.
SCAN = {"angle_min": 0.0, "angle_increment": 0.5, "range_max": 10.0, "ranges": b""}


def test_only_what_is_needed_is_heard():
    assert list(wire.views_of(False, False)) == ["pose", "scan"]
    assert list(wire.views_of(True, False)) == ["pose", "scan", "odometry"]
    assert list(wire.views_of(False, True)) == ["pose", "scan", "truth"]
    sent = on_the_wire(7, EAST) | SCAN
    for has_errors in (False, True):
        views = wire.views_of(has_errors, True).values()
        assert len({topic for topic, _ in views}) == len(views)
        for topic, message_of in views:
            assert message_of("picker_01", sent).type == topic.type


@pytest.mark.parametrize("drifting", [(), ("picker_01",), ("picker_01", "bin_01")])
def test_frames_make_one_tree_below_map(drifting):
    """Each frame has one parent, whether the odometry of all, of some or of no robot drifts."""
    names = ["picker_01", "bin_01"]
    static = messages.static_transforms([(name, 1.0) for name in names], drifting)
    moving = messages.transforms(3, dict.fromkeys(names, EAST), dict.fromkeys(drifting, EAST))
    links = static.fields["transforms"] + moving.fields["transforms"]
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
    project = tomllib.loads((folder / "pyproject.toml").read_text())
    packages = project["tool"]["setuptools"]["packages"]
    for package in packages:
        for file in (folder / package.replace(".", "/")).glob("*.py"):
            for name in imported_by(file):
                assert name.split(".")[0] != "orchard", file


def imported_by(file):
    """The modules that a Python file imports."""
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        if isinstance(node, ast.ImportFrom):
            yield node.module or ""
