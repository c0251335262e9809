"""Dispatch policies: which carrier fetches which full bin.

A scenario names its policy (`dispatch: nearest`, or a user's class). A policy is pure: `assign` decides from reports and its own memory
alone, and sends nothing. With `nearest` each full bin asks all carriers and decides for itself. With any other policy the agent
`dispatch` (dispatcher.py) gathers the reports of all bins and carriers, and decides for all.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import msgspec

from orchard.contract.messages import End
from orchard.field.layout import Layout
from orchard.field.plugins import make_plugin
from orchard.field.scenario import NEAREST


class BinReport(msgspec.Struct, frozen=True):
    """A full bin that waits for a carrier."""

    name: str
    lane: int  # from 1, at the top
    side: End  # at which end of the lane it stands: 'east' or 'west'
    picker: str  # the picker that waits there for an empty bin
    since: int  # tick at which it began to call
    metres: float  # by road from the queue's head to its lane


class CarrierReport(msgspec.Struct, frozen=True):
    """A carrier."""

    name: str
    job: str  # the full bin that it fetches; '' while it waits in the queue
    is_next: bool  # whether it can leave now: it waits, and no carrier of its line stands before it
    metres: float  # by road from its place to the queue's head


class Assignment(NamedTuple):
    """The decision that a carrier fetches a bin."""

    bin: str
    carrier: str


class Dispatch(Protocol):
    """A dispatch policy. Its class is called with the layout.

    `Memory` is the type of its memory: a msgspec.Struct with a default for each field. `assign` may change the memory in place.
    """

    Memory: type

    def assign(self, now: int, bins: Sequence[BinReport], carriers: Sequence[CarrierReport], memory: Any, /) -> list[Assignment]:
        """Return which of the carriers with `is_next` fetches which bin; each carrier and each bin at most once. `now`: the tick."""
        ...


class Nearest:
    """The manual's policy: the bin that has called for longest gets the carrier that is nearest by road. Ties by name."""

    class Memory(msgspec.Struct):
        """Empty: the policy needs no memory."""

    def __init__(self, layout: Layout) -> None:
        pass

    def assign(self, now: int, bins: Sequence[BinReport], carriers: Sequence[CarrierReport], memory: Any) -> list[Assignment]:
        free = sorted((carrier for carrier in carriers if carrier.is_next), key=lambda carrier: (carrier.metres, carrier.name))
        calling = sorted(bins, key=lambda report: (report.since, report.name))
        return [Assignment(report.name, carrier.name) for report, carrier in zip(calling, free, strict=False)]


POLICIES = {NEAREST: Nearest}


def dispatch_of(layout: Layout) -> Dispatch:
    """Return the policy that the scenario names. Raises ScenarioError if it cannot be used."""
    policy: Dispatch = make_plugin("dispatch", layout.scenario.dispatch, POLICIES, layout, methods=("assign", "Memory"))
    return policy
