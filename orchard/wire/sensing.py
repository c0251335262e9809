"""Physics to agents: where a body is and what it sees, as ROS has it; and the same for all bodies of a session, as arrays."""

from typing import Annotated

import msgspec
from msgspec import Meta

from orchard.messages import Metres
from orchard.wire.geometry_msgs import Pose, TwistPart
from orchard.wire.letters import AskedOf
from orchard.wire.vocabulary import MOST_BODIES, Fill, Known, Message, Name, Part, Ranges, Speed, Unit


class OtherEnd(Part):
    """What is coupled to this body: a robot's bin, a bin's robot."""

    name: Annotated[Name, Meta(description="its name")]
    pose: Pose
    twist: TwistPart


class Odometry(Message):
    """nav_msgs/Odometry: where a body is, in the frame `map`, and how it moved in the last step, in its own frame."""

    pose: Pose
    twist: TwistPart
    hitch: Annotated[OtherEnd | None, Meta(description="the other end of the bar; nil when nothing is coupled")] = None
    fill: Annotated[float, Meta(ge=0.0, le=1e3, description="of a bin: metres of row in it, 0 to 70")] = 0.0
    full: Annotated[bool, Meta(description="of a bin: full")] = False


class Beams(Part):
    """A sweep of ranges, counter-clockwise: ranges[i] was measured at angle_min + i * angle_increment."""

    angle_min: Annotated[Metres, Meta(description="rad, of the first beam; 0 is straight ahead")]
    angle_max: Annotated[Metres, Meta(description="rad, of the last beam")]
    angle_increment: Annotated[Metres, Meta(description="rad from one beam to the next")]
    range_max: Annotated[Metres, Meta(description="m")]
    ranges: Ranges


class LaserScan(Message):
    """sensor_msgs/LaserScan in the laser's frame, at the middle of the body's front edge (bins and weeds: at its centre)."""

    angle_min: Annotated[Metres, Meta(description="rad, of the first beam; 0 is straight ahead")]
    angle_max: Annotated[Metres, Meta(description="rad, of the last beam")]
    angle_increment: Annotated[Metres, Meta(description="rad from one beam to the next")]
    range_max: Annotated[Metres, Meta(description="m")]
    ranges: Ranges
    rear: Annotated[Beams | None, Meta(description="of a robot that tows: its bin's sweep, around the bin's centre; else nil")] = None


class Stamp(Part):
    """builtin_interfaces/Time."""

    sec: Annotated[int, Meta(ge=0, description="s, simulated")]
    nanosec: Annotated[int, Meta(ge=0, lt=10**9, description="ns")]


class Clock(Message):
    """rosgraph_msgs/Clock; sent after every pose and scan of its tick."""

    clock: Stamp


class OtherSeen(Part):
    """What is coupled to a body."""

    name: Annotated[Known, Meta(description="its name")]
    state: Annotated[tuple[Metres, Metres, Unit, Unit, Speed, Speed, Speed], Meta(description="its seven numbers, as in `states`")]
    ranges: Annotated[Ranges | None, Meta(description="of a robot that tows: its bin's sweep; else nil")] = None


class Seen(Message):
    """What the agents of one session see at this tick: what `pose` and `scan` say, as arrays; cheaper than a message for each."""

    names: Annotated[list[Known], Meta(max_length=MOST_BODIES, description="the bodies, in the order of the arrays")]
    states: Annotated[
        bytes,
        Meta(
            description="seven little-endian float64 a body: x, y (m), z, w of the quaternion, "
            "and of the last step linear.x, linear.y (m/s), angular.z (rad/s)"
        ),
    ]
    ranges: Annotated[
        bytes, Meta(description="m, as little-endian float32: of each body as many as its kind has beams; +inf where nothing returns")
    ]
    hitches: Annotated[dict[Known, OtherSeen], Meta(description="name -> the other end of its bar; of those that are coupled")]
    fills: Annotated[dict[Known, Fill], Meta(description="name -> m of row in it; of bins that are not empty")]
    full: Annotated[list[Known], Meta(max_length=MOST_BODIES, description="the bins that are full")]
    asked: Annotated[
        list[AskedOf], Meta(description="lockstep: [to, sender, number] of each request of the tick before that these agents hear now")
    ] = msgspec.field(default_factory=list)
