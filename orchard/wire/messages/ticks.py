"""What agents observe at a tick, and what they answer."""

from typing import Annotated, NamedTuple

from msgspec import Meta, Raw

from orchard.contract.agent import Action, Deeds
from orchard.contract.messages import FASTEST, Given, Metres
from orchard.field.problems import printable
from orchard.wire.messages.bodies import Angular, Linear
from orchard.wire.messages.values import (
    MOST_BODIES,
    Charge,
    Fill,
    KnownName,
    Memory,
    Message,
    Name,
    Once,
    Owner,
    Ranges,
    Speed,
    SubMessage,
    Unit,
)

# The longest descriptions of fields.
ALL_RANGES = (
    "m, little-endian float32: for each body as many as its laser has beams; +inf for a beam "
    "without a return"
)
NAMES = "their bodies, in the order of the arrays; agents without a body stand in `due` only"
ACCURACIES = "name -> the same as `accuracy` in `pose`; only bodies with poses that are not exact"
SEVEN = (
    "x, y (m); z, w of the quaternion; linear.x, linear.y (m/s) and angular.z (rad/s) of the "
    "last step"
)


class AskedOf(NamedTuple):
    """A request of the tick before, without its body."""

    to: Name
    sender: Name
    # Its place among the requests of the sender in that tick, from 0.
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
        self.doing = printable(self.doing)
        self.waits_for = printable(self.waits_for)


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
