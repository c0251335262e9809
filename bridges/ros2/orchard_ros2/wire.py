"""What the Orchard sends, unpacked from msgpack, as the parts of a ROS 2 message. Fields: keyspace.md."""

import sys
from array import array
from collections.abc import Mapping
from typing import Any

from orchard_ros2 import messages
from orchard_ros2.messages import Message

State = tuple[float, float, float, float, float, float, float]


def state_of(pose: Mapping[str, Any]) -> State:
    """Return the state of a body from its `pose`: see `messages`."""
    position, orientation = pose["pose"]["position"], pose["pose"]["orientation"]
    linear, angular = pose["twist"]["linear"], pose["twist"]["angular"]
    turned = (float(orientation["z"]), float(orientation["w"]))
    return float(position["x"]), float(position["y"]), *turned, float(linear["x"]), float(linear.get("y", 0.0)), float(angular["z"])


def ranges_of(raw: bytes) -> "array[float]":
    """Return the ranges of a scan, m: they are little-endian float32 on the wire."""
    ranges = array("f", raw)
    if sys.byteorder == "big":
        ranges.byteswap()
    return ranges


def scan_of(robot: str, scan: Mapping[str, Any]) -> Message:
    """Return the `sensor_msgs/msg/LaserScan` of a `scan`."""
    angles = float(scan["angle_min"]), float(scan["angle_increment"])
    limits = float(scan.get("range_min", 0.0)), float(scan["range_max"])
    return messages.scan(robot, scan["tick"], ranges_of(scan["ranges"]), *angles, *limits)


def odometry_of(robot: str, pose: Mapping[str, Any]) -> Message:
    """Return the `nav_msgs/msg/Odometry` of a `pose`."""
    return messages.odometry(robot, pose["tick"], state_of(pose))


def velocity_of(robot: str, velocity: Mapping[str, Any]) -> Message:
    """Return the `geometry_msgs/msg/TwistStamped` of a `velocity`."""
    linear, angular = velocity["linear"], velocity["angular"]
    return messages.velocity(robot, velocity["tick"], float(linear["x"]), float(angular["z"]), float(linear.get("y", 0.0)))
