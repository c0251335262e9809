"""Dispatch policies: which carrier fetches which bin, and when it leaves.

A policy decides which carrier fetches which bin. It is pure: `assign` decides from reports and its
own memory alone. With `nearest` each full bin asks all carriers and decides for itself. With any
other policy the agent `dispatch` gathers the reports of all bins and carriers, and decides for all.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import msgspec

from orchard.contract.messages import End


class BinReport(msgspec.Struct, frozen=True):
    """A bin that needs a carrier: it is full or, if the policy is `early`, soon will be."""

    name: str
    #: From 1, at the top.
    lane: int
    #: At which end of the lane it stands, or will stand: 'east' or 'west'.
    side: End
    #: The picker that waits there for an empty bin, or that still fills this one.
    picker: str
    since: int  #: tick at which it began to call
    #: m, by road from the queue's head to its lane.
    metres: float
    #: s, estimated, until it stands full in the lane; 0 once it does.
    seconds_to_full: float = 0.0
    #: s, from a carrier's departure at the queue's head until it can stand at the lane, without
    #: traffic.
    seconds_to_reach: float = 0.0


class CarrierReport(msgspec.Struct, frozen=True):
    """A carrier, as the dispatcher hears of it."""

    name: str
    #: The full bin that it fetches; '' while it waits in the queue.
    job: str
    #: Whether it can leave now: it waits, and no carrier of its line stands before it.
    is_next: bool
    #: m, by road from its place to the queue's head.
    metres: float


class Assignment(NamedTuple):
    """The decision that a carrier fetches a bin."""

    bin: str
    carrier: str


class Dispatch(Protocol):
    """A dispatch policy. Its class is called with the layout.

    `Memory` is the type of its memory: a msgspec.Struct with a default for each field. `assign` may
    change the memory in place. A policy with `early = True` in its class is also told of bins that
    are not full yet.
    """

    Memory: type

    def assign(
        self, now: int, bins: Sequence[BinReport], carriers: Sequence[CarrierReport], memory: Any, /
    ) -> list[Assignment]:
        """Return which of the carriers with `is_next` fetches which bin; each at most once.

        `now`: the tick.
        """
        ...


def is_early(policy: Dispatch) -> bool:
    """Whether bins report to a policy before they are full."""
    return bool(getattr(policy, "early", False))


def prefers_near(policy: Dispatch) -> bool:
    """Whether a policy lets far bins wait for near ones that were full later."""
    return bool(getattr(policy, "prefers_near", False))
