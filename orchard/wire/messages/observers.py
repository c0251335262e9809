"""What observers get: events, pictures, figures, states of bins, refusals."""

from typing import Annotated, Any, Literal

from msgspec import Meta

from orchard.contract.events import Event
from orchard.contract.messages import Text, Tick
from orchard.wire.messages.mail import Letters
from orchard.wire.messages.values import (
    Body,
    Charge,
    Fill,
    Message,
    Name,
    RunMessage,
    Speed,
    States,
)

POSES = (
    "x, y (m), yaw (rad) of each body, in the order of `agents` in the reply to `scenario`, "
    "little-endian float64"
)
CHARGES = "name -> charge of its battery, 0 to 1; once a second, only bodies that have one"
VELOCITIES = (
    "name -> linear.x, linear.y (m/s), angular.z (rad/s) of the step, then those that its "
    "agent wanted; only if changed"
)
DoneAndWanted = Annotated[list[Speed], Meta(min_length=6, max_length=6)]
Reason = Literal[
    "malformed", "other run", "past tick", "future tick", "not the owner", "not owned",
    "answered already", "no such robot", "no such agent", "no such key", "out of bounds", "not all",
    "too many", "not paused", "recorded",
    "not kept",
]  # fmt: skip
# Reason -> number of refused messages.
Counts = dict[Reason, Annotated[int, Meta(ge=0, lt=2**53)]]


# A number of bins.
Count = Annotated[int, Meta(ge=0, lt=2**31)]


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


TRAILERS = (
    "for each trailer of the load-out, the bins on it at the bay, the tick at which it is or was"
    " back, and the bins that it took then; without trailers one of zeros"
)


class TickStateMessage(Message):
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
    trailers: Annotated[list[tuple[Count, Tick, Count]] | None, Meta(description=TRAILERS)] = None
    waiting_bins: Annotated[
        Count, Meta(description="full bins that wait at the bay for the truck")
    ] = 0


class Bundle(Message):
    """What observers get of some ticks in one message, for a logger: one by one, ten ticks cost
    some six times as much.
    """

    events: list[Events]
    letters: list[Letters]
    pictures: Annotated[
        list[TickStateMessage],
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
