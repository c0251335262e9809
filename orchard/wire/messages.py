"""The messages on the wire: msgpack maps with ROS's field names, SI units and bounds. keyspace.md
is generated from them.

In this order: poses and twists as in ROS's geometry_msgs; messages from physics to agents, from
agents to physics and between agents; messages about the run and its sessions (join, stop, end);
messages for observers.
"""

from typing import Annotated, Any, Literal, NamedTuple, TypeVar

import msgspec
from msgspec import Meta, Raw

from orchard.contract.agent import LARGEST_MEMORY, MOST_STEPS, Action, Deeds, State
from orchard.contract.events import Event
from orchard.contract.messages import (
    FASTEST,
    MAX_PAYLOAD,
    Answer,
    Given,
    Metres,
    Request,
    Text,
    Tick,
    Written,
    unpack,
)
from orchard.field.problems import printable
from orchard.field.survey import MOST_ROWS

FARTHEST = 1e6  # m or m/s: no coordinate and no speed is larger
MOST_BODIES = 10_000
# bytes: the memories of 512 agents, or ten ticks of the largest orchard.
LARGEST_OF_MANY = 16 * MAX_PAYLOAD

# the longest descriptions of fields
ALL_RANGES = (
    "m, little-endian float32: for each body as many as its laser has beams; +inf for a beam "
    "without a return"
)
OWNER = "the session id in the sender's liveliness token; '' if the sender owns no agent"
NAMES = "their bodies, in the order of the arrays; agents without a body stand in `due` only"
ONCE = (
    "realtime; true: it drives for one step, from the pose that it answers; false: until a "
    "newer one"
)
POSES = (
    "x, y (m), yaw (rad) of each body, in the order of `agents` in the reply to `scenario`, "
    "little-endian float64"
)
RANGES = "m, little-endian float32, 4 bytes per beam; +inf for a beam without a return (REP-117)"
ACCURACIES = "name -> the same as `accuracy` in `pose`; only bodies whose poses are not exact"
SIMULATION = (
    "'stopped': before the first tick, physics waits for agents; 'paused': simulated time "
    "stands; 'quitting': the run is over"
)
SEVEN = (
    "x, y (m); z, w of the quaternion; linear.x, linear.y (m/s) and angular.z (rad/s) of the "
    "last step"
)
LETTERS = (
    "sender -> `requests`, numbered from 0: [to, request]; `answers`: [to, tick, number, answer]"
)
WALLS = (
    "x, y of the centre, half the size along x, half along y: four fences, then trunks and posts"
)
CHARGES = "name -> charge of its battery, 0 to 1; once a second, only bodies that have one"
ROWS_OF_PICKER = "for a picker: the rows that it picks, in its order, numbered from 1 at the north"
ROBOTS = "robots or kinds of robots: 'picker_01', 'carrier'; empty: all robots"
WHY = (
    "why it ended: 'harvested', 'duration', 'stopped', 'broken' (all pickers), 'jammed' or "
    "'refused'; 'reset': it begins again"
)
VELOCITIES = (
    "name -> linear.x, linear.y (m/s), angular.z (rad/s) of the step, then those that its "
    "agent wanted; only if changed"
)

M = TypeVar("M")
Run = Annotated[
    str, Meta(max_length=64, description="the run's id, as in the reply to the scenario query")
]
Name = Annotated[str, Meta(max_length=64, pattern=r"^[a-z][a-z0-9_]*\Z")]
# A name that is looked up; matching the pattern costs more time than reading the rest.
KnownName = Annotated[str, Meta(max_length=64)]
Session = Annotated[str, Meta(max_length=64, pattern=r"^[A-Za-z0-9_-]+\Z")]
Owner = Annotated[str, Meta(max_length=64, pattern=r"^[A-Za-z0-9_-]*\Z", description=OWNER)]
Speed = Annotated[float, Meta(ge=-FASTEST, le=FASTEST)]
Zero = Annotated[float, Meta(ge=0.0, le=0.0)]
Unit = Annotated[float, Meta(ge=-1.001, le=1.001)]
Box = tuple[Metres, Metres, Metres, Metres]
Ranges = Annotated[bytes, Meta(max_length=4096, description=RANGES)]
Fill = Annotated[float, Meta(ge=0.0, le=1e3)]
Charge = Annotated[float, Meta(ge=0.0, le=1.0)]
Body = Annotated[int, Meta(ge=-1, lt=MOST_BODIES)]
Once = Annotated[bool, Meta(description=ONCE)]
Memory = Annotated[bytes, Meta(max_length=LARGEST_MEMORY)]
DoneAndWanted = Annotated[list[Speed], Meta(min_length=6, max_length=6)]
States = Annotated[
    dict[Name, State], Meta(description="name -> its state; the same names as in `doing`")
]


class SubMessage(msgspec.Struct, forbid_unknown_fields=True):
    """A map inside a message."""


class RunMessage(SubMessage):
    """A map with the run's id."""

    run: Run


class Message(RunMessage):
    """A map with the run's id and the tick."""

    tick: Tick


def read(payload: bytes, type_: type[M]) -> M:
    """Return the message in a payload. Raises ValueError, with the reason, if it is too large or
    not such a message.
    """
    most = LARGEST_OF_MANY if type_ in (Joined, Bundle) else MAX_PAYLOAD
    if len(payload) > most:
        raise ValueError(f"{len(payload)} bytes; at most {most}")
    message: M = unpack(payload, type_)
    return message


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


class AskedOf(NamedTuple):
    """A request of the tick before, without its body."""

    to: Name
    sender: Name
    number: int


class OtherSeen(SubMessage):
    """The body that is coupled to a body of `Seen`."""

    name: KnownName
    state: Annotated[
        tuple[Metres, Metres, Unit, Unit, Speed, Speed, Speed],
        Meta(description="its seven numbers, as in `states`"),
    ]
    ranges: Annotated[
        Ranges | None, Meta(description="for a robot that tows: the ranges of its bin; else nil")
    ] = None


class Seen(Message):
    """What the agents of one session that are asked at this tick observe: the content of `pose` and
    `scan` as arrays.
    """

    due: Annotated[
        list[KnownName],
        Meta(max_length=MOST_BODIES, description="its agents that are asked at this tick"),
    ]
    names: Annotated[list[KnownName], Meta(max_length=MOST_BODIES, description=NAMES)]
    states: Annotated[bytes, Meta(description=f"seven little-endian float64 per body: {SEVEN}")]
    ranges: Annotated[bytes, Meta(description=ALL_RANGES)]
    hitches: Annotated[
        dict[KnownName, OtherSeen],
        Meta(description="name -> the body at the other end of its bar; only coupled bodies"),
    ]
    fills: Annotated[
        dict[KnownName, Fill],
        Meta(description="name -> metres of row in it; only bins that are not empty"),
    ]
    full: Annotated[
        list[KnownName], Meta(max_length=MOST_BODIES, description="the bins that are full")
    ]
    asked: Annotated[
        list[AskedOf],
        Meta(description="lockstep: the requests of the tick before that these agents hear now"),
    ] = []
    accuracies: Annotated[dict[KnownName, Fill], Meta(description=ACCURACIES)] = {}
    percentages: Annotated[
        dict[KnownName, Charge],
        Meta(description="name -> charge of its battery; only bodies that have one"),
    ] = {}


class Report(Action, omit_defaults=True):
    """The action of an agent, as its session sends it: answers name the number of a request, and
    the memory is bytes.
    """

    answers: list[Given] = []  # type: ignore[assignment]
    memory: Annotated[
        Memory | None,
        Meta(description="the agent's memory, for the session that runs it next; nil: unchanged"),
    ] = None
    mail: Annotated[
        bytes,
        Meta(max_length=64, description="digest of the mail heard at this tick; empty without"),
    ] = b""
    once: Once = False

    def __post_init__(self) -> None:
        """Raise ValueError for a velocity out of bounds, and make the texts printable, whatever a
        client sent.
        """
        x, y, turn = self.twist
        if not (abs(x) <= FASTEST and abs(y) <= FASTEST and abs(turn) <= FASTEST):
            raise ValueError(f"{self.twist}: each number must be from {-FASTEST:g} to {FASTEST:g}")
        self.doing, self.waits_for = printable(self.doing), printable(self.waits_for)


class Velocities(Message):
    """The actions of the agents of one session that are asked: its answer to `Seen` of the same
    tick.
    """

    owner: Owner
    velocities: Annotated[
        dict[KnownName, Report],
        Meta(max_length=MOST_BODIES, description="name -> the action of its agent"),
    ]


class VelocityParts(Message):
    """`Velocities` of which some action is malformed: each as bytes, so that the others count."""

    owner: Owner
    velocities: Annotated[dict[KnownName, Raw], Meta(max_length=MOST_BODIES)]


class Velocity(Message):
    """geometry_msgs/Twist, in the body's own frame: the answer to the pose and scan of the same
    tick.
    """

    linear: Linear
    angular: Angular
    owner: Owner = ""
    once: Once = False
    deeds: Deeds = []


class Advice(Message):
    """geometry_msgs/Twist, in the body's own frame: a velocity in place of that of the robot's
    agent.
    """

    linear: Linear
    angular: Angular


class Letter(Message):
    """A request from one agent to another, stamped with the tick in which it is sent."""

    sender: Annotated[Name, Meta(description="the agent that asks")]
    number: Annotated[
        int,
        Meta(
            ge=0,
            lt=2**31,
            description="its number among the requests of the sender in that tick, from 0",
        ),
    ]
    body: Annotated[Request, Meta(description="one of the requests")]


class Received(Message, tag_field="type", tag="received"):
    """First reply to a request: the request arrived, and will be heard at the next tick."""


class Answered(Message, tag_field="type", tag="answered"):
    """Second reply to a request. Its tick is the one in which the request was heard: the tick of
    the request + 1.
    """

    body: Annotated[
        Answer | None,
        Meta(description="one of the answers; nil: the request was heard and gets no answer"),
    ]


class Letters(Message):
    """All requests and answers of one tick."""

    letters: Annotated[dict[Name, Written], Meta(description=LETTERS)]


class Recall(Message):
    """A query for the mail of this tick, from a host that may have missed it."""


class Recalled(Message):
    """All requests and answers of the two ticks before."""

    letters: Annotated[
        list[tuple[Tick, dict[Name, Written]]],
        Meta(description="[tick, sender -> as in `letters`]"),
    ]


Mode = Literal["lockstep", "realtime"]


class RunInfo(Message):
    """The reply to the scenario query: what a client must know before it joins."""

    mode: Annotated[
        Mode, Meta(description="whether physics waits for its agents or keeps to the wall clock")
    ]
    agents: Annotated[list[Name], Meta(description="the names of all agents")]
    scenario: Annotated[
        dict[str, Any], Meta(description="the scenario file as a map, with all default values")
    ]


class Place(SubMessage):
    """A body at the start of the run."""

    name: Name
    kind: Annotated[Name, Meta(description="its kind, a name in `kinds`")]
    pose: PoseMessage
    bin: Annotated[str, Meta(description="the bin on its bar; '' for none")] = ""
    rows: Annotated[list[int], Meta(max_length=MOST_ROWS, description=ROWS_OF_PICKER)] = []


class LaserOfKind(SubMessage):
    """The laser of a kind of body. Its frame has the directions of the body's."""

    x: Annotated[
        Metres,
        Meta(
            description=(
                "m from the body's centre forward to the laser; it is in the middle of the width"
            )
        ),
    ]
    beams: Annotated[int, Meta(ge=1, description="number of ranges of a scan")]
    angle_min: Annotated[Metres, Meta(description="rad, as in `scan`")]
    angle_increment: Annotated[Metres, Meta(description="rad, as in `scan`")]
    range_min: Annotated[Metres, Meta(description="m, as in `scan`")]
    range_max: Annotated[Metres, Meta(description="m, as in `scan`")]


class KindOfBody(SubMessage):
    """What all bodies of a kind have in common. A body is a box; `base_link` is at its centre, on
    the ground.
    """

    length: Annotated[Metres, Meta(description="m, along x of `base_link`")]
    width: Annotated[Metres, Meta(description="m, along y of `base_link`")]
    height: Annotated[Metres, Meta(description="m")]
    colour: Annotated[tuple[int, int, int], Meta(description="red, green, blue, 0 to 255 (sRGB)")]
    max_linear: Annotated[Speed, Meta(description="m/s, the most forward and back")]
    max_angular: Annotated[Speed, Meta(description="rad/s, the most to each side")]
    tows: Annotated[
        Metres,
        Meta(
            description="m from its centre back to the centre of a coupled bin; 0: it tows nothing"
        ),
    ]
    solid: Annotated[bool, Meta(description="whether lasers see it and bodies collide with it")]
    robot: Annotated[
        bool,
        Meta(description="whether it is a robot: it can be stopped, and its states are counted"),
    ]
    laser: LaserOfKind


class Orchard(Message):
    """The reply to the layout query: all that does not change during the run. Lengths in m, in the
    frame `map`.
    """

    walls: Annotated[list[Box], Meta(description=WALLS)]
    rows: Annotated[
        list[Box],
        Meta(
            description=(
                "from the north: x, y of the west end and x, y of the east end of the part "
                "that is picked"
            )
        ),
    ]
    bodies: Annotated[
        list[Place],
        Meta(
            max_length=MOST_BODIES,
            description="all bodies, in the order of `agents`, as they start",
        ),
    ]
    kinds: Annotated[
        dict[Name, KindOfBody],
        Meta(
            description="what bodies of each kind have in common, also of kinds without a body here"
        ),
    ]


class Join(RunMessage):
    """A request of a host to own agents. The host declares its liveliness tokens, subscribers and
    queryables before it joins.
    """

    owner: Owner
    names: Annotated[
        list[Name],
        Meta(
            max_length=MOST_BODIES,
            description="the agents that it wants to own; it gets all of them or none",
        ),
    ]


class Joined(Message):
    """The reply to a join: from this tick on, physics waits for the owner's velocities for these
    agents.
    """

    memories: Annotated[
        dict[Name, bytes | None], Meta(description="name -> its last memory; nil: it never had one")
    ]
    refused: Annotated[dict[Name, str], Meta(description="name -> why the session cannot own it")]


class Lost(Message):
    """Agents that physics no longer waits for, because their session is gone or was silent for too
    long. It may join again.
    """

    names: Annotated[list[Name], Meta(description="the agents")]
    owner: Annotated[Owner, Meta(description="the session that owned them")]


StateOfSimulation = Literal["stopped", "playing", "paused", "quitting"]


class SimulationState(Message):
    """The result of GetSimulationState in ROS's simulation_interfaces. The names are those of its
    constants without `STATE_`.
    """

    state: Annotated[StateOfSimulation, Meta(description=SIMULATION)]


class SetSimulationState(RunMessage):
    """SetSimulationState in simulation_interfaces."""

    state: Annotated[
        Literal["playing", "paused", "quitting"], Meta(description="'quitting' ends the run now")
    ]


class StepSimulation(RunMessage):
    """StepSimulation in simulation_interfaces."""

    steps: Annotated[
        int,
        Meta(
            ge=1, le=MOST_STEPS, description="how many steps of 0.1 s; then the run is paused again"
        ),
    ] = 1


class ResetSimulation(RunMessage):
    """ResetSimulation in simulation_interfaces."""

    seed: Annotated[
        int | None, Meta(description="of the scenario from now on, 0 or more; nil: as before")
    ] = None


class Stop(RunMessage):
    """An emergency stop of robots, or its reset."""

    stop: Annotated[
        bool,
        Meta(
            description=(
                "true: the robots stand from the present step on, until they are reset; false: "
                "they are reset"
            )
        ),
    ]
    names: Annotated[list[Text], Meta(max_length=MOST_BODIES, description=ROBOTS)]


class Stopped(Message):
    """The stop or reset is in force, beginning with the step from this tick to the next."""

    changed: Annotated[
        list[Name],
        Meta(
            description="robots that this query stopped or reset, without those that already were"
        ),
    ]
    stopped: Annotated[list[Name], Meta(description="all robots that are stopped now")]
    kept: Annotated[
        bool,
        Meta(
            description=(
                "whether it is on the disk; else it is in force, but is lost if physics dies now"
            )
        ),
    ] = False


Reason = Literal[
    "malformed", "other run", "past tick", "future tick", "not the owner", "not owned",
    "answered already", "no such robot", "no such agent", "no such key", "out of bounds", "not all",
    "too many", "not paused", "recorded",
    "not kept",
]  # fmt: skip


# Reason -> number of refused messages.
Counts = dict[Reason, Annotated[int, Meta(ge=0, lt=2**53)]]


class RefusedThere(RunMessage):
    """The numbers of messages that one host, or the logger, has refused."""

    counts: Annotated[Counts, Meta(description="reason -> how many since the session began")]


class Refusal(Message):
    """A message that physics has refused: it was not applied."""

    key: Annotated[Text, Meta(description="the key on which it came")]
    reason: Annotated[Reason, Meta(description="see 'What is refused' in keyspace.md")]
    detail: Annotated[str, Meta(description="what is wrong with it")]
    session: Annotated[
        str,
        Meta(description="its session: the one in its key, or its `owner`; '' if it names none"),
    ] = ""


class Left(RunMessage):
    """A session that owns agents leaves for good: the run is over for it, or a user has asked it to
    end.
    """


# Why a run has ended that begins again.
RESET = "reset"


class End(Message):
    """The last message of a run."""

    finished: Annotated[bool, Meta(description="whether the harvest is complete")]
    why: Annotated[str, Meta(description=WHY)]
    hash: Annotated[str, Meta(description="SHA-256 over all ticks, hexadecimal")]
    summary: Annotated[dict[str, Any], Meta(description="the figures of the whole run")]


class Events(Message):
    """The events of the step from this tick to the next."""

    events: Annotated[
        list[Event],
        Meta(description="maps of `tick`, `what`, `who`, `whom` ('' or the other body), `detail`"),
    ]


class BinStatus(Message):
    """The state of a bin, published when `full` or `coupled_to` changes."""

    full: Annotated[
        bool, Meta(description="whether it is full, or the last of a harvest, left part full")
    ]
    fill: Annotated[Fill, Meta(description="metres of row in it, 0 to what fills it")]
    coupled_to: Annotated[str, Meta(description="the robot that tows it; '' if none")]


ROW_ENDS = (
    "for each row, the metres picked from its west end, from its east end, and as far as a "
    "part inside is picked from each; 0: none"
)


class Picture(Message):
    """The orchard after the step to this tick, for observers. `nil` means unchanged. It is `whole`
    every 5 s, and when a logger joins.
    """

    poses: Annotated[bytes, Meta(description=POSES)]
    scans: Annotated[
        list[bytes] | None,
        Meta(description="twice per second: the ranges of each body, m, little-endian float32"),
    ]
    doing: Annotated[
        dict[Name, str], Meta(description="name -> what it does; only if that has changed")
    ]
    coupled: Annotated[
        list[Body] | None,
        Meta(description="for each body, the index of the body at the other end of its bar, or -1"),
    ]
    fill: Annotated[
        list[Fill] | None, Meta(description="for each bin, metres of row in it; 0 for other bodies")
    ]
    alive: Annotated[
        list[bool] | None, Meta(description="for each body; false for a weed that is flattened")
    ]
    row_ends: Annotated[list[tuple[Fill, Fill, Fill, Fill]] | None, Meta(description=ROW_ENDS)]
    delivered: Annotated[int, Meta(ge=0, description="bins unloaded so far")]
    states: States = {}
    whole: Annotated[
        bool,
        Meta(description="whether all fields but `scans` are complete; else they hold changes"),
    ] = False
    velocities: Annotated[dict[Name, DoneAndWanted], Meta(description=VELOCITIES)] = {}
    charges: Annotated[dict[Name, Charge], Meta(description=CHARGES)] = {}


class Bundle(Message):
    """What observers get of some ticks in one message, for a logger: one by one, ten ticks cost
    some six times as much.
    """

    events: list[Events]
    letters: list[Letters]
    pictures: Annotated[
        list[Picture],
        Meta(
            description=(
                "the picture of a tick is that after the events and letters of the tick before"
            )
        ),
    ]


class Figures(Message):
    """The figures of the run so far."""

    figures: Annotated[dict[str, Any], Meta(description="name -> number, or a map of numbers")]
    doing: Annotated[dict[Name, str], Meta(description="name -> what it does")]
    waits_for: Annotated[
        dict[Name, str], Meta(description="name -> what it waits for; only for agents that wait")
    ]
    messages_refused: Annotated[
        dict[str, int], Meta(description="reason -> how many since the run began")
    ]
    states: States = {}
