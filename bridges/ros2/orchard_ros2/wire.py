"""What the Orchard sends, unpacked from msgpack, as the parts of a ROS 2 message.

Fields: keyspace.md.
"""

import sys
from array import array
from collections.abc import Callable, Mapping
from typing import Any

from orchard_ros2.plain import messages, topics
from orchard_ros2.plain.messages import Message
from orchard_ros2.plain.topics import Topic

State = tuple[float, float, float, float, float, float, float]
View = tuple[Topic, Callable[[str, Mapping[str, Any]], Message]]


def state_of(pose: Mapping[str, Any]) -> State:
    """Return the state of a body from its `pose`, `odometry` or `truth`: see `messages`."""
    position = pose["pose"]["position"]
    orientation = pose["pose"]["orientation"]
    linear = pose["twist"]["linear"]
    angular = pose["twist"]["angular"]
    return (
        float(position["x"]),
        float(position["y"]),
        float(orientation["z"]),
        float(orientation["w"]),
        float(linear["x"]),
        float(linear.get("y", 0.0)),
        float(angular["z"]),
    )


def ranges_of(raw: bytes) -> "array[float]":
    """Return the ranges of a scan, m: they are little-endian float32 on the wire."""
    ranges = array("f", raw)
    if sys.byteorder == "big":
        ranges.byteswap()
    return ranges


def scan_of(robot: str, scan: Mapping[str, Any]) -> Message:
    """Return the `sensor_msgs/msg/LaserScan` of a `scan`."""
    return messages.scan(
        robot,
        scan["tick"],
        ranges_of(scan["ranges"]),
        angle_min=float(scan["angle_min"]),
        angle_increment=float(scan["angle_increment"]),
        range_min=float(scan.get("range_min", 0.0)),
        range_max=float(scan["range_max"]),
    )


def battery_state_of(robot: str, pose: Mapping[str, Any]) -> Message:
    """Return the `sensor_msgs/msg/BatteryState` of a `pose`."""
    return messages.battery_state(robot, pose["tick"], float(pose["percentage"]))


def has_batteries(scenario: Mapping[str, Any]) -> bool:
    """Return whether carriers of a scenario have batteries."""
    return scenario["carrying"]["battery"]["hours"] is not None


def has_errors(scenario: Mapping[str, Any]) -> bool:
    """Return whether robots of a scenario measure where they are with errors."""
    gnss = scenario["sensors"]["gnss"]
    odometry = scenario["sensors"]["odometry"]
    return any((gnss["white"], gnss["bias"], odometry["distance"], odometry["heading"]))


def views_of(has_errors: bool, shows_truth: bool) -> dict[str, View]:
    """Return what ROS sees of a body: the Orchard's key -> the topic, and what makes its messages.

    Exact poses are odometry too.
    """
    views: dict[str, View] = {"pose": (topics.ODOM, odometry_of), "scan": (topics.SCAN, scan_of)}
    if has_errors:
        views["pose"] = (topics.POSE, measured_pose_of)
        views["odometry"] = (topics.ODOM, odometry_of)
    if shows_truth:
        views["truth"] = (topics.GROUND_TRUTH, ground_truth_of)
    return views


def odometry_of(robot: str, odometry: Mapping[str, Any]) -> Message:
    """Return the `nav_msgs/msg/Odometry` of an `odometry`; without errors, of a `pose`."""
    return messages.odometry(robot, odometry["tick"], state_of(odometry))


def ground_truth_of(robot: str, truth: Mapping[str, Any]) -> Message:
    """Return the `nav_msgs/msg/Odometry`, in `map`, of a `truth`."""
    return messages.odometry(robot, truth["tick"], state_of(truth), topics.MAP)


def measured_pose_of(_robot: str, pose: Mapping[str, Any]) -> Message:
    """Return the `geometry_msgs/msg/PoseWithCovarianceStamped` of a `pose`."""
    return messages.measured_pose(pose["tick"], state_of(pose), float(pose["accuracy"]))


def velocity_of(robot: str, velocity: Mapping[str, Any]) -> Message:
    """Return the `geometry_msgs/msg/TwistStamped` of a `velocity`."""
    linear = velocity["linear"]
    return messages.velocity(
        robot,
        velocity["tick"],
        forward=float(linear["x"]),
        turn=float(velocity["angular"]["z"]),
        left=float(linear.get("y", 0.0)),
    )
