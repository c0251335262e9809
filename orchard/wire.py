"""The messages on the wire: ROS's names, SI units, bounds. Each is a msgpack map; what its fields say here, keyspace.md repeats.

Whatever arrives goes through `read`, which refuses (with the reason) what is too big, malformed, of a wrong type, not a number, infinite
or out of bounds.
"""

from typing import Annotated, Any, Literal, TypeVar

import msgspec
import numpy as np
from msgspec import Meta

from orchard.agent import Action, Hitch, Observation
from orchard.frames import Frame
from orchard.geometry import Twist
from orchard.kinds import LASER_RANGE, Laser
from orchard.messages import Answer, Deed, Request, unpack

MAX_PAYLOAD = 1 << 20  # bytes
FASTEST = 100.0  # m/s and rad/s: what no velocity can mean

Text = Annotated[str, Meta(max_length=200)]
Name = Annotated[str, Meta(max_length=64, pattern="^[a-z][a-z0-9_]*$")]
Run = Annotated[str, Meta(max_length=64, description="the run's id; that of the scenario query's answer")]
Tick = Annotated[int, Meta(ge=0, lt=2**53, description="number of the time step, 0.1 s each, from 0")]
Metres = Annotated[float, Meta(ge=-1e6, le=1e6)]
Speed = Annotated[float, Meta(ge=-FASTEST, le=FASTEST)]
Zero = Annotated[float, Meta(ge=0.0, le=0.0, description="0")]
Unit = Annotated[float, Meta(ge=-1.001, le=1.001)]
Ranges = Annotated[
    bytes, Meta(max_length=4096, description="m, as little-endian float32, 4 bytes a beam; +inf where nothing returns (REP-117)")
]
Holder = Annotated[str, Meta(max_length=64, description="the session id in the sender's liveliness token; '' from one who holds no agent")]


class Part(msgspec.Struct, forbid_unknown_fields=True):
    """A map inside a message."""


class OfRun(Part):
    """A map with the run's id."""

    run: Run


class Message(OfRun):
    """A map with the run's id and the tick."""

    tick: Tick


# -- geometry_msgs


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


# -- physics to agents


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


class Seen(Message):
    """All that the agents of one host see at this tick, in one message: it costs less than one for each, and says the same."""

    bodies: Annotated[dict[Name, tuple[bytes, bytes]], Meta(description="name -> the payloads of its `pose` and its `scan`")]


# -- agents to physics


class Report(Part):
    """What an agent's host says besides the velocity. A client that only drives leaves it out."""

    deeds: Annotated[list[Deed], Meta(max_length=16, description="couple, uncouple, flatten: physics decides whether it happens")] = []
    doing: Annotated[Text, Meta(description="a short present participle: 'picking row 3'")] = ""
    waits_for: Annotated[Text, Meta(description="whom or what, when it cannot go on")] = ""
    steps_done: Annotated[int, Meta(ge=0, lt=2**53, description="steps of its plan that it has finished")] = 0
    mail: Annotated[bytes, Meta(max_length=64, description="digest of the mail that was delivered at this tick; empty for none")] = b""
    memory: Annotated[bytes | None, Meta(description="the agent's memory, for whoever runs it next; nil: as before")] = None


class Velocity(Message):
    """geometry_msgs/Twist, in the body's own frame: the answer to the pose and scan of the same tick."""

    linear: Linear
    angular: Angular
    holder: Holder = ""
    once: Annotated[
        bool, Meta(description="realtime: it drives for one step, and only from the pose that it answers; else until a newer one comes")
    ] = False
    report: Annotated[Report | None, Meta(description="the agent's report; who only drives leaves it out")] = None


# -- agents to agents


class Letter(Message):
    """A request from one agent to another, stamped with the tick in which it is asked."""

    sender: Annotated[Name, Meta(description="who asks")]
    number: Annotated[int, Meta(ge=0, lt=2**31, description="of the sender's requests in that tick, from 0")]
    body: Annotated[Request, Meta(description="see below, 'The requests'")]


class Received(Message, tag_field="type", tag="received"):
    """First reply to a request: it arrived and will be heard at the next tick."""


class Answered(Message, tag_field="type", tag="answered"):
    """Second reply to a request, stamped with the tick in which it was heard (asked + 1). None comes if nobody answers."""

    body: Annotated[Answer, Meta(description="see below, 'The answers'")]


class Sent(Part):
    """A request, as the logger hears of it."""

    to: Name
    number: int
    body: Request


class Given(Part):
    """An answer, as the logger hears of it, to the sender's request of (tick, number)."""

    to: Name
    tick: int
    number: int
    body: Answer


class Letters(Message):
    """All that one agent asked and answered at one tick."""

    requests: Annotated[list[Sent], Meta(description="maps of `to`, `number`, `body`")]
    answers: Annotated[list[Given], Meta(description="maps of `to`, `tick` and `number` (of the request), `body`")]


# -- the run


Mode = Literal["lockstep", "realtime"]


class Newcomer(Message):
    """What a newcomer must know: the answer to the scenario query."""

    mode: Annotated[Mode, Meta(description="whether physics waits for its agents, or keeps to the wall clock")]
    agents: Annotated[list[Name], Meta(description="every name that an agent can hold")]
    scenario: Annotated[dict[str, Any], Meta(description="the scenario file as a map, defaults filled in")]


class Join(OfRun):
    """A host's wish to hold agents. Its liveliness tokens, its subscribers and its queryables must stand before it."""

    holder: Holder
    names: Annotated[list[Name], Meta(max_length=10_000, description="the agents that it wants to hold: all or none")]


class Joined(Message):
    """From this tick on physics waits for the holder's velocities for these agents."""

    memories: Annotated[dict[Name, bytes | None], Meta(description="name -> the memory it had; nil: it never had one")]
    refused: Annotated[dict[Name, str], Meta(description="name -> why it cannot be held")]


class Lost(Message):
    """Agents that physics no longer waits for, because they were gone or silent for too long. They may join again."""

    names: Annotated[list[Name], Meta(description="the agents")]
    holder: Annotated[Holder, Meta(description="the session that held them")]


class Events(Message):
    """What happened in the step from this tick to the next."""

    events: Annotated[list[dict[str, Any]], Meta(description="maps of `tick`, `what`, `who`, `whom` ('' or the other body), `detail`")]


class State(Message):
    """A bin's, published whenever `full` or `coupled_to` changes."""

    full: Annotated[bool, Meta(description="it holds a whole row")]
    fill: Annotated[float, Meta(description="m of row in it, 0 to 70")]
    coupled_to: Annotated[str, Meta(description="the robot that tows it; '' when it stands by itself")]


class Command(OfRun):
    """What a person asks of the run."""

    command: Annotated[Literal["stop"], Meta(description="end the run now")]


class Done(Message):
    """The command is taken."""


class Picture(Message):
    """The whole orchard after the step that ends at this tick, for those who look on. `nil`: as before; every 5 s nothing is nil."""

    poses: Annotated[bytes, Meta(description="x, y (m), yaw (rad) of every body, in the scenario's order, as little-endian float64")]
    scans: Annotated[list[bytes] | None, Meta(description="twice a second: every body's ranges, m, as little-endian float32")]
    doing: Annotated[dict[Name, str], Meta(description="name -> what it does; those that do something new")]
    coupled: Annotated[list[int] | None, Meta(description="of every body, the number of the one at the other end of its bar, or -1")]
    fill: Annotated[list[float] | None, Meta(description="of every bin, m of row in it; 0 of other bodies")]
    alive: Annotated[list[bool] | None, Meta(description="false for a weed that is flattened")]
    row_picked: Annotated[list[float] | None, Meta(description="m of every row that are picked, 0 to 70")]
    delivered: Annotated[int, Meta(ge=0, description="bins unloaded so far")]


class Figures(Message):
    """How the run goes."""

    figures: Annotated[dict[str, Any], Meta(description="name -> number, or a map of them")]
    doing: Annotated[dict[Name, str], Meta(description="name -> what it does")]
    waits_for: Annotated[dict[Name, str], Meta(description="name -> for whom or what it waits; those that wait for nothing are left out")]
    messages_refused: Annotated[dict[str, int], Meta(description="reason -> how many, since the beginning")]


class RefusedThere(OfRun):
    """What one host, or the logger, has refused."""

    counts: Annotated[
        dict[Text, Annotated[int, Meta(ge=0, lt=2**53)]], Meta(max_length=32, description="reason -> how many, since it began")
    ]


class End(Message):
    """The last message of a run."""

    finished: Annotated[bool, Meta(description="the harvest is over")]
    why: Annotated[str, Meta(description="why the run ended: 'harvested', 'duration', 'stopped', or what is jammed")]
    hash: Annotated[str, Meta(description="SHA-256 over all ticks, hexadecimal")]
    summary: Annotated[dict[str, Any], Meta(description="the figures of the whole run")]


M = TypeVar("M")


def read(payload: bytes, type_: type[M]) -> M:
    """The message in a payload; ValueError, saying what is wrong with it."""
    if len(payload) > MAX_PAYLOAD:
        raise ValueError(f"{len(payload)} bytes; at most {MAX_PAYLOAD}")
    message: M = unpack(payload, type_)
    return message


# -- between what agents know and what travels


def _pose(x: float, y: float, orientation: tuple[float, float]) -> Pose:
    return Pose(Point(float(x), float(y)), Quaternion(float(orientation[0]), float(orientation[1])))


def _twist(twist: Twist) -> TwistPart:
    return TwistPart(Linear(float(twist[0]), float(twist[1])), Angular(float(twist[2])))


def odometry_of(run: str, seen: Observation) -> Odometry:
    """What travels of an observation, all but the scan."""
    hitch = seen.hitch and OtherEnd(seen.hitch.name, _pose(seen.hitch.x, seen.hitch.y, seen.hitch.orientation), _twist(seen.hitch.twist))
    pose = _pose(seen.x, seen.y, seen.orientation)
    return Odometry(run, seen.tick, pose, _twist(seen.twist), hitch, float(seen.fill), bool(seen.full))


def _sweep(laser: Laser, scan: np.ndarray | None) -> tuple[float, float, float, float, bytes]:
    last = laser.first + (laser.beams - 1) * laser.increment
    return laser.first, last, laser.increment, LASER_RANGE, np.asarray(scan, dtype="<f4").tobytes()


def scan_of(run: str, seen: Observation, laser: Laser, rear_laser: Laser) -> LaserScan:
    """What travels of an observation's scan, and of its bin's."""
    rear = None if seen.hitch is None or seen.hitch.scan is None else Beams(*_sweep(rear_laser, seen.hitch.scan))
    return LaserScan(run, seen.tick, *_sweep(laser, seen.scan), rear)


def _heard_twist(twist: TwistPart) -> Twist:
    return Twist(twist.linear.x, twist.linear.y, twist.angular.z)


def _ranges(beams: LaserScan | Beams) -> np.ndarray:
    return np.frombuffer(beams.ranges, dtype="<f4")


def _heard_hitch(other: OtherEnd, scan: LaserScan) -> Hitch:
    at, turned = other.pose.position, other.pose.orientation
    rear = None if scan.rear is None else _ranges(scan.rear)
    return Hitch(other.name, at.x, at.y, (turned.z, turned.w), _heard_twist(other.twist), rear)


def observation_of(name: str, odometry: Odometry, scan: LaserScan) -> Observation:
    """The observation that was sent, to the last bit."""
    at, turned = odometry.pose.position, odometry.pose.orientation
    hitch = None if odometry.hitch is None else _heard_hitch(odometry.hitch, scan)
    twist = _heard_twist(odometry.twist)
    return Observation(name, odometry.tick, at.x, at.y, (turned.z, turned.w), twist, _ranges(scan), hitch, odometry.fill, odometry.full)


def picture_of(run: str, frame: Frame) -> Picture:
    """What travels of a frame, its events apart."""
    scans = None if frame.scans is None else [np.asarray(scan, dtype="<f4").tobytes() for scan in frame.scans]
    lists = {name: _listed(getattr(frame, name)) for name in ("coupled", "fill", "alive", "row_picked")}
    poses = np.asarray(frame.poses, dtype="<f8").tobytes()
    return Picture(run, frame.tick, poses, scans, dict(frame.doing), **lists, delivered=frame.delivered)


def frame_of(picture: Picture) -> Frame:
    """The frame that was sent."""
    poses = np.frombuffer(picture.poses, dtype="<f8").reshape(-1, 3)
    scans = None if picture.scans is None else [np.frombuffer(scan, dtype="<f4") for scan in picture.scans]
    arrays: dict[str, Any] = {name: _array(getattr(picture, name)) for name in ("coupled", "fill", "alive", "row_picked")}
    return Frame(picture.tick, poses, picture.doing, scans, **arrays, delivered=picture.delivered)


def _listed(array: np.ndarray | None) -> list[Any] | None:
    return None if array is None else array.tolist()


def _array(values: list[Any] | None) -> np.ndarray | None:
    return None if values is None else np.array(values)


def velocity_of(run: str, tick: int, holder: str, action: Action, mail: bytes, memory: bytes | None) -> Velocity:
    """What travels of an action, its mail apart."""
    twist = _twist(action.twist)
    report = Report(action.deeds, action.doing[:200], action.waits_for[:200], action.steps_done, mail, memory)
    return Velocity(run, tick, twist.linear, twist.angular, holder, True, report)


def action_of(velocity: Velocity) -> Action:
    """The action that was sent, its mail and memory apart."""
    twist = Twist(velocity.linear.x, velocity.linear.y, velocity.angular.z)
    report = velocity.report or Report()
    return Action(twist, report.deeds, doing=report.doing, waits_for=report.waits_for, steps_done=report.steps_done)


