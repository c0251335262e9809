"""The messages on the wire: ROS's names, SI units, bounds. Each is a msgpack map; what its fields say here, keyspace.md repeats.

Whatever arrives goes through `read`, which refuses (with the reason) what is too big, malformed, of a wrong type, not a number, infinite
or out of bounds.
"""

from collections.abc import Sequence
from itertools import accumulate
from typing import Annotated, Any, Literal, TypeVar

import msgspec
import numpy as np
from msgspec import Meta

from orchard.agent import Action, Hitch, Observation
from orchard.frames import SELDOM, Frame
from orchard.geometry import Twist
from orchard.kinds import KINDS, LASER_RANGE, Laser, kind_of
from orchard.layout import Layout
from orchard.messages import Answer, Deed, Metres, Request, Written, unpack
from orchard.post import written_by
from orchard.sights import STATE, Sights

MAX_PAYLOAD = 1 << 20  # bytes
FASTEST = 100.0  # m/s and rad/s: what no velocity can mean
FARTHEST = 1e6  # m, or m/s: what no place and no speed can be
MOST_BODIES = 10_000
LAST_TICK = 2**36 - 1  # 217 years: its nanoseconds fit in 64 bits

Text = Annotated[str, Meta(max_length=200)]
Name = Annotated[str, Meta(max_length=64, pattern="^[a-z][a-z0-9_]*$")]
Run = Annotated[str, Meta(max_length=64, description="the run's id; that of the scenario query's answer")]
Tick = Annotated[int, Meta(ge=0, le=LAST_TICK, description="number of the time step, 0.1 s each, from 0")]
Speed = Annotated[float, Meta(ge=-FASTEST, le=FASTEST)]
Zero = Annotated[float, Meta(ge=0.0, le=0.0, description="0")]
Unit = Annotated[float, Meta(ge=-1.001, le=1.001)]
Ranges = Annotated[
    bytes, Meta(max_length=4096, description="m, as little-endian float32, 4 bytes a beam; +inf where nothing returns (REP-117)")
]
Fill = Annotated[float, Meta(ge=0.0, le=1e3)]
Body = Annotated[int, Meta(ge=-1, lt=MOST_BODIES)]
Once = Annotated[
    bool, Meta(description="realtime: it drives for one step, and only from the pose that it answers; else until a newer one comes")
]
Session = Annotated[str, Meta(max_length=64, pattern="^[A-Za-z0-9_-]+$")]
Holder = Annotated[
    str,
    Meta(
        max_length=64,
        pattern="^[A-Za-z0-9_-]*$",
        description="the session id in the sender's liveliness token; '' from one who holds no agent",
    ),
]


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


class OtherSeen(Part):
    """What is coupled to a body."""

    name: Annotated[Name, Meta(description="its name")]
    state: Annotated[tuple[Metres, Metres, Unit, Unit, Speed, Speed, Speed], Meta(description="its seven numbers, as in `states`")]
    ranges: Annotated[Ranges | None, Meta(description="of a robot that tows: its bin's sweep; else nil")] = None


class Seen(Message):
    """What the agents of one session see at this tick: what `pose` and `scan` say, as arrays; cheaper than a message for each."""

    names: Annotated[list[Name], Meta(max_length=MOST_BODIES, description="the bodies, in the order of the arrays")]
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
    hitches: Annotated[dict[Name, OtherSeen], Meta(description="name -> the other end of its bar; of those that are coupled")]
    fills: Annotated[dict[Name, Fill], Meta(description="name -> m of row in it; of bins that are not empty")]
    full: Annotated[list[Name], Meta(max_length=MOST_BODIES, description="the bins that are full")]
    recall: Annotated[bool, Meta(description="mail of this tick may not have arrived: ask `recall` for it")] = False


# -- agents to physics


class Report(Part):
    """What an agent's host says besides the velocity. A client that only drives leaves it out."""

    deeds: Annotated[list[Deed], Meta(max_length=16, description="couple, uncouple, flatten: physics decides whether it happens")] = []
    doing: Annotated[Text, Meta(description="a short present participle: 'picking row 3'")] = ""
    waits_for: Annotated[Text, Meta(description="whom or what, when it cannot go on")] = ""
    steps_done: Annotated[int, Meta(ge=0, lt=2**53, description="steps of its plan that it has finished")] = 0
    mail: Annotated[bytes, Meta(max_length=64, description="digest of the mail that was delivered at this tick; empty for none")] = b""
    memory: Annotated[bytes | None, Meta(description="the agent's memory, for whoever runs it next; nil: as before")] = None
    letters: Annotated[Written | None, Meta(description="a copy of what it asked and answered at this tick; nil: nothing")] = None


class Drive(Part):
    """A velocity among several."""

    linear: Linear
    angular: Angular
    once: Once = False
    report: Annotated[Report | None, Meta(description="the agent's report")] = None


class Velocities(Message):
    """The velocities of all agents of one session: its answer to what it has seen of this tick."""

    holder: Holder
    velocities: Annotated[dict[Name, Drive], Meta(max_length=MOST_BODIES, description="name -> its velocity")]
    undelivered: Annotated[bool, Meta(description="a request of this tick may not have arrived: its recipient must recall it")] = False


class Velocity(Message):
    """geometry_msgs/Twist, in the body's own frame: the answer to the pose and scan of the same tick."""

    linear: Linear
    angular: Angular
    holder: Holder = ""
    once: Once = False
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
    names: Annotated[list[Name], Meta(max_length=MOST_BODIES, description="the agents that it wants to hold: all or none")]


class Joined(Message):
    """From this tick on physics waits for the holder's velocities for these agents."""

    memories: Annotated[dict[Name, bytes | None], Meta(description="name -> the memory it had; nil: it never had one")]
    refused: Annotated[dict[Name, str], Meta(description="name -> why it cannot be held")]


class Lost(Message):
    """Agents that physics no longer waits for, because they were gone or silent for too long. They may join again."""

    names: Annotated[list[Name], Meta(description="the agents")]
    holder: Annotated[Holder, Meta(description="the session that held them")]


class Happened(Part):
    """One thing that happened."""

    tick: Tick
    what: Text
    who: Annotated[Text, Meta(description="whose deed, or whose step it was")]
    whom: Annotated[Text, Meta(description="'' or the other body")]
    detail: Annotated[str, Meta(max_length=1000)]


class Events(Message):
    """What happened in the step from this tick to the next."""

    events: Annotated[list[Happened], Meta(description="maps of `tick`, `what`, `who`, `whom` ('' or the other body), `detail`")]


class State(Message):
    """A bin's, published whenever `full` or `coupled_to` changes."""

    full: Annotated[bool, Meta(description="it holds a whole row")]
    fill: Annotated[Fill, Meta(description="m of row in it, 0 to 70")]
    coupled_to: Annotated[str, Meta(description="the robot that tows it; '' when it stands by itself")]


class Command(OfRun):
    """What a person asks of the run."""

    command: Annotated[Literal["stop"], Meta(description="end the run now")]


class Done(Message):
    """The command is taken."""


class Stop(OfRun):
    """An emergency stop, or its end."""

    stop: Annotated[bool, Meta(description="true: they stand, from the step under way on, until they are reset; false: they are reset")]
    names: Annotated[
        list[Text], Meta(max_length=MOST_BODIES, description="robots, or kinds of them: 'picker_01', 'carrier'; none: all robots")
    ]


class Stopped(Message):
    """The stop, or reset, holds from the step from this tick to the next on."""

    changed: Annotated[list[Name], Meta(description="robots that were stopped, or reset, by this; those that were so before are left out")]
    stopped: Annotated[list[Name], Meta(description="all robots that are stopped now")]


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


Reason = Literal[
    "malformed", "other run", "past tick", "future tick", "not the holder", "not held", "answered already",
    "no such robot", "no such agent", "no such key", "out of bounds", "not all", "too many",
]  # fmt: skip


class RefusedThere(OfRun):
    """What one host, or the logger, has refused."""

    counts: Annotated[
        dict[Reason, Annotated[int, Meta(ge=0, lt=2**53)]], Meta(description="reason -> how many, since it began")
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


def seen_of(run: str, seen: Sights, bodies: Sequence[int], recall: bool) -> Seen:
    """What travels to the holder of these bodies, given by number."""
    names = [seen.names[body] for body in bodies]
    ranges = np.concatenate([seen.scans[body] for body in bodies]) if bodies else np.zeros(0)
    hitches = {name: _other_seen(seen.hitches[name]) for name in names if name in seen.hitches}
    fills = {name: seen.fills[name] for name in names if name in seen.fills}
    full = [name for name in fills if name in seen.full]
    states = seen.states[bodies].astype("<f8", copy=False).tobytes()
    return Seen(run, seen.tick, names, states, ranges.astype("<f4", copy=False).tobytes(), hitches, fills, full, recall)


def _other_seen(hitch: Hitch) -> OtherSeen:
    ranges = None if hitch.scan is None else hitch.scan.astype("<f4", copy=False).tobytes()
    return OtherSeen(hitch.name, (hitch.x, hitch.y, *hitch.orientation, *hitch.twist), ranges)


def sights_of(seen: Seen) -> Sights:
    """What was to be seen, to the last bit. Raises ValueError for arrays that do not fit the names, or hold what is no number."""
    ends = list(accumulate(_beams_of(name) for name in seen.names))
    states, ranges = np.frombuffer(seen.states, "<f8"), np.frombuffer(seen.ranges, "<f4")
    if len(states) != len(ends) * STATE or len(ranges) != (ends[-1] if ends else 0):
        raise ValueError(f"states and ranges do not fit {len(ends)} names")
    if not ((np.abs(states) <= FARTHEST).all() and (ranges >= 0.0).all()):
        raise ValueError("not a number, or out of bounds")
    scans = [ranges[begin:end] for begin, end in zip([0, *ends], ends, strict=False)]
    hitches = {name: _hitch_seen(other) for name, other in seen.hitches.items()}
    return Sights(seen.tick, seen.names, states.reshape(-1, STATE), scans, hitches, seen.fills, seen.full)


def _beams_of(name: str) -> int:
    kind = KINDS.get(kind_of(name))
    if kind is None:
        raise ValueError(f"{name}: there is no such kind")
    return kind.laser.beams


def _hitch_seen(other: OtherSeen) -> Hitch:
    x, y, z, w, vx, vy, turn = other.state
    scan = None if other.ranges is None else _sweep_of("bin", other.ranges)
    return Hitch(other.name, x, y, (z, w), Twist(vx, vy, turn), scan)


def _sweep_of(name: str, ranges: bytes) -> np.ndarray:
    """One body's ranges. Raises ValueError for what its laser cannot have measured."""
    sweep, beams = np.frombuffer(ranges, "<f4"), _beams_of(name)
    if len(sweep) != beams or not (sweep >= 0.0).all():
        raise ValueError(f"ranges of {name}: wanted are {beams}, 0 or more")
    return sweep


def picture_of(run: str, frame: Frame) -> Picture:
    """What travels of a frame, its events apart."""
    scans = None if frame.scans is None else [np.asarray(scan, dtype="<f4").tobytes() for scan in frame.scans]
    lists = {name: _listed(getattr(frame, name)) for name in ("coupled", "fill", "alive", "row_picked")}
    poses = np.asarray(frame.poses, dtype="<f8").tobytes()
    return Picture(run, frame.tick, poses, scans, dict(frame.doing), **lists, delivered=frame.delivered)


def frame_of(picture: Picture, layout: Layout) -> Frame:
    """The frame that was sent. Raises ValueError for one that is not of this orchard, or holds what is no number."""
    bodies, rows = len(layout.names), layout.scenario.rows
    poses = np.frombuffer(picture.poses, dtype="<f8").reshape(-1, 3)
    arrays: dict[str, Any] = {name: _array(getattr(picture, name)) for name in SELDOM}
    lengths = {"row_picked": rows}
    fit = all(array is None or len(array) == lengths.get(name, bodies) for name, array in arrays.items())
    if not fit or len(poses) != bodies or (picture.scans is not None and len(picture.scans) != bodies):
        raise ValueError(f"it is not of {bodies} bodies and {rows} rows")
    if not (np.abs(poses) <= FARTHEST).all():
        raise ValueError("not a number, or out of bounds")
    scans = None if picture.scans is None else [_sweep_of(*sweep) for sweep in zip(layout.names, picture.scans, strict=True)]
    return Frame(picture.tick, poses, picture.doing, scans, **arrays, delivered=picture.delivered)


def _listed(array: np.ndarray | None) -> list[Any] | None:
    return None if array is None else array.tolist()


def _array(values: list[Any] | None) -> np.ndarray | None:
    return None if values is None else np.array(values)


def drive_of(action: Action, mail: bytes, memory: bytes | None) -> Drive:
    """What travels of an action."""
    x, y, turn = action.twist
    doing, waits_for = action.doing[:200], action.waits_for[:200]
    report = Report(action.deeds, doing, waits_for, action.steps_done, mail, memory, written_by(action))
    return Drive(Linear(x, y), Angular(turn), True, report)


def velocity_of(velocities: Velocities, name: str) -> Velocity:
    """One of several, as if it had come on its own."""
    drive = velocities.velocities[name]
    return Velocity(velocities.run, velocities.tick, drive.linear, drive.angular, velocities.holder, drive.once, drive.report)


def action_of(velocity: Velocity) -> Action:
    """The action that was sent, its mail and memory apart."""
    twist = Twist(velocity.linear.x, velocity.linear.y, velocity.angular.z)
    report = velocity.report or Report()
    return Action(twist, report.deeds, doing=report.doing, waits_for=report.waits_for, steps_done=report.steps_done)
