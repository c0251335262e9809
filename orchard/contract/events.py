"""What a run shows to observers: the events of a step, and a frame for each tick.

Engines make them (orchard/sim); viewers, tables and figures use them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta

from orchard.contract.agent import State
from orchard.contract.messages import (
    Answer,
    Call,
    Come,
    EmptyBin,
    Here,
    Offer,
    Request,
    Text,
    Tick,
    Written,
    as_json,
    type_of,
)
from orchard.field.problems import printable

STOPPED = "stopped"  # `doing` of a robot under an emergency stop
SCAN_TICKS = 5  # ticks between two frames with scans: twice a second

What = Literal[
    "coupled",
    "uncoupled",
    "picks from",
    "row picked",
    "bin full",
    "unloaded",
    "weed flattened",
    "deed refused",
    "collision",
    "stopped",
    "reset",
    "charging",
    "charged",
    "flat",
]


class Event(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Something that happened in the step from `tick` to the next: an effect of physics, with a
    word of `What`, or a message between agents, with its `type`, such as 'call'.
    """

    tick: Tick
    what: Text
    who: Annotated[Text, Meta(description="the body that did it, or the sender")]
    whom: Annotated[
        Text, Meta(description="the other body, or the recipient; '' if there is none")
    ] = ""
    detail: Annotated[str, Meta(max_length=1000)] = ""


class LetterEvent(Event, frozen=True):
    """A message between two agents, as an event of the tick at which it is sent."""

    content: str = ""  # the message with its fields, as JSON


# The fields that are None in a frame while they are unchanged.
SELDOM = ("coupled", "fill", "alive", "row_ends", "trailers")

# The velocity of a body in its own frame: forward and left (m/s), turn (rad/s). The first three
# numbers are what it did in the step, the last three what its agent wanted.
Velocities = tuple[float, float, float, float, float, float]


@dataclass(slots=True)
class Frame:
    """The orchard at one tick. n bodies in the order of `layout.starts`, r rows; SI units.

    A map may hold only the names whose values changed, if `is_whole` is False. The fields of
    `SELDOM` are None while they are unchanged.
    """

    tick: int
    # (n, 3) float: x, y (m), yaw (rad).
    poses: np.ndarray
    # Name -> "picking row 3".
    doing: Mapping[str, str] = field(default_factory=dict)
    # For each body its ranges, m, float32, +inf without a return; None in most frames.
    scans: Sequence[np.ndarray | None] | None = None
    # (n,) int: index of the body at the other end of the bar; -1 if there is none.
    coupled: np.ndarray | None = None
    # (n,) float: metres of row in each bin, from 0 to the length that fills it.
    fill: np.ndarray | None = None
    # (n,) bool: False for a flattened weed.
    alive: np.ndarray | None = None
    # (r, 4) float: how far each row is picked, as `World.row_ends` (orchard/sim/world.py).
    row_ends: np.ndarray | None = None
    # Bins unloaded so far.
    delivered: int = 0
    events: Sequence[Event] = ()
    # Name -> state, for the names in `doing`.
    states: Mapping[str, State] = field(default_factory=dict)
    # Name -> velocities in the step.
    velocities: Mapping[str, Velocities] = field(default_factory=dict)
    # Name -> charge of its battery, 0 flat to 1 full: of robots that have one, once a second.
    charges: Mapping[str, float] = field(default_factory=dict)
    # How many earlier frames were merged into this one.
    left_out: int = 0
    # Whether all but the scans is complete, so that a viewer can begin with this frame.
    is_whole: bool = False
    # (t, 3) int: the trailers of the load-out, as `World.trailers` (orchard/sim/world.py).
    trailers: np.ndarray | None = None
    # Full bins that wait at the bay for the truck.
    waiting_bins: int = 0


def merged(old: Frame, new: Frame) -> Frame:
    """Return one frame for two: the newer one, with those changes of the older one that it lacks.

    A viewer that is slow draws it in place of both.
    """
    kept: dict[str, Any] = {}
    for name in SELDOM:
        if getattr(new, name) is None:
            kept[name] = getattr(old, name)
    joined: dict[str, Any] = {}
    for name in ("doing", "states", "velocities", "charges"):
        joined[name] = {**getattr(old, name), **getattr(new, name)}
    joined["events"] = [*old.events, *new.events]
    joined["is_whole"] = old.is_whole or new.is_whole
    return replace(new, left_out=old.left_out + new.left_out + 1, **joined, **kept)


# -- messages between agents as events


def talk_of(tick: int, letters: Mapping[str, Written]) -> list[LetterEvent]:
    """Return the messages that agents sent at a tick as events, printable.

    `letters`: sender -> its letters, which are its requests and answers of that tick.
    """
    events = []
    for sender, written in letters.items():
        for to, body in written.sent:
            event = LetterEvent(
                tick=tick,
                what=type_of(body),
                who=sender,
                whom=printable(to),
                detail=printable(_detail_of(body)),
                content=as_json(body),
            )
            events.append(event)
    return events


# Type of message -> its words for people, with the fields of the message `{0}` filled in.
_WORDS: dict[type, str] = {
    Call: "is a carrier free? row {0.lane}, {0.side} end",
    Come: "come, row {0.lane}, {0.side} end",
    Offer: "{0.distance:.0f} m away",
    EmptyBin: "which carrier comes?",
    Here: "here is {0.bin}",
}


def _detail_of(body: Request | Answer) -> str:
    """Return what a message says, for people; '' if its `type` says it all."""
    words = _WORDS.get(type(body))
    if words is not None:
        return words.format(body)
    # A `No` has a reason, a `CarrierComing` a carrier.
    return getattr(body, "reason", "") or getattr(body, "carrier", "")
