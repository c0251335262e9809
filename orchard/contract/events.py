"""What a run shows to observers: the events of a step, and one frame of the picture for
each tick.
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
    """Something that happened in the step from `tick` to the next: an effect of physics (`What`),
    or a message between agents ('call').
    """

    tick: Tick
    what: Text  # a short word, such as one of `What` or a message's `type`
    who: Annotated[Text, Meta(description="the body that did it, or the sender")]
    whom: Annotated[
        Text, Meta(description="the other body, or the recipient; '' if there is none")
    ] = ""
    detail: Annotated[str, Meta(max_length=1000)] = ""


class LetterEvent(Event, frozen=True):
    """A message between two agents, as an event of the tick at which it is sent."""

    content: str = ""  # the message with its fields, as JSON


SELDOM = (
    "coupled",
    "fill",
    "alive",
    "row_ends",
    "trailers",
)  # fields that a frame may leave out while they are unchanged


Velocities = tuple[
    float, float, float, float, float, float
]  # forward, left (m/s), turn (rad/s): done in the step, then those wanted


@dataclass(slots=True)
class Frame:
    """The orchard at one tick. n bodies in the order of `layout.starts`, r rows; SI units."""

    tick: int
    poses: np.ndarray  # (n, 3) float: x, y (m), yaw (rad)
    doing: Mapping[str, str] = field(
        default_factory=dict
    )  # name -> "picking row 3"; may hold changes only
    scans: Sequence[np.ndarray | None] | None = (
        None  # for each body its ranges, m, float32, +inf without a return
    )
    coupled: np.ndarray | None = (
        None  # (n,) int: index of the body at the other end of the bar, or -1; None: unchanged
    )
    fill: np.ndarray | None = (
        None  # (n,) float: of bins, metres of row in the bin, 0 to what fills it; None: unchanged
    )
    alive: np.ndarray | None = None  # (n,) bool: False for a flattened weed; None: unchanged
    row_ends: np.ndarray | None = (
        None  # (r, 4) float: how far each row is picked, as in `World`; None: unchanged
    )
    delivered: int = 0  # bins unloaded so far
    events: Sequence[Event] = ()
    states: Mapping[str, State] = field(
        default_factory=dict
    )  # name -> state, for the names in `doing`
    velocities: Mapping[str, Velocities] = field(
        default_factory=dict
    )  # name -> its own of the step; may hold changes only
    # name -> charge of its battery, 0 flat to 1 full: of robots that have one, once a second.
    charges: Mapping[str, float] = field(default_factory=dict)
    left_out: int = 0  # earlier frames that were merged into this one
    is_whole: bool = False  # whether all but the scans is complete: a viewer can begin with it
    # (t, 3) int: the trailers of the load-out, as in `World`; None: unchanged.
    trailers: np.ndarray | None = None
    # Full bins that wait at the bay for the truck.
    waiting_bins: int = 0


def merged(old: Frame, new: Frame) -> Frame:
    """Return one frame for two: the newer one, with the other changes of the older one."""
    kept: dict[str, Any] = {}
    for name in SELDOM:
        if getattr(new, name) is None:
            kept[name] = getattr(old, name)
    news: dict[str, Any] = {}
    for name in ("doing", "states", "velocities", "charges"):
        news[name] = {**getattr(old, name), **getattr(new, name)}
    news |= {"events": [*old.events, *new.events], "is_whole": old.is_whole or new.is_whole}
    return replace(new, left_out=old.left_out + new.left_out + 1, **news, **kept)


# -- messages between agents as events


def talk_of(tick: int, letters: Mapping[str, Written]) -> list[LetterEvent]:
    """Return the messages that agents sent at a tick as events, printable. `letters`: sender -> its
    letters.
    """
    events = []
    for sender, written in letters.items():
        for to, body in written.sent:
            event = LetterEvent(
                tick=tick,
                what=type_of(body),
                who=sender,
                whom=printable(to),
                detail=printable(_said(body)),
                content=as_json(body),
            )
            events.append(event)
    return events


_WORDS: dict[type, str] = {
    Call: "is a carrier free? row {0.lane}, {0.side} end",
    Come: "come, row {0.lane}, {0.side} end",
    Offer: "{0.distance:.0f} m away",
    EmptyBin: "which carrier comes?",
    Here: "here is {0.bin}",
}


def _said(body: Request | Answer) -> str:
    if words := _WORDS.get(type(body)):
        return words.format(body)
    return getattr(body, "reason", "") or getattr(body, "carrier", "")
