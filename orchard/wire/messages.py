"""The messages on the wire, each a msgpack map with ROS's field names, SI units and bounds. keyspace.md is generated from them.

First poses and twists as in ROS's geometry_msgs; then what physics sends to agents, what agents send to physics, what agents send to
each other, the messages of a run's life (join, stop, end), and what observers receive.
"""

from typing import Annotated, Any, Literal, NamedTuple

import msgspec
from msgspec import Meta

from orchard.contract.events import Event
from orchard.contract.messages import MOST_DEEDS, Answer, Deed, Metres, Request, Text, Tick, Written
from orchard.wire.types import (
    MOST_BODIES,
    Body,
    Fill,
    Holder,
    KnownName,
    Message,
    Name,
    Once,
    Ranges,
    RunMessage,
    Speed,
    SubMessage,
    Unit,
    Zero,
)


class Point(SubMessage):
    """Metres in the frame `map`: x east, y north, z up."""

    x: Annotated[Metres, Meta(description="m, east")]
    y: Annotated[Metres, Meta(description="m, north")]
    z: Annotated[Metres, Meta(description="m, up; 0")] = 0.0


class Quaternion(SubMessage):
    """The turn from the frame `map` to the body's; the body is upright, so that yaw = 2 atan2(z, w), counter-clockwise from east."""

    z: Annotated[Unit, Meta(description="sin(yaw / 2)")]
    w: Annotated[Unit, Meta(description="cos(yaw / 2)")]
    x: Zero = 0.0
    y: Zero = 0.0


class PoseMessage(SubMessage):
    """geometry_msgs/Pose."""

    position: Point
    orientation: Quaternion


class Linear(SubMessage):
    """m/s in the body's frame `base_link`."""

    x: Annotated[Speed, Meta(description="m/s, forward")]
    y: Annotated[Speed, Meta(description="m/s, to the left; only a coupled bin can")] = 0.0
    z: Zero = 0.0


class Angular(SubMessage):
    """rad/s about the body's axes."""

    z: Annotated[Speed, Meta(description="rad/s, counter-clockwise")]
    x: Zero = 0.0
    y: Zero = 0.0


class TwistMessage(SubMessage):
    """geometry_msgs/Twist."""

    linear: Linear
    angular: Angular


class OtherEnd(SubMessage):
    """What is coupled to this body: a robot's bin, a bin's robot."""

    name: Annotated[Name, Meta(description="its name")]
    pose: PoseMessage
    twist: TwistMessage


class Odometry(Message):
    """nav_msgs/Odometry: where a body is, in the frame `map`, and how it moved in the last step, in its own frame."""

    pose: PoseMessage
    twist: TwistMessage
    hitch: Annotated[OtherEnd | None, Meta(description="the other end of the bar; nil when nothing is coupled")] = None
    fill: Annotated[float, Meta(ge=0.0, le=1e3, description="of a bin: metres of row in it, 0 to 70")] = 0.0
    full: Annotated[bool, Meta(description="of a bin: full")] = False


class Beams(SubMessage):
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


class Stamp(SubMessage):
    """builtin_interfaces/Time."""

    sec: Annotated[int, Meta(ge=0, description="s, simulated")]
    nanosec: Annotated[int, Meta(ge=0, lt=10**9, description="ns")]


class Clock(Message):
    """rosgraph_msgs/Clock; sent after every pose and scan of its tick."""

    clock: Stamp


class AskedOf(NamedTuple):
    """A request of the tick before, without its words."""

    to: Name
    sender: Name
    number: int


class OtherSeen(SubMessage):
    """What is coupled to a body."""

    name: Annotated[KnownName, Meta(description="its name")]
    state: Annotated[tuple[Metres, Metres, Unit, Unit, Speed, Speed, Speed], Meta(description="its seven numbers, as in `states`")]
    ranges: Annotated[Ranges | None, Meta(description="of a robot that tows: its bin's sweep; else nil")] = None


class Seen(Message):
    """What the agents of one session see at this tick: what `pose` and `scan` say, as arrays; cheaper than a message for each."""

    names: Annotated[list[KnownName], Meta(max_length=MOST_BODIES, description="the bodies, in the order of the arrays")]
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
    hitches: Annotated[dict[KnownName, OtherSeen], Meta(description="name -> the other end of its bar; of those that are coupled")]
    fills: Annotated[dict[KnownName, Fill], Meta(description="name -> m of row in it; of bins that are not empty")]
    full: Annotated[list[KnownName], Meta(max_length=MOST_BODIES, description="the bins that are full")]
    asked: Annotated[
        list[AskedOf], Meta(description="lockstep: [to, sender, number] of each request of the tick before that these agents hear now")
    ] = msgspec.field(default_factory=list)


class Report(SubMessage):
    """What an agent's host says besides the velocity. A client that only drives leaves it out."""

    deeds: Annotated[
        list[Deed], Meta(max_length=MOST_DEEDS, description="couple, uncouple, flatten: physics decides whether it happens")
    ] = msgspec.field(default_factory=list)
    doing: Annotated[Text, Meta(description="a short present participle: 'picking row 3'")] = ""
    waits_for: Annotated[Text, Meta(description="whom or what, when it cannot go on")] = ""
    steps_done: Annotated[int, Meta(ge=0, lt=2**53, description="steps of its plan that it has finished")] = 0
    mail: Annotated[bytes, Meta(max_length=64, description="digest of the mail that was delivered at this tick; empty for none")] = b""
    memory: Annotated[bytes | None, Meta(description="the agent's memory, for whoever runs it next; nil: as before")] = None
    letters: Annotated[Written | None, Meta(description="a copy of what it asked and answered at this tick; nil: nothing")] = None


class Drive(SubMessage):
    """A velocity among several."""

    linear: Linear
    angular: Angular
    once: Once = False
    report: Annotated[Report | None, Meta(description="the agent's report")] = None


class Velocities(Message):
    """The velocities of all agents of one session: its answer to what it has seen of this tick."""

    holder: Holder
    velocities: Annotated[dict[KnownName, Drive], Meta(max_length=MOST_BODIES, description="name -> its velocity")]


class Velocity(Message):
    """geometry_msgs/Twist, in the body's own frame: the answer to the pose and scan of the same tick."""

    linear: Linear
    angular: Angular
    holder: Holder = ""
    once: Once = False
    report: Annotated[Report | None, Meta(description="the agent's report; who only drives leaves it out")] = None


class Letter(Message):
    """A request from one agent to another, stamped with the tick in which it is asked."""

    sender: Annotated[Name, Meta(description="who asks")]
    number: Annotated[int, Meta(ge=0, lt=2**31, description="of the sender's requests in that tick, from 0")]
    body: Annotated[Request, Meta(description="see below, 'The requests'")]


class Received(Message, tag_field="type", tag="received"):
    """First reply to a request: it arrived and will be heard at the next tick."""


class Answered(Message, tag_field="type", tag="answered"):
    """Second reply to a request, stamped with the tick in which it was heard (asked + 1)."""

    body: Annotated[Answer | None, Meta(description="see below, 'The answers'; nil: it was heard and gets no answer")]


class Letters(Message):
    """All that was asked and answered at one tick."""

    letters: Annotated[
        dict[Name, Written], Meta(description="name -> `requests`, numbered from 0: [to, request]; `answers`: [to, tick, number, answer]")
    ]


class Recall(Message):
    """Which mail was for this tick? From one who was not there to hear it."""


class Recalled(Message):
    """All that was asked and answered at the two ticks before."""

    letters: Annotated[list[tuple[Tick, dict[Name, Written]]], Meta(description="[tick, name -> as in `letters`]")]


Mode = Literal["lockstep", "realtime"]


class RunInfo(Message):
    """What a newcomer must know: the answer to the scenario query."""

    mode: Annotated[Mode, Meta(description="whether physics waits for its agents, or keeps to the wall clock")]
    agents: Annotated[list[Name], Meta(description="every name that an agent can hold")]
    scenario: Annotated[dict[str, Any], Meta(description="the scenario file as a map, defaults filled in")]


class Join(RunMessage):
    """A host's wish to hold agents. Its liveliness tokens, its subscribers and its queryables must stand before it."""

    holder: Holder
    names: Annotated[list[Name], Meta(max_length=MOST_BODIES, description="the agents that it wants to hold: all or none")]


class Joined(Message):
    """From this tick on physics waits for the holder's velocities for these agents."""

    memories: Annotated[dict[Name, bytes | None], Meta(description="name -> the memory it had; nil: it never had one")]
    refused: Annotated[dict[Name, str], Meta(description="name -> why it cannot be held")]


class Lost(Message):
    """Agents that physics no longer waits for, because they were gone or silent for too long. They may join again."""

    names: Annotated[list[Name], Meta(description="the agents")]
    holder: Annotated[Holder, Meta(description="the session that held them")]


class Command(RunMessage):
    """What a person asks of the run."""

    command: Annotated[Literal["stop"], Meta(description="end the run now")]


class Done(Message):
    """The command is taken."""


class Stop(RunMessage):
    """An emergency stop, or its end."""

    stop: Annotated[bool, Meta(description="true: they stand, from the step under way on, until they are reset; false: they are reset")]
    names: Annotated[
        list[Text], Meta(max_length=MOST_BODIES, description="robots, or kinds of them: 'picker_01', 'carrier'; none: all robots")
    ]


class Stopped(Message):
    """The stop, or reset, holds from the step from this tick to the next on."""

    changed: Annotated[list[Name], Meta(description="robots that were stopped, or reset, by this; those that were so before are left out")]
    stopped: Annotated[list[Name], Meta(description="all robots that are stopped now")]
    kept: Annotated[bool, Meta(description="whether it is on the disk, too; else it holds, but not if physics dies now")] = False


Reason = Literal[
    "malformed", "other run", "past tick", "future tick", "not the holder", "not held", "answered already",
    "no such robot", "no such agent", "no such key", "out of bounds", "not all", "too many",
]  # fmt: skip


class RefusedThere(RunMessage):
    """What one host, or the logger, has refused."""

    counts: Annotated[dict[Reason, Annotated[int, Meta(ge=0, lt=2**53)]], Meta(description="reason -> how many, since it began")]


class End(Message):
    """The last message of a run."""

    finished: Annotated[bool, Meta(description="the harvest is over")]
    why: Annotated[str, Meta(description="why the run ended: 'harvested', 'duration', 'stopped', or what is jammed")]
    hash: Annotated[str, Meta(description="SHA-256 over all ticks, hexadecimal")]
    summary: Annotated[dict[str, Any], Meta(description="the figures of the whole run")]


class Events(Message):
    """What happened in the step from this tick to the next."""

    events: Annotated[list[Event], Meta(description="maps of `tick`, `what`, `who`, `whom` ('' or the other body), `detail`")]


class BinStatus(Message):
    """A bin's, published whenever `full` or `coupled_to` changes."""

    full: Annotated[bool, Meta(description="it holds a whole row")]
    fill: Annotated[Fill, Meta(description="m of row in it, 0 to 70")]
    coupled_to: Annotated[str, Meta(description="the robot that tows it; '' when it stands by itself")]


class Picture(Message):
    """The whole orchard after the step that ends at this tick, for those who look on. `nil`: as before; every 5 s, and when a logger
    comes, nothing is nil."""

    poses: Annotated[bytes, Meta(description="x, y (m), yaw (rad) of every body, in the scenario's order, as little-endian float64")]
    scans: Annotated[list[bytes] | None, Meta(description="twice a second: every body's ranges, m, as little-endian float32")]
    doing: Annotated[dict[Name, str], Meta(description="name -> what it does; those that do something new")]
    coupled: Annotated[list[Body] | None, Meta(description="of every body, the number of the one at the other end of its bar, or -1")]
    fill: Annotated[list[Fill] | None, Meta(description="of every bin, m of row in it; 0 of other bodies")]
    alive: Annotated[list[bool] | None, Meta(description="false for a weed that is flattened")]
    row_picked: Annotated[list[Fill] | None, Meta(description="m of every row that are picked, 0 to 70")]
    delivered: Annotated[int, Meta(ge=0, description="bins unloaded so far")]


class Figures(Message):
    """How the run goes."""

    figures: Annotated[dict[str, Any], Meta(description="name -> number, or a map of them")]
    doing: Annotated[dict[Name, str], Meta(description="name -> what it does")]
    waits_for: Annotated[dict[Name, str], Meta(description="name -> for whom or what it waits; those that wait for nothing are left out")]
    messages_refused: Annotated[dict[str, int], Meta(description="reason -> how many, since the beginning")]
