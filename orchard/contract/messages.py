"""What travels: requests, answers and deeds as plain data, and how they become bytes. The one place for msgpack."""

from functools import cache
from typing import Annotated, Any, NamedTuple

import msgspec
from msgspec import Meta
from msgspec.msgpack import Decoder, Encoder

TRAFFIC = "traffic"  # the agent that grants places on the roads

# limits of what an agent may send
MAX_PAYLOAD = 1 << 20  # bytes of one message
FASTEST = 100.0  # m/s and rad/s: no velocity is larger
MOST_DEEDS = 16  # of one body in one tick
LAST_TICK = 2**36 - 1  # 217 years: its nanoseconds fit in 64 bits

Tick = Annotated[int, Meta(ge=0, le=LAST_TICK, description="number of the time step, 0.1 s each, from 0")]
Text = Annotated[str, Meta(max_length=200)]
Metres = Annotated[float, Meta(ge=-1e6, le=1e6)]  # not so of what is not a number, or infinite
End = Annotated[str, Meta(pattern="^(east|west)$")]  # of a lane


class _Message(msgspec.Struct, frozen=True, tag_field="type", tag=str.lower):
    pass


def kind_of_message(message: "Deed | Request | Answer") -> str:
    """What a message is on the wire, its `type`: 'call', 'offer', 'emptybin'."""
    return str(message.__struct_config__.tag)


# -- deeds: what a robot asks of physics besides moving; physics decides whether it happens


class Couple(_Message):
    """Take the bin that stands at the coupling point."""

    bin: str


class Uncouple(_Message):
    """Leave the bin where it stands."""


class Flatten(_Message):
    """A weed's: something moves within a metre of me."""


Deed = Couple | Uncouple | Flatten

# -- requests


class Call(_Message):
    """A full bin's, to every carrier: who is free to fetch me?"""

    lane: int
    side: End  # 'east' or 'west': at which it stands


class Come(_Message):
    """A full bin's, to the carrier it chose."""

    lane: int
    side: End
    picker: str  # who waits there for an empty bin


class Confirm(_Message):
    """A carrier's, to the bin that sent for it: do you still want me?"""


class EmptyBin(_Message):
    """A picker's, to its full bin: who brings me an empty one?"""


class Here(_Message):
    """A carrier's, to the picker: the empty bin stands on your coupling point."""

    bin: str


class Claim(_Message):
    """A robot's, to traffic: I keep these places and want those; `beside` names a partner whose places I may share."""

    keep: list[str]
    want: list[str]
    beside: str


class StateRequest(_Message, tag="state"):
    """Anyone's, to a bin: are you full, and on whom?"""


class Where(_Message):
    """A robot's, before and while it turns, to people and animals that its lasers may not see: where are you?"""


Request = Call | Come | Confirm | EmptyBin | Here | Claim | StateRequest | Where

# -- answers


class Offer(_Message):
    """A waiting carrier's, to a call: where I am."""

    x: Metres
    y: Metres
    distance: Metres  # m, by road to the calling bin


class Yes(_Message):
    """Agreed."""


class No(_Message):
    """Not agreed."""

    reason: str


class CarrierComing(_Message, tag="carrier"):
    """A bin's, to its picker: this carrier comes ('' while none is found)."""

    carrier: str


class Places(_Message):
    """Traffic's: what you hold now, and who is in the way of the rest."""

    held: list[str]
    blockers: list[str]
    alone: list[str]  # those of `held` that nobody shares


class BinState(_Message):
    """A bin's."""

    full: bool
    fill: Metres  # of row in it
    coupled_to: str  # '' when it stands by itself


class Position(_Message):
    """Where somebody is, in the orchard's frame."""

    x: Metres
    y: Metres


Answer = Offer | Yes | No | CarrierComing | Places | BinState | Position


# -- both, as they are kept: one who was not there to hear them reads them afterwards


class Given(NamedTuple):
    """An answer to somebody's request of (tick, number)."""

    to: str
    tick: int
    number: int
    body: Answer


class Written(msgspec.Struct):
    """What one agent wrote at one tick."""

    requests: list[tuple[str, Request]]  # to whom, what; numbered from 0
    answers: list[Given]


# -- bytes

_encoder = Encoder()


@cache
def _decoder(type_: Any) -> "Decoder[Any]":
    return Decoder(type_)


def pack(message: Any) -> bytes:
    """Msgpack bytes of plain data; the same data give the same bytes."""
    return _encoder.encode(message)


def unpack(data: bytes, type_: Any) -> Any:
    """The data of msgpack bytes, checked against a type.

    Raises ValueError (msgspec's errors are some), saying what is wrong and where in the message.
    """
    try:
        return _decoder(type_).decode(data)
    except RecursionError as error:
        raise ValueError("nested too deeply") from error
