"""What the messages on the wire are made of: types with their bounds, in SI units, and the maps that all messages are.

Whatever arrives goes through `read`, which refuses (with the reason) what is too big, malformed, of a wrong type, not a number, infinite
or out of bounds.
"""

from typing import Annotated, TypeVar

import msgspec
from msgspec import Meta

from orchard.contract.messages import FASTEST, MAX_PAYLOAD, Tick, unpack

FARTHEST = 1e6  # m, or m/s: what no place and no speed can be
MOST_BODIES = 10_000

Name = Annotated[str, Meta(max_length=64, pattern="^[a-z][a-z0-9_]*$")]
KnownName = Annotated[str, Meta(max_length=64)]  # a name that is looked up; to match its letters costs more than to read the rest
Run = Annotated[str, Meta(max_length=64, description="the run's id; that of the scenario query's answer")]
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


class SubMessage(msgspec.Struct, forbid_unknown_fields=True):
    """A map inside a message."""


class RunMessage(SubMessage):
    """A map with the run's id."""

    run: Run


class Message(RunMessage):
    """A map with the run's id and the tick."""

    tick: Tick


M = TypeVar("M")


def read(payload: bytes, type_: type[M]) -> M:
    """The message in a payload; ValueError, saying what is wrong with it."""
    if len(payload) > MAX_PAYLOAD:
        raise ValueError(f"{len(payload)} bytes; at most {MAX_PAYLOAD}")
    message: M = unpack(payload, type_)
    return message
