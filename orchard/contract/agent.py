"""The interface of an agent: what it observes, what mail it hears, and what it does.

    action = agent.tick(observation, mail, memory)

An agent uses no socket, no clock and no process. `memory` is None at the first tick, and later the
`memory` of the agent's last action: plain data (msgspec Structs, numbers, strings, lists, maps). It
is sent with the velocity, and the process that runs the agent next receives it.

A body is a robot, a bin, a weed, a person or an animal. A scan holds the ranges that its laser
measures. Each beam ends at a return: the point of a body or a tree that it meets first. The bar is
the rigid coupling between a robot and its bin.
"""

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Annotated, Any, Literal, NamedTuple, Protocol, get_args

import msgspec
import numpy as np
from msgspec import Meta

from orchard.contract.messages import MAX_PAYLOAD, Answer, Deed, Metres, Request, Text, Tick, Word
from orchard.contract.zone import Zone
from orchard.field.geometry import STILL, Pose, Twist, yaw_of

State = Literal[
    "picking",
    "driving",
    "waiting",
    "calling",
    "handling a bin",
    "hauling",
    "unloading",
    "resting",
    "stopped",
    "broken",
    "failed",
]
STATES: tuple[State, ...] = get_args(State)
# The states of a picker or a bin that waits for a carrier.
WAITING_STATES: tuple[State, ...] = ("waiting", "calling")

# `waits_for` of a robot that is held up by something of which it knows only returns of its laser.
AHEAD = "an obstacle ahead"
IN_TURN = "an obstacle in its turn"

# Limits for what an agent sends.
# Deeds of one body in one tick.
MOST_DEEDS = 16
# Requests of one agent in one tick. The largest orchard has some 300 agents.
MOST_REQUESTS = 500
# Requests to one recipient, which must be able to answer all that it hears.
MOST_TO_ONE = 8
# The largest whole number that JavaScript and others who read numbers as doubles keep exactly.
MOST_STEPS = 2**53 - 1
# Ticks, of 0.1 s, after which an agent is asked again, however long its hold is.
MOST_HOLD = 1000
# Zones of each kind (`watch`, `still`) in a hold.
MOST_ZONES = 4
# Lists and maps within each other in the fields of a message of an agent's own type.
MOST_LEVELS = 32
# Bytes, 32 KiB: of one agent's memory, and of its deeds and messages of one tick together.
LARGEST_MEMORY = MAX_PAYLOAD // 32


class Hitch(NamedTuple):
    """The body at the other end of the bar, in the frame `map`.

    A robot observes its bin, and a bin observes its robot.
    """

    name: str
    x: float  #: m, east
    y: float  #: m, north
    orientation: tuple[float, float]  #: z and w of a unit quaternion
    #: Its velocity in the last step, in its own frame, m/s and rad/s.
    twist: Twist
    #: To a robot: its bin's ranges, m, (60,) float32. To a bin: None, for it gets no scan of its
    #: robot.
    scan: np.ndarray | None

    @property
    def pose(self) -> Pose:
        """Its position, m, and its yaw, rad."""
        return Pose(self.x, self.y, yaw_of(*self.orientation))


class Observation(msgspec.Struct, frozen=True, dict=True):
    """What one body observes at one tick, in the frame `map`.

    Pose and twist are what the body's sensors measure. If the scenario sets errors for them they
    are not the truth, see docs/reference.md. An agent without a body has x and y NaN and scan None.

    It is read-only, and so are its arrays. `msgspec.structs.replace` returns a changed copy,
    `scan.copy()` an array to change.
    """

    name: str
    tick: int
    x: float  #: m, east
    y: float  #: m, north
    orientation: tuple[float, float]  #: z and w of a unit quaternion
    #: Its velocity in the last step, in its own frame, m/s and rad/s.
    twist: Twist
    #: Ranges, m: (180,) or, of bins and weeds, (60,) float32; +inf without a return (REP-117).
    scan: np.ndarray
    #: The body at the other end of its bar; None if nothing is coupled.
    hitch: Hitch | None = None
    #: Of a bin: metres of row in it, 0 to what fills it.
    fill: float = 0.0
    #: Of a bin: whether it is full, or left by its picker part full, the last of a harvest.
    full: bool = False
    #: The standard deviation of x and of y, as its receiver tells, m; 0: exact.
    accuracy: float = 0.0
    #: Charge of its battery, 0 (flat) to 1 (full); 1 without one.
    charge: float = 1.0

    @cached_property
    def pose(self) -> Pose:
        """Its position, m, and its yaw, rad."""
        return Pose(self.x, self.y, yaw_of(*self.orientation))


def with_own_arrays(seen: Observation) -> Observation:
    """Return an observation whose scans are new views of the same read-only ranges.

    So an agent that sets the `shape` of its scan changes it for itself only.
    """
    hitch = seen.hitch
    if hitch is not None and hitch.scan is not None:
        hitch = hitch._replace(scan=hitch.scan.view())
    scan = seen.scan
    if scan is not None:
        scan = scan.view()
    return msgspec.structs.replace(seen, scan=scan, hitch=hitch)


def without_body(name: str, tick: int) -> Observation:
    """Return the observation of an agent without a body."""
    return Observation(
        name=name,
        tick=tick,
        x=math.nan,
        y=math.nan,
        orientation=(0.0, 1.0),
        twist=STILL,
        # The type says that there is a scan, because each body has one.
        scan=None,  # type: ignore[arg-type]
    )


class Heard(NamedTuple):
    """A request that arrived. It can be answered only in the tick in which it is heard."""

    sender: str
    #: The tick at which it was sent.
    tick: int
    #: Its place among the sender's requests of that tick, from 0.
    number: int
    body: Request


class Reply(NamedTuple):
    """The result of a request of two ticks ago: the answer, or None if there was no answer."""

    #: The sender of the answer: the agent that the request went to.
    sender: str
    #: The place of the request among those of its tick, from 0.
    number: int
    request: Request
    #: The answer; None if there was none.
    body: Answer | None


@dataclass(slots=True)
class Mail:
    """The mail that an agent hears at one tick.

    Requests are sorted by kind, sender and number, replies by number.
    """

    requests: list[Heard] = field(default_factory=list)
    replies: list[Reply] = field(default_factory=list)


# What a run does with holds. "on": an agent that holds is not asked. "ignored": each agent is asked
# at each tick. "checked": each is asked, and one that breaks its promise is logged, but only the
# actions that "on" would ask for count.
Holds = Literal["on", "ignored", "checked"]


class Hold(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A promise of an agent: if it were asked before the tick `until`, it would answer the same.

    That is the same velocity, the same `doing`, `state` and `waits_for`, and no deed, request or
    answer. So the agent is not asked, and its velocity is applied again. It is asked at the tick
    `until` at the latest, and at the first tick at which

    - it hears mail: a request, or the reply to its own;
    - its body did not move with its velocity in the last step: the step was refused, limited, or
      stopped;
    - its body was coupled or uncoupled, or is a bin that got full or empty; or the body at the
      other end of the bar changed its velocity;
    - a zone of `watch` that was empty when it answered has a return in it, or the contrary;
    - a return in a zone of `still` has come, gone or changed since the tick before;
    - with `freer_within`: the freer side, left or right, is another one than when it answered. That
      is the side of which fewer beams return within so many metres;
    - another process runs it.

    In realtime it is asked at every tick.

    >>> ahead = Zone(x_min=0.0, x_max=2.0, y_min=-0.5, y_max=0.5)
    >>> hold = Hold(until=120, watch=(ahead,))  # drive on until something comes within 2 m
    """

    # At most MOST_HOLD ticks ahead count.
    until: Tick
    watch: Annotated[
        tuple[Zone, ...],
        Meta(max_length=MOST_ZONES, description="ask when a return enters or leaves one"),
    ] = ()
    still: Annotated[
        tuple[Zone, ...],
        Meta(max_length=MOST_ZONES, description="ask when a return in one changes"),
    ] = ()
    freer_within: Annotated[
        Metres, Meta(description="m; ask when the freer side changes; 0: never")
    ] = 0.0


Deeds = Annotated[
    list[Deed],
    Meta(
        max_length=MOST_DEEDS,
        description="couple, uncouple, flatten, pickfrom; physics decides on each",
    ),
]
Asked = Annotated[
    list[tuple[Word, Request]],
    Meta(max_length=MOST_REQUESTS, description="numbered by place from 0"),
]
Steps = Annotated[
    int, Meta(ge=0, le=MOST_STEPS, description="steps of its plan that it has finished")
]


class Action(msgspec.Struct, forbid_unknown_fields=True):
    """What an agent returns from a tick: velocity, deeds, messages, memory and status.

    >>> action = Action(Twist(x=0.5), doing="driving to the bay")
    >>> state_of(action)
    'driving'
    """

    twist: Annotated[Twist, Meta(description="forward, left (m/s), counter-clockwise (rad/s)")] = (
        STILL
    )
    deeds: Deeds = []
    requests: Asked = []
    #: Each request that it answers, with the answer. Only requests of this tick can be answered.
    answers: list[tuple[Heard, Answer]] = []
    #: What it gets as its memory at its next tick.
    memory: Any = None
    doing: Annotated[Text, Meta(description="present participle, for people: 'picking row 3'")] = ""
    state: Annotated[
        State | None,
        Meta(description="for programs; nil: 'driving' while it moves, else 'resting'"),
    ] = None
    waits_for: Annotated[Text, Meta(description="what holds it up")] = ""
    steps_done: Steps = 0
    hold: Annotated[
        Hold | None,
        Meta(description="until when it need not be asked; nil: it is asked at the next tick"),
    ] = None


def says_holds(class_: type) -> bool:
    """Whether the holds of a user's agent or step count.

    They do if its own class says `holds = True`. A base class cannot promise it for the classes
    that are derived from it, which may answer otherwise.
    """
    return vars(class_).get("holds", False) is True


def state_of(action: Action) -> State:
    """Return the state in an action.

    Without one it is 'driving' if the action moves the body, else 'resting'.
    """
    if action.state is not None:
        return action.state
    if action.twist == STILL:
        return "resting"
    return "driving"


class Agent(Protocol):
    """Any object with this method can drive a body."""

    @property
    def Memory(self) -> type:  # noqa: N802 - agents have a class of this name
        """The type of its memory, to decode it from bytes."""

    def tick(self, observation: Observation, mail: Mail, memory: Any, /) -> Action:
        """Return what it does at this tick, and what it wants to know at the next one."""


# How many numbers are in a body's state: x, y, the quaternion's z and w, linear x and y, angular z.
STATE = 7


class Scans(Sequence[np.ndarray]):
    """The scans of n bodies as views of one array, made when they are asked for."""

    def __init__(self, ranges: np.ndarray, begin: Sequence[int]) -> None:
        """`ranges`: of all bodies, one after another, m, float32.

        `begin`, (n + 1,): the index in `ranges` at which each body's begin, then their length.
        """
        self.ranges = ranges
        self._begin = begin

    def __len__(self) -> int:
        return len(self._begin) - 1

    def __getitem__(self, body: Any) -> Any:
        # A range indexes as a list does: from the end too, by slices, and with an IndexError.
        index = range(len(self))[body]
        if isinstance(index, range):
            return [self[i] for i in index]
        return self.ranges[self._begin[index] : self._begin[index + 1]]

    def __iter__(self) -> Iterator[np.ndarray]:
        return (self.ranges[first:end] for first, end in pairwise(self._begin))


@dataclass(slots=True)
class Observations:
    """The observations of n bodies at one tick."""

    tick: int
    # Name -> its row in the arrays, in their order.
    names: Mapping[str, int]
    # (n, 7) float64: x, y (m), the quaternion's z, w, and the last step's linear x, y (m/s) and
    # angular z (rad/s).
    states: np.ndarray
    # n scans, m: (180,) or, of bins and weeds, (60,) float32.
    scans: Sequence[np.ndarray]
    # Name of a coupled body -> the body at the other end of its bar.
    hitches: Mapping[str, Hitch]
    # Name of a bin that is not empty -> metres of row in it.
    fills: Mapping[str, float]
    # Names of the full bins.
    full: Collection[str]
    # Name of a body that measures x and y with errors -> their standard deviation, m.
    accuracies: Mapping[str, float] = field(default_factory=dict)
    # Name of a body with a battery -> its charge, 0 to 1.
    charges: Mapping[str, float] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Observation:
        """Return the observation of one body. Raises KeyError for an unknown name."""
        body = self.names[name]
        x, y, z, w, vx, vy, turn = self.states[body].tolist()
        return Observation(
            name=name,
            tick=self.tick,
            x=x,
            y=y,
            orientation=(z, w),
            twist=Twist(vx, vy, turn),
            scan=self.scans[body],
            hitch=self.hitches.get(name),
            fill=self.fills.get(name, 0.0),
            full=name in self.full,
            accuracy=self.accuracies.get(name, 0.0),
            charge=self.charges.get(name, 1.0),
        )

    def __deepcopy__(self, memo: dict[int, Any]) -> "Observations":
        # The names are shared with the layout and read-only, so they are not copied.
        return Observations(self.tick, self.names, *deepcopy(self._parts(), memo))

    def __reduce__(self) -> tuple[Any, ...]:
        """Return what pickle stores. The names become a dict: a read-only map has no pickle."""
        return Observations, (self.tick, dict(self.names), *self._parts())

    def _parts(self) -> tuple[Any, ...]:
        """Return all but the tick and the names, in the order of the constructor."""
        return (
            self.states,
            self.scans,
            self.hitches,
            self.fills,
            self.full,
            self.accuracies,
            self.charges,
        )

    def of(self, names: Iterable[str]) -> dict[str, Observation]:
        """Return the observations of these agents, by name.

        An agent without a body observes the tick only.
        """
        observations = {}
        for name in names:
            if name in self.names:
                observations[name] = self[name]
            else:
                observations[name] = without_body(name, self.tick)
        return observations
