"""Poses and twists as ROS has them, in its package geometry_msgs."""

from typing import Annotated

from msgspec import Meta

from orchard.messages import Metres
from orchard.wire.vocabulary import Part, Speed, Unit, Zero


class Point(Part):
    """Metres in the frame `map`: x east, y north, z up."""

    x: Annotated[Metres, Meta(description="m, east")]
    y: Annotated[Metres, Meta(description="m, north")]
    z: Annotated[Metres, Meta(description="m, up; 0")] = 0.0


class Quaternion(Part):
    """The turn from the frame `map` to the body's; the body is upright, so that yaw = 2 atan2(z, w), counter-clockwise from east."""

    z: Annotated[Unit, Meta(description="sin(yaw / 2)")]
    w: Annotated[Unit, Meta(description="cos(yaw / 2)")]
    x: Zero = 0.0
    y: Zero = 0.0


class Pose(Part):
    """geometry_msgs/Pose."""

    position: Point
    orientation: Quaternion


class Linear(Part):
    """m/s in the body's frame `base_link`."""

    x: Annotated[Speed, Meta(description="m/s, forward")]
    y: Annotated[Speed, Meta(description="m/s, to the left; only a coupled bin can")] = 0.0
    z: Zero = 0.0


class Angular(Part):
    """rad/s about the body's axes."""

    z: Annotated[Speed, Meta(description="rad/s, counter-clockwise")]
    x: Zero = 0.0
    y: Zero = 0.0


class TwistPart(Part):
    """geometry_msgs/Twist."""

    linear: Linear
    angular: Angular
