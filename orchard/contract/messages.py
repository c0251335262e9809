"""Requests, answers and deeds as plain data, and their encoding as bytes.

An agent sends a request to another agent, which may answer it. A deed is what a body wants physics
to do besides moving it. Only this module encodes and decodes msgpack.
"""

from functools import cache
from typing import Annotated, Any, NamedTuple

import msgspec
from msgspec import Meta
from msgspec.msgpack import Decoder, Encoder

MAX_PAYLOAD = 1 << 20  # bytes of one message
FASTEST = 100.0  # m/s and rad/s, of any velocity
LAST_TICK = 2**36 - 1  # 217 years: its time in nanoseconds fits in 64 bits

Tick = Annotated[
    int, Meta(ge=0, le=LAST_TICK, description="number of the time step, 0.1 s each, from 0")
]
LONGEST_TEXT = 200  # characters of a text for people
Text = Annotated[str, Meta(max_length=LONGEST_TEXT)]
Word = Annotated[str, Meta(max_length=64)]  # a name of an agent or of a place on the roads
RoadPlaces = Annotated[list[Word], Meta(max_length=16)]
# The limits are far beyond any orchard; they refuse NaN and infinity too.
Metres = Annotated[float, Meta(ge=-1e6, le=1e6)]
Seconds = Annotated[float, Meta(ge=0.0, le=1e6)]
End = Annotated[str, Meta(pattern=r"^(east|west)\Z")]  # an end of a lane


class AgentMessage(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="type", tag=str.lower
):
    """A message to another agent or to physics.

    Its `type` on the wire is the class name in small letters, if the class gives no other `tag`.

    For messages of your own, derive classes from it, and list them in your agent's `Messages`: see
    `CustomMessage`.
    """


def type_of(message: AgentMessage | type[AgentMessage]) -> str:
    """Return the `type` of a message on the wire, such as 'call', 'offer' or 'emptybin'."""
    return str(message.__struct_config__.tag)


# -- deeds: physics decides whether they happen


class Couple(AgentMessage):
    """Couple the bin that stands at the coupling point."""

    bin: Word


class Uncouple(AgentMessage):
    """Uncouple the bin; it stays where it stands."""


class Flatten(AgentMessage):
    """From a weed: flatten it, because something moves within a metre of it."""


class PickFrom(AgentMessage):
    """From a picker: begin to pick its row at x, m east in the frame `map`. It picks nothing until
    it drives over x, which may lie inside a part that is not picked yet.
    """

    x: Metres


Deed = Couple | Uncouple | Flatten | PickFrom

# -- requests


class Call(AgentMessage):
    """With `dispatch: nearest`, from a full bin to each carrier: is it free to fetch the bin? A
    carrier that hears several calls offers itself to the oldest one only.
    """

    lane: int
    side: End  # end of the lane at which the bin stands: 'east' or 'west'
    since: Tick  # at which the bin began to call


class Come(AgentMessage):
    """From a full bin to the chosen carrier: fetch the bin."""

    lane: int
    side: End
    picker: Word  # the picker that waits there for an empty bin


class Confirm(AgentMessage):
    """From a carrier to the bin that sent for it: does the bin still want this carrier?"""


class EmptyBin(AgentMessage):
    """From a picker to its full bin: which carrier brings an empty bin?"""


class Here(AgentMessage):
    """From a carrier to the picker: the empty bin stands on the picker's coupling point."""

    bin: Word


class Claim(AgentMessage):
    """From a robot to `traffic`, the agent that reserves places on the roads: `keep`, the places
    that it has and still needs; `want`, those that it asks for; `beside`, a robot with which it may
    share places, '' if there is none.
    """

    keep: RoadPlaces
    want: RoadPlaces
    beside: Word


class StateRequest(AgentMessage, tag="state"):
    """From any agent to a bin: is it full, and which robot is it coupled to?"""


class LeftAt(AgentMessage, tag="left_at"):
    """From a picker to its bin: the end of the lane at which it will leave the bin next, and the
    metres of row that will be in it then.
    """

    lane: int
    side: End
    fill: Metres


class Where(AgentMessage):
    """From a robot to a person or an animal: where is it? The robot asks before and during a turn,
    because its lasers may not see the other one.
    """


class Fetch(AgentMessage):
    """With any `dispatch` but `nearest`, from a bin that is full, or soon will be, to the
    dispatcher: which carrier fetches the bin?
    """

    lane: int
    side: End
    picker: Word  # the picker that waits there for an empty bin, or that still fills this one
    since: Tick  # at which the bin began to ask
    seconds_to_full: Seconds  # 0 for a bin that stands full in the lane


class CarrierQuery(AgentMessage):
    """From the dispatcher to each carrier: is it free?"""


class CustomMessage(AgentMessage, tag="custom"):
    """A request or answer of a user's own type, on its way between two agents that know the type.

    An agent lists its types in `Messages`. The sender's guard converts a message of such a type to
    a `CustomMessage`, and the recipient's guard checks it and converts it back. All other programs
    pass it on unread.
    """

    name: Word  # `type` of the message
    fields: dict[str, Any]


Request = (
    Call
    | Come
    | Confirm
    | EmptyBin
    | Here
    | Claim
    | StateRequest
    | LeftAt
    | Where
    | Fetch
    | CarrierQuery
    | CustomMessage
)

# -- answers


class Offer(AgentMessage):
    """From a waiting carrier, to a call: its place, and how far it is."""

    x: Metres
    y: Metres
    distance: Metres  # m, by road to the calling bin


class Yes(AgentMessage):
    """Agreed."""


class No(AgentMessage):
    """Not agreed."""

    reason: Text


class CarrierComing(AgentMessage, tag="carrier"):
    """From a bin to its picker, or from the dispatcher to a bin: the carrier that comes, '' while
    none is found.
    """

    carrier: Word


class Places(AgentMessage):
    """From `traffic`, to a claim: `held`, the places that are reserved for the robot now; `alone`,
    those of them that no other robot shares; `blockers`, the robots in the way of the others.
    """

    held: list[Word]
    blockers: list[Word]
    alone: list[Word]


class BinState(AgentMessage):
    """From a bin: its state."""

    full: bool
    fill: Metres  # of row in it
    coupled_to: Word  # name of the robot; '' when the bin stands by itself


class CarrierStatus(AgentMessage):
    """From a carrier to the dispatcher: `job`, the full bin that it fetches, or '' without a job;
    `is_next`, whether it waits in the queue of free carriers at the head of its line; `metres`, by
    road to the head of its line.
    """

    job: Word
    is_next: bool
    metres: Metres


class Position(AgentMessage):
    """From a person or an animal: its position in the frame `map`, m."""

    x: Metres
    y: Metres


Answer = (
    Offer | Yes | No | CarrierComing | Places | BinState | Position | CarrierStatus | CustomMessage
)


# -- requests and answers as they are stored, for sessions that read them later


class Given(NamedTuple):
    """An answer to request `number` that the agent `to` sent at `tick`."""

    to: Word
    tick: int
    number: int
    body: Answer


class Written(msgspec.Struct, forbid_unknown_fields=True):
    """The letters of one agent at one tick."""

    requests: Annotated[
        list[tuple[Word, Request]],
        Meta(description="[to, body] of each request, numbered by its place from 0"),
    ]
    answers: Annotated[
        list[Given], Meta(description="[to, tick and number of the request, body of the answer]")
    ]

    @property
    def sent(self) -> list[tuple[str, Request | Answer]]:
        """The recipient and the body of each letter."""
        sent: list[tuple[str, Request | Answer]] = [*self.requests]
        for answer in self.answers:
            sent.append((answer.to, answer.body))
        return sent


# -- bytes

_encoder = Encoder()


@cache
def _decoder(type_: Any) -> "Decoder[Any]":
    return Decoder(type_)


def pack(message: Any) -> bytes:
    """Encode plain data as msgpack. The same data give the same bytes.

    >>> unpack(pack({"row": 3}), dict[str, int])
    {'row': 3}
    """
    return _encoder.encode(message)


def as_json(message: AgentMessage) -> str:
    """Return a message as JSON, with its `type` and its fields.

    >>> as_json(No("no carrier is free"))
    '{"type":"no","reason":"no carrier is free"}'
    """
    return msgspec.json.encode(message).decode()


def unpack(data: bytes, type_: Any) -> Any:
    """Decode msgpack bytes and check the data against a type.

    Raises ValueError, with the fault and its place in the message.
    """
    try:
        return _decoder(type_).decode(data)
    except RecursionError as error:
        raise ValueError("nested too deeply") from error
