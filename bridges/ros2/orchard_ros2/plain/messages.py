"""ROS 2 messages as plain data, from what the Orchard sends.

No ROS is needed. `cdr` makes of them the bytes that a bridge sends and a bag keeps.

A state of a body is seven numbers, as in the Orchard's `seen`: x, y (m); z, w of the quaternion;
the velocity of the last step in the body's own frame: forward and to the left (m/s), turn (rad/s,
counter-clockwise).
"""

import math
from array import array
from collections.abc import Container, Iterable, Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

from . import topics

TICKS_PER_SECOND = 10
TICK_NANOSECONDS = 10**9 // TICKS_PER_SECOND

# m^2, rad^2: the variance of what is exact, because filters such as robot_localization's want one
# above 0.
EXACT = 1e-6


class UInt8(int):
    """A number of one byte."""


class Message(NamedTuple):
    """A message: the name of its type, such as `nav_msgs/msg/Odometry`, and all fields in order.

    A field is a number, a truth value, a text, a `Message`, a list of them, or an array. A number
    with a point is a float, also where it is whole; other numbers are int32 or `UInt8`.
    """

    type: str
    fields: dict[str, Any]


# -- messages that stand inside others


def stamp(tick: int) -> Message:
    """Return the simulated time of a tick."""
    second, ticks = divmod(tick, TICKS_PER_SECOND)
    return Message(
        "builtin_interfaces/msg/Time", {"sec": second, "nanosec": ticks * TICK_NANOSECONDS}
    )


def header(tick: int, frame: str) -> Message:
    """Return the head of a message: when it is of, and in which frame."""
    return Message("std_msgs/msg/Header", {"stamp": stamp(tick), "frame_id": frame})


def vector(x: float, y: float, z: float) -> Message:
    """Return three numbers, in the unit of what they are of."""
    return Message("geometry_msgs/msg/Vector3", {"x": x, "y": y, "z": z})


def quaternion(z: float, w: float) -> Message:
    """Return a turn about the upward axis: z = sin(yaw / 2), w = cos(yaw / 2)."""
    return Message("geometry_msgs/msg/Quaternion", {"x": 0.0, "y": 0.0, "z": z, "w": w})


def pose(x: float, y: float, z: float = 0.0, w: float = 1.0) -> Message:
    """Return a pose on the ground. `x`, `y`: m. `z`, `w`: of the quaternion."""
    position = Message("geometry_msgs/msg/Point", {"x": x, "y": y, "z": 0.0})
    return Message(
        "geometry_msgs/msg/Pose", {"position": position, "orientation": quaternion(z, w)}
    )


def twist(forward: float, left: float, turn: float) -> Message:
    """Return a velocity on the ground, m/s and rad/s."""
    return Message(
        "geometry_msgs/msg/Twist",
        {"linear": vector(forward, left, 0.0), "angular": vector(0.0, 0.0, turn)},
    )


@cache
def covariance(accuracy: float = 0.0) -> "array[float]":
    """Return the covariance, 6 x 6, of a pose or a twist. All messages share it: change none.

    `accuracy`: the standard deviation of x and of y, m; 0: they are exact. The other four are
    exact.
    """
    # 36 zeros, of 8 bytes each.
    matrix = array("d", bytes(36 * 8))
    # Of x and y, and of z and the three angles.
    variances = [max(EXACT, accuracy * accuracy)] * 2 + [EXACT] * 4
    for row, variance in enumerate(variances):
        matrix[6 * row + row] = variance
    return matrix


def pose_with_covariance(state: Sequence[float], accuracy: float = 0.0) -> Message:
    """Return the pose in a state of a body. `accuracy`: as for `covariance`."""
    return Message(
        "geometry_msgs/msg/PoseWithCovariance",
        {"pose": pose(*state[:4]), "covariance": covariance(accuracy)},
    )


# -- messages that are published


def clock(tick: int) -> Message:
    """Return the simulated time of a tick, for /clock."""
    return Message("rosgraph_msgs/msg/Clock", {"clock": stamp(tick)})


def odometry(robot: str, tick: int, state: Sequence[float], frame: str = "") -> Message:
    """Return the pose of a robot at a tick in a frame, by default NAME/odom, and its velocity."""
    fields = {
        "header": header(tick, frame or topics.odom(robot)),
        "child_frame_id": topics.base_link(robot),
        "pose": pose_with_covariance(state),
        "twist": Message(
            "geometry_msgs/msg/TwistWithCovariance",
            {"twist": twist(*state[4:]), "covariance": covariance()},
        ),
    }
    return Message("nav_msgs/msg/Odometry", fields)


def measured_pose(tick: int, state: Sequence[float], accuracy: float) -> Message:
    """Return a pose in `map` as it is measured.

    `accuracy`: the standard deviation of x and of y, m; 0: exact.
    """
    fields = {"header": header(tick, topics.MAP), "pose": pose_with_covariance(state, accuracy)}
    return Message("geometry_msgs/msg/PoseWithCovarianceStamped", fields)


def velocity(robot: str, tick: int, forward: float, turn: float, left: float = 0.0) -> Message:
    """Return the velocity that a robot wants, in its own frame: m/s and rad/s."""
    return Message(
        "geometry_msgs/msg/TwistStamped",
        {"header": header(tick, topics.base_link(robot)), "twist": twist(forward, left, turn)},
    )


def scan(
    robot: str,
    tick: int,
    ranges: "array[float]",
    angle_min: float,
    angle_increment: float,
    range_min: float,
    range_max: float,
) -> Message:
    """Return what a laser measures at a tick.

    `ranges`: array("f"), m; +inf for a beam without a return (REP-117). Angles: rad.
    """
    fields = {
        "header": header(tick, topics.laser(robot)),
        "angle_min": angle_min,
        "angle_max": angle_min + (len(ranges) - 1) * angle_increment,
        "angle_increment": angle_increment,
        # All beams are measured at once.
        "time_increment": 0.0,
        "scan_time": 1.0 / TICKS_PER_SECOND,
        "range_min": range_min,
        "range_max": range_max,
        "ranges": ranges,
        "intensities": array("f"),
    }
    return Message("sensor_msgs/msg/LaserScan", fields)


def battery_state(robot: str, tick: int, percentage: float) -> Message:
    """Return the charge of a robot's battery, 0 to 1.

    NaN and 0 say that nothing else is measured.
    """
    fields = {
        "header": header(tick, topics.base_link(robot)),
        "voltage": math.nan,
        "temperature": math.nan,
        "current": math.nan,
        "charge": math.nan,
        "capacity": math.nan,
        "design_capacity": math.nan,
        "percentage": percentage,
        "power_supply_status": UInt8(0),
        "power_supply_health": UInt8(0),
        "power_supply_technology": UInt8(0),
        "present": True,
        "cell_voltage": array("f"),
        "cell_temperature": array("f"),
        "location": "",
        "serial_number": "",
    }
    return Message("sensor_msgs/msg/BatteryState", fields)


def transform(
    tick: int, parent: str, child: str, place: Sequence[float], turned: Sequence[float] = (0.0, 1.0)
) -> Message:
    """Return where the frame `child` is in the frame `parent`.

    `place`: x, y, z, m; `turned`: z and w of the quaternion.
    """
    fields = {
        "header": header(tick, parent),
        "child_frame_id": child,
        "transform": Message(
            "geometry_msgs/msg/Transform",
            {"translation": vector(*place), "rotation": quaternion(*turned)},
        ),
    }
    return Message("geometry_msgs/msg/TransformStamped", fields)


def odom_in_map(
    pose: Sequence[float], odometry: Sequence[float]
) -> tuple[float, float, float, float]:
    """Return the frame NAME/odom in `map`: pose * odometry^-1, as x, y, z, w.

    `pose`, `odometry`: states of a body at one tick, in `map` and in NAME/odom.
    """
    x, y, z_map, w_map = pose[:4]
    ahead, left, z_odom, w_odom = odometry[:4]
    z = z_map * w_odom - w_map * z_odom
    w = w_map * w_odom + z_map * z_odom
    # Of the angle from `map` to NAME/odom; z and w are sine and cosine of its half.
    sine = 2.0 * z * w
    cosine = w * w - z * z
    return x - (cosine * ahead - sine * left), y - (sine * ahead + cosine * left), z, w


def transforms(
    tick: int,
    states: Mapping[str, Sequence[float]],
    poses: Mapping[str, Sequence[float]] | None = None,
) -> Message:
    """Return for /tf where the bodies are at a tick.

    `states`: name -> state in NAME/odom; `poses`: name -> state in `map`, of those with a NAME/odom
    that moves in `map`.
    """
    moved = []
    for name, state in states.items():
        moved.append(_moved(tick, topics.odom(name), topics.base_link(name), state))
    for name, pose in (poses or {}).items():
        in_map = odom_in_map(pose, states[name])
        moved.append(_moved(tick, topics.MAP, topics.odom(name), in_map))
    return Message("tf2_msgs/msg/TFMessage", {"transforms": moved})


def _moved(tick: int, parent: str, child: str, state: Sequence[float]) -> Message:
    return transform(tick, parent, child, (*state[:2], 0.0), state[2:4])


def static_transforms(
    lasers: Iterable[tuple[str, float]], drifting: Container[str] = ()
) -> Message:
    """Return for /tf_static what never moves.

    `lasers`: each body's name, and how far its laser is ahead of its centre, m.

    `drifting`: the bodies with a NAME/odom that moves in `map`. That of others lies on `map`.
    """
    fixed = []
    for name, ahead in lasers:
        if name not in drifting:
            fixed.append(transform(0, topics.MAP, topics.odom(name), (0.0, 0.0, 0.0)))
        at = (ahead, 0.0, topics.LASER_HEIGHT)
        fixed.append(transform(0, topics.base_link(name), topics.laser(name), at))
    return Message("tf2_msgs/msg/TFMessage", {"transforms": fixed})


def occupancy(cells: "array[int]", width: int, resolution: float, x: float, y: float) -> Message:
    """Return a map.

    `cells`: array("b"), 0 free, 100 occupied, by rows from the south-west; `width`: cells in a row;
    `resolution`: m.

    `x`, `y`: the south-west corner in `map`, m.
    """
    info = {
        "map_load_time": stamp(0),
        "resolution": resolution,
        "width": width,
        "height": len(cells) // width,
        "origin": pose(x, y),
    }
    fields = {
        "header": header(0, topics.MAP),
        "info": Message("nav_msgs/msg/MapMetaData", info),
        "data": cells,
    }
    return Message("nav_msgs/msg/OccupancyGrid", fields)


def text(words: str) -> Message:
    """Return a message that is a text."""
    return Message("std_msgs/msg/String", {"data": words})
