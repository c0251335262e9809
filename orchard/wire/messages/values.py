"""The values of which messages are made, with their bounds, and what all messages have."""

from typing import Annotated

import msgspec
from msgspec import Meta

from orchard.contract.agent import LARGEST_MEMORY, State
from orchard.contract.messages import FASTEST, Metres, Tick

FARTHEST = 1e6  # m or m/s: no coordinate and no speed is larger
# Bodies of an orchard; the largest one has some 300.
MOST_BODIES = 10_000
# Descriptions of fields.
OWNER = "the session id in the sender's liveliness token; '' if the sender owns no agent"
ONCE = (
    "realtime; true: it drives for one step, from the pose that it answers; false: until a "
    "newer one"
)
RANGES = "m, little-endian float32, 4 bytes per beam; +inf for a beam without a return (REP-117)"
Run = Annotated[
    str, Meta(max_length=64, description="the run's id, as in the reply to the scenario query")
]
Name = Annotated[str, Meta(max_length=64, pattern=r"^[a-z][a-z0-9_]*\Z")]
# A name that is looked up among known ones, so its pattern need not be checked: that would cost
# more time than reading the rest of the message.
KnownName = Annotated[str, Meta(max_length=64)]
Session = Annotated[str, Meta(max_length=64, pattern=r"^[A-Za-z0-9_-]+\Z")]
Owner = Annotated[str, Meta(max_length=64, pattern=r"^[A-Za-z0-9_-]*\Z", description=OWNER)]
Speed = Annotated[float, Meta(ge=-FASTEST, le=FASTEST)]
# A number that ROS has and a flat orchard has not.
Zero = Annotated[float, Meta(ge=0.0, le=0.0)]
# A part of a unit quaternion; the thousandth is for clients that round.
Unit = Annotated[float, Meta(ge=-1.001, le=1.001)]
Box = tuple[Metres, Metres, Metres, Metres]
# Up to 1024 beams of 4 bytes.
Ranges = Annotated[bytes, Meta(max_length=4096, description=RANGES)]
# Metres of row in a bin; also the standard deviation of a position, m.
Fill = Annotated[float, Meta(ge=0.0, le=1e3)]
Charge = Annotated[float, Meta(ge=0.0, le=1.0)]
# The index of a body; -1: none.
Body = Annotated[int, Meta(ge=-1, lt=MOST_BODIES)]
Once = Annotated[bool, Meta(description=ONCE)]
Memory = Annotated[bytes, Meta(max_length=LARGEST_MEMORY)]
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
