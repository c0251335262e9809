"""Dispatch policies, which decide which carrier fetches which full bin, and the agent `dispatch`, the dispatcher.

A scenario names its policy (`dispatch: nearest`, or a user's class). A policy is pure: `assign` decides from reports and its own memory
alone, and sends nothing. With `nearest` each full bin asks all carriers and decides for itself. With any other policy the dispatcher
gathers the reports of all bins and carriers, and decides for all.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import msgspec

from orchard.agents.route import SIDES, route_of
from orchard.contract.agent import Action, Heard, Hold, Mail, Observation
from orchard.contract.messages import LAST_TICK, Answer, CarrierComing, CarrierQuery, CarrierStatus, End, FullBin, No, pack, unpack
from orchard.field.layout import QUEUE_HEAD, TOP_ROAD, Layout
from orchard.field.plugins import make_plugin
from orchard.field.scenario import NEAREST

POLL_TICKS = 10  # ticks between two questions to the carriers
FORGET_TICKS = 60  # ticks after which a bin that does not report again is dropped: a bin reports every 20 ticks
BOOKED_TICKS = 10  # ticks for which a carrier counts as taken after its bin was answered: its status shows the job 4 ticks later


class BinReport(msgspec.Struct, frozen=True):
    """A full bin that waits for a carrier."""

    name: str
    lane: int  #: from 1, at the top
    side: End  #: at which end of the lane it stands: 'east' or 'west'
    picker: str  #: the picker that waits there for an empty bin
    since: int  #: tick at which it began to call
    metres: float  #: by road from the queue's head to its lane


class CarrierReport(msgspec.Struct, frozen=True):
    """A carrier."""

    name: str
    job: str  #: the full bin that it fetches; '' while it waits in the queue
    is_next: bool  #: whether it can leave now: it waits, and no carrier of its line stands before it
    metres: float  #: by road from its place to the queue's head


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

    Memory = dict  # empty

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


class Booking(msgspec.Struct):
    """A carrier that the policy has sent to a bin."""

    carrier: str
    told: int = -1  # tick at which the bin was answered; -1: not yet


class DispatcherMemory(msgspec.Struct):
    """The bins that wait, and the decisions."""

    bins: dict[str, BinReport] = {}
    heard: dict[str, int] = {}  # bin -> tick of its last report
    bookings: dict[str, Booking] = {}  # bin -> the carrier that comes
    asked: int = -POLL_TICKS  # tick at which the carriers were last asked
    policy: bytes = b""  # the policy's memory, packed


class Dispatcher:
    """Sends carriers to full bins, by the policy of the scenario.

    A full bin reports to it again and again until the answer names a carrier. While bins wait, the dispatcher asks all carriers for their
    state, and lets the policy decide. The bin then sends for its carrier itself. If that one refuses or is silent, the bin reports again.
    """

    Memory = DispatcherMemory

    def __init__(self, layout: Layout, name: str) -> None:
        self.layout, self.policy, self.route = layout, dispatch_of(layout), route_of(layout)
        self.carriers = [start.name for start in layout.starts if start.kind == "carrier"]

    def tick(self, seen: Observation, mail: Mail, memory: DispatcherMemory | None) -> Action:
        memory = memory or DispatcherMemory()
        self.forget(memory, seen.tick)
        action = Action(memory=memory, answers=[(heard, self.answer(memory, heard, seen.tick)) for heard in mail.requests])
        told = [(reply.sender, reply.body) for reply in mail.replies if isinstance(reply.body, CarrierStatus)]
        if carriers := [CarrierReport(name, status.job, status.is_next, status.metres) for name, status in told]:
            self.decide(memory, carriers, seen.tick)
        waiting = [name for name in memory.bins if name not in memory.bookings]
        if waiting and seen.tick - memory.asked >= POLL_TICKS:
            action.requests, memory.asked = [(carrier, CarrierQuery()) for carrier in self.carriers], seen.tick
        action.doing, action.state = f"{len(waiting)} bins wait for a carrier", "waiting" if waiting else "resting"
        forgets = [heard + FORGET_TICKS for heard in memory.heard.values()]
        forgets += [booking.told + BOOKED_TICKS for booking in memory.bookings.values() if booking.told >= 0]
        action.hold = Hold(min([LAST_TICK, *forgets, *([memory.asked + POLL_TICKS] if waiting else [])]))
        return action

    def answer(self, memory: DispatcherMemory, heard: Heard, tick: int) -> Answer:
        """Answer a full bin: the carrier that comes, or '' while the policy has none for it."""
        body, name = heard.body, heard.sender
        if not isinstance(body, FullBin):
            return No("the dispatcher knows nothing of that")
        if not 1 <= body.lane <= len(self.layout.lanes):
            return No("there is no such row")
        metres = self.route.distance(QUEUE_HEAD, TOP_ROAD, body.lane, SIDES[body.side])
        memory.bins[name] = BinReport(name, body.lane, body.side, body.picker, body.since, metres)
        memory.heard[name] = tick
        booking = memory.bookings.get(name)
        if booking is None or booking.told >= 0:  # no decision yet, or the bin reports again after an answer
            return CarrierComing("")
        booking.told = tick
        del memory.bins[name]
        return CarrierComing(booking.carrier)

    def decide(self, memory: DispatcherMemory, carriers: list[CarrierReport], tick: int) -> None:
        """Let the policy send free carriers to waiting bins. Raises ValueError for an assignment that is not allowed."""
        booked = {booking.carrier for booking in memory.bookings.values()}
        bins = [report for name, report in sorted(memory.bins.items()) if name not in memory.bookings]
        free = [carrier for carrier in carriers if carrier.name not in booked]
        remembered = unpack(memory.policy, self.policy.Memory) if memory.policy else self.policy.Memory()
        assignments = self.policy.assign(tick, bins, free, remembered)
        check(assignments, bins, free)
        memory.policy = pack(remembered)
        memory.bookings |= {assignment.bin: Booking(assignment.carrier) for assignment in assignments}

    def forget(self, memory: DispatcherMemory, tick: int) -> None:
        """Drop bins that no longer report, and bookings that are over."""
        memory.heard = {name: heard for name, heard in memory.heard.items() if tick - heard < FORGET_TICKS}
        memory.bins = {name: report for name, report in memory.bins.items() if name in memory.heard}
        for name, booking in list(memory.bookings.items()):
            over = name not in memory.heard if booking.told < 0 else tick - booking.told >= BOOKED_TICKS
            if over:
                del memory.bookings[name]


def check(assignments: list[Assignment], bins: list[BinReport], carriers: list[CarrierReport]) -> None:
    """Check assignments. Raises ValueError for a bin that does not wait, a carrier that is not next, or either of them twice."""
    bins_named, carriers_named = [one.bin for one in assignments], [one.carrier for one in assignments]
    waiting, free = [report.name for report in bins], [carrier.name for carrier in carriers if carrier.is_next]
    for what, names, known in (("bin", bins_named, waiting), ("carrier", carriers_named, free)):
        for name in names:
            if name not in known or names.count(name) > 1:
                fault = " twice" if name in known else f", which is not available; available: {', '.join(known) or 'none'}"
                raise ValueError(f"the dispatch policy assigns {what} {name}{fault}")
