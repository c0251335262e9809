"""Poses, twists and scans of bodies, as in ROS's geometry_msgs, nav_msgs and sensor_msgs."""

from typing import Annotated

from msgspec import Meta

from orchard.contract.messages import Metres, Tick
from orchard.wire.messages.values import (
    Charge,
    Message,
    Name,
    Ranges,
    Run,
    Speed,
    SubMessage,
    Unit,
    Zero,
)


class Point(SubMessage):
    """A point in the frame `map`, in metres: x east, y north, z up."""

    x: Annotated[Metres, Meta(description="m, east")]
    y: Annotated[Metres, Meta(description="m, north")]
    z: Annotated[Metres, Meta(description="m, up; 0")] = 0.0


class Quaternion(SubMessage):
    """The rotation from the frame `map` to the body's. Bodies are upright: yaw = 2 atan2(z, w),
    counter-clockwise from east.
    """

    z: Annotated[Unit, Meta(description="sin(yaw / 2)")]
    w: Annotated[Unit, Meta(description="cos(yaw / 2)")]
    x: Zero = 0.0
    y: Zero = 0.0


class PoseMessage(SubMessage):
    """geometry_msgs/Pose."""

    position: Point
    orientation: Quaternion


class Linear(SubMessage):
    """Velocity in the body's frame `base_link`, m/s."""

    x: Annotated[Speed, Meta(description="m/s, forward")]
    y: Annotated[Speed, Meta(description="m/s, to the left; 0 except for a coupled bin")] = 0.0
    z: Zero = 0.0


class Angular(SubMessage):
    """Angular velocity about the body's axes, rad/s."""

    z: Annotated[Speed, Meta(description="rad/s, counter-clockwise")]
    x: Zero = 0.0
    y: Zero = 0.0


class TwistMessage(SubMessage):
    """geometry_msgs/Twist."""

    linear: Linear
    angular: Angular


class OtherEnd(SubMessage):
    """The body that is coupled to this one: the bin of a robot, or the robot of a bin."""

    name: Name
    pose: PoseMessage
    twist: TwistMessage


class Odometry(Message):
    """nav_msgs/Odometry: the pose of a body in the frame `map` (on the key `odometry`: in its frame
    `odom`), and its velocity in the last step in its own frame.
    """

    pose: PoseMessage
    twist: TwistMessage
    hitch: Annotated[
        OtherEnd | None,
        Meta(description="the body at the other end of the bar; nil if none is coupled"),
    ] = None
    fill: Annotated[
        float,
        Meta(ge=0.0, le=1e3, description="for a bin: metres of row in it, 0 to what fills it"),
    ] = 0.0
    full: Annotated[bool, Meta(description="for a bin: whether it is full")] = False
    accuracy: Annotated[
        Metres, Meta(description="m, standard deviation of the measured x and y; 0: exact")
    ] = 0.0
    percentage: Annotated[
        Charge,
        Meta(description="as in sensor_msgs/BatteryState: charge of its battery; 1 without one"),
    ] = 1.0


class Beams(SubMessage):
    """The ranges of one scan, counter-clockwise: ranges[i] was measured at angle_min + i *
    angle_increment.
    """

    angle_min: Annotated[
        Metres, Meta(description="rad, angle of the first beam; 0 is straight ahead")
    ]
    angle_max: Annotated[Metres, Meta(description="rad, angle of the last beam")]
    angle_increment: Annotated[Metres, Meta(description="rad from one beam to the next")]
    range_min: Annotated[Metres, Meta(description="m, 0: the laser has no blind zone")]
    range_max: Annotated[Metres, Meta(description="m, range of the laser")]
    ranges: Ranges


class LaserScan(Beams):
    """sensor_msgs/LaserScan in the frame of the laser, which is at the middle of the body's front
    edge (bins and weeds: at the centre).
    """

    run: Run
    tick: Tick
    rear: Annotated[
        Beams | None,
        Meta(
            description=(
                "for a robot that tows: the scan of its bin, around the bin's centre; else nil"
            )
        ),
    ] = None


class Stamp(SubMessage):
    """builtin_interfaces/Time."""

    sec: Annotated[int, Meta(ge=0, description="s, simulated")]
    nanosec: Annotated[int, Meta(ge=0, lt=10**9, description="ns")]


class Clock(Message):
    """rosgraph_msgs/Clock, sent after all poses and scans of its tick."""

    clock: Stamp
