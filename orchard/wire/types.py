"""The parts of the messages on the wire: types with bounds, in SI units, and base classes.

`read` checks each payload that arrives. It refuses, with the reason, a payload that is too large, malformed, of a wrong type,
not a number, infinite or out of bounds.
"""

from typing import Annotated, TypeVar

import msgspec
from msgspec import Meta

from orchard.contract.messages import FASTEST, MAX_PAYLOAD, Tick, unpack

FARTHEST = 1e6  # m or m/s: no coordinate and no speed is larger
MOST_BODIES = 10_000

Name = Annotated[str, Meta(max_length=64, pattern="^[a-z][a-z0-9_]*$")]
KnownName = Annotated[str, Meta(max_length=64)]  # a name that is looked up; matching the pattern costs more time than reading the rest
Run = Annotated[str, Meta(max_length=64, description="the run's id, as in the reply to the scenario query")]
Speed = Annotated[float, Meta(ge=-FASTEST, le=FASTEST)]
Zero = Annotated[float, Meta(ge=0.0, le=0.0, description="0")]
Unit = Annotated[float, Meta(ge=-1.001, le=1.001)]
Ranges = Annotated[
    bytes, Meta(max_length=4096, description="m, little-endian float32, 4 bytes per beam; +inf for a beam without a return (REP-117)")
]
Fill = Annotated[float, Meta(ge=0.0, le=1e3)]
Body = Annotated[int, Meta(ge=-1, lt=MOST_BODIES)]
Once = Annotated[
    bool,
    Meta(
        description="realtime; true: it drives for one step only, and only from the pose that it answers; "
        "false: until a newer velocity arrives"
    ),
]
Session = Annotated[str, Meta(max_length=64, pattern="^[A-Za-z0-9_-]+$")]
Holder = Annotated[
    str,
    Meta(
        max_length=64,
        pattern="^[A-Za-z0-9_-]*$",
        description="the session id in the sender's liveliness token; '' if the sender holds no agent",
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
    """Return the message in a payload. Raises ValueError, with the reason, if the payload is too large or not such a message."""
    if len(payload) > MAX_PAYLOAD:
        raise ValueError(f"{len(payload)} bytes; at most {MAX_PAYLOAD}")
    message: M = unpack(payload, type_)
    return message
