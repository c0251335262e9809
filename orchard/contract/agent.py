"""The interface of an agent: what it observes, what mail it hears, and what it does. An agent uses no socket, no clock and no process.

    action = agent.tick(observation, mail, memory)

`memory` is None at the first tick, and later the `memory` of the agent's last action: plain data (msgspec Structs, numbers, strings,
lists, maps). It is sent with the velocity, and the process that runs the agent next receives it.
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
    "picking", "driving", "waiting", "calling", "handling a bin", "hauling", "unloading", "resting", "stopped", "broken", "failed"
]  # fmt: skip
STATES: tuple[State, ...] = get_args(State)
WAITING_STATES: tuple[State, ...] = (
    "waiting",
    "calling",
)  # of a picker or a bin that waits for a carrier

AHEAD, IN_TURN = (
    "an obstacle ahead",
    "an obstacle in its turn",
)  # what a robot waits for that sees only returns of a laser

# limits for what an agent sends
MOST_DEEDS = 16  # of one body in one tick
MOST_REQUESTS = 500  # of one agent in one tick; the largest orchard has some 300 agents
MOST_TO_ONE = 8  # of these to one recipient, which must be able to answer all that it hears
MOST_STEPS = 2**53 - 1
MOST_HOLD = 1000  # ticks after which an agent is asked again, whatever it holds
MOST_ZONES = 4  # of each kind in a hold
MOST_LEVELS = (
    32  # of lists and maps within each other in the fields of a message of an agent's own type
)
LARGEST_MEMORY = MAX_PAYLOAD // 32  # bytes


class Hitch(NamedTuple):
    """The body at the other end of the bar, in the frame `map`: a robot observes its bin, and a bin its robot."""

    name: str
    x: float
    y: float
    orientation: tuple[float, float]  #: quaternion z, w
    twist: Twist  #: its velocity in the last step
    scan: (
        np.ndarray | None
    )  #: the bin's ranges, m, (60,) float32; None for a bin, which does not receive its robot's

    @property
    def pose(self) -> Pose:
        return Pose(self.x, self.y, yaw_of(*self.orientation))


class Observation(msgspec.Struct, frozen=True, dict=True):
    """The observation of one body at one tick, in the frame `map`. An agent without a body has x and y NaN and scan None.

    Pose and twist are what the body's sensors measure. If the scenario sets errors for them they are not the truth, see docs/reference.md.
    It is read-only, and so are its arrays. `msgspec.structs.replace` returns a changed copy, `scan.copy()` an array to change.
    """

    name: str
    tick: int
    x: float  #: m, east
    y: float  #: m, north
    orientation: tuple[float, float]  #: quaternion z, w
    twist: Twist  #: its velocity in the last step, in its own frame
    scan: (
        np.ndarray
    )  #: ranges, m: (180,) or, of bins and weeds, (60,) float32; +inf without a return (REP-117)
    hitch: Hitch | None = None
    fill: float = 0.0  #: of a bin: metres of row in it, 0 to what fills it
    full: bool = False  #: of a bin: full, or left by its picker part full, the last of a harvest
    accuracy: float = (
        0.0  #: m, the standard deviation of x and of y, as its receiver tells; 0: exact
    )
    charge: float = 1.0  #: of its battery, 0 (flat) to 1 (full); 1 without one

    @cached_property
    def pose(self) -> Pose:
        return Pose(self.x, self.y, yaw_of(*self.orientation))


def with_own_arrays(seen: Observation) -> Observation:
    """Return an observation with arrays of its own: an agent that sets the `shape` of its scan changes it for itself only."""
    hitch = seen.hitch and seen.hitch._replace(
        scan=None if seen.hitch.scan is None else seen.hitch.scan.view()
    )
    return msgspec.structs.replace(
        seen, scan=None if seen.scan is None else seen.scan.view(), hitch=hitch
    )


def without_body(name: str, tick: int) -> Observation:
    """Return the observation of an agent without a body."""
    return Observation(name, tick, math.nan, math.nan, (0.0, 1.0), STILL, None)  # type: ignore[arg-type]  # never None for a body


class Heard(NamedTuple):
    """A request that arrived. It can be answered only in the tick in which it is heard."""

    sender: str
    tick: int  #: at which it was sent
    number: int  #: among the sender's requests of that tick
    body: Request


class Reply(NamedTuple):
    """The result of a request of two ticks ago: the answer, or None if there was no answer."""

    sender: str  #: the agent that was asked
    number: int
    request: Request
    body: Answer | None


@dataclass(slots=True)
class Mail:
    """The mail that an agent hears at one tick: requests sorted by kind, sender and number, replies by number."""

    requests: list[Heard] = field(default_factory=list)
    replies: list[Reply] = field(default_factory=list)


Holds = Literal["on", "ignored", "checked"]  # what a run does with holds


class Hold(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A promise: until then, asked again, the agent would give the same velocity, no deed, request or answer, and tell the same of itself.

    So it is not asked, and its velocity is applied again. It is asked at the tick `until` at the latest, and at the first tick at which

    - it hears mail: a request, or the reply to its own;
    - its body did not move with its velocity in the last step: the step was refused, limited, or stopped;
    - its body was coupled or uncoupled, or is a bin that got full or empty; or the body at the other end of the bar changed its velocity;
    - whether a return lies in a zone of `watch` differs from when it answered;
    - a return in a zone of `still` has come, gone or changed since the tick before;
    - with `freer_within`: the freer side differs from when it answered, left or right, of which fewer beams return within so many metres;
    - another process runs it.

    In realtime, and in a run with `--ignore-holds`, it is asked at every tick.
    """

    until: Tick  # at most MOST_HOLD ticks ahead count
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
    """What an agent returns from a tick: velocity, deeds, messages, memory and status."""

    twist: Annotated[Twist, Meta(description="forward, left (m/s), counter-clockwise (rad/s)")] = (
        STILL
    )
    deeds: Deeds = []
    requests: Asked = []
    answers: list[tuple[Heard, Answer]] = []
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
    """Whether the holds of a user's agent or step count: its own class, and not only its base, says `holds = True`."""
    return vars(class_).get("holds", False) is True


def state_of(action: Action) -> State:
    """Return the state in an action; without one, 'driving' if the action moves the body, else 'resting'."""
    return action.state or ("resting" if action.twist == STILL else "driving")


class Agent(Protocol):
    """Any object with this method can drive a body. `Memory` is the type of its memory, to decode it from bytes."""

    @property
    def Memory(self) -> type: ...

    def tick(self, observation: Observation, mail: Mail, memory: Any, /) -> Action: ...


STATE = 7  # numbers in a body's state


class Scans(Sequence[np.ndarray]):
    """The scans of n bodies as views of one array, made when they are asked for."""

    def __init__(self, ranges: np.ndarray, begin: Sequence[int]) -> None:
        """`ranges`: m, float32, of all bodies one after another; `begin`: (n + 1,) where each body's begin, and the end."""
        self.ranges, self._begin = ranges, begin

    def __len__(self) -> int:
        return len(self._begin) - 1

    def __getitem__(self, body: Any) -> Any:
        which = range(len(self))[body]
        if isinstance(which, range):
            return [self[i] for i in which]
        return self.ranges[self._begin[which] : self._begin[which + 1]]

    def __iter__(self) -> Iterator[np.ndarray]:
        return (self.ranges[first:end] for first, end in pairwise(self._begin))


@dataclass(slots=True)
class Observations:
    """The observations of n bodies at one tick."""

    tick: int
    names: Mapping[str, int]  # name -> its row in the arrays, in their order
    states: np.ndarray  # (n, 7) float64: x, y (m), the quaternion's z, w, and the last step's linear x, y (m/s), angular z (rad/s)
    scans: Sequence[np.ndarray]  # n scans, m: (180,) or, of bins and weeds, (60,) float32
    hitches: Mapping[str, Hitch]  # of coupled bodies, by name
    fills: Mapping[str, float]  # of bins that are not empty, by name: metres of row
    full: Collection[str]  # names of the full bins
    accuracies: Mapping[str, float] = field(
        default_factory=dict
    )  # of bodies whose x and y are not exact, m, by name
    charges: Mapping[str, float] = field(
        default_factory=dict
    )  # of bodies with a battery, 0 to 1, by name

    def __getitem__(self, name: str) -> Observation:
        """Return the observation of one body. Raises KeyError for an unknown name."""
        body = self.names[name]
        x, y, z, w, vx, vy, turn = self.states[body].tolist()
        hitch, fill, accuracy = (
            self.hitches.get(name),
            self.fills.get(name, 0.0),
            self.accuracies.get(name, 0.0),
        )
        twist, is_full = Twist(vx, vy, turn), name in self.full
        charge = self.charges.get(name, 1.0)
        return Observation(
            name,
            self.tick,
            x,
            y,
            (z, w),
            twist,
            self.scans[body],
            hitch,
            fill,
            is_full,
            accuracy,
            charge,
        )

    def __deepcopy__(self, memo: dict[int, Any]) -> "Observations":
        parts = (
            self.states,
            self.scans,
            self.hitches,
            self.fills,
            self.full,
            self.accuracies,
            self.charges,
        )
        return Observations(
            self.tick, self.names, *deepcopy(parts, memo)
        )  # the names are the layout's, and read-only

    def of(self, names: Iterable[str]) -> dict[str, Observation]:
        """Return the observations of these agents, by name; an agent without a body observes the tick only."""
        return {
            name: self[name] if name in self.names else without_body(name, self.tick)
            for name in names
        }
