"""A harvest of the event model in which a policy is asked from outside, and its decisions are
recorded.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from orchard.dispatch.policy import Assignment, BinReport, CarrierReport
from orchard.event_model import codes as c
from orchard.event_model.harvest import EventHarvest
from orchard.event_model.policies import AskedPolicy
from orchard.event_model.results import JAM, LONGEST
from orchard.field.layout import Layout
from orchard.field.scenario import with_changes
from orchard.study.benchmark.seen import layout_seen, nothing_drawn

# Returns the orders at a tick, by reports of bins that need a carrier and of all carriers.
Decide = Callable[[int, Sequence[BinReport], Sequence[CarrierReport]], list[Assignment]]


@dataclass(frozen=True)
class GivenOrders:
    """The orders that were given at a tick."""

    tick: int
    orders: list[Assignment]
    #: Bin -> its picker.
    pickers: dict[str, str]


@dataclass(frozen=True, kw_only=True)
class Played:
    """How a harvest went."""

    #: Its length; None: it was never finished.
    seconds: float | None
    #: Whether bins reported before they were full.
    is_early: bool = False
    #: The decisions in which a carrier was sent.
    decisions: list[GivenOrders] = field(default_factory=list)


def play(layout: Layout, is_early: bool, decide: Decide) -> Played:
    """Do a harvest. `is_early`: whether bins report before they are full.

    Raises what `decide` raises.
    """
    harvest = EventHarvest.paused(layout, is_early)
    decisions = list[GivenOrders]()
    longest = LONGEST * harvest.bins
    until = 0
    # The steps that all robots had done before the last part; -1: there was none.
    done_before = -1
    reason = c.PAUSED
    # By parts of JAM ticks. A part in which no robot does a step or drives means that they wait for
    # each other, or for a carrier that is never sent.
    while until < longest and reason != c.ENDED and (harvest.done > done_before or harvest.drives):
        done_before = harvest.done
        until = min(longest, until + JAM)
        reason = _carry_on(harvest, until, decide, decisions)
    seconds = None
    if harvest.is_over:
        seconds = harvest.seconds
    return Played(seconds=seconds, is_early=is_early, decisions=decisions)


def built_in_harvest(layout: Layout, policy: str) -> Played:
    """Do a harvest with a built-in policy, which gets only what a user's policy gets."""
    seen = layout_seen(with_changes(nothing_drawn(layout.scenario), dispatch=policy))
    asked = AskedPolicy(seen)
    return play(layout, asked.is_early, asked.orders)


def _carry_on(
    harvest: EventHarvest, until: int, decide: Decide, decisions: list[GivenOrders]
) -> int:
    """Carry a harvest on to a tick, and add its decisions to `decisions`.

    Return why it stopped: PAUSED at the tick, or ENDED.
    """
    while True:
        reason = harvest.advance(until)
        if reason != c.ASKS_POLICY:
            return reason
        question = harvest.decision
        orders = decide(question.now, question.bins, question.carriers)
        if orders:
            pickers = {report.name: report.picker for report in question.bins}
            decisions.append(GivenOrders(question.now, orders, pickers))
        harvest.decide(question, orders)
