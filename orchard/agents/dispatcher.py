"""The dispatcher: it gathers the reports of bins and carriers, and sends carriers by the scenario's policy."""

import logging

import msgspec
from msgspec.structs import replace

from orchard.agents.dispatch import Assignment, BinReport, CarrierReport, Dispatch
from orchard.agents.policies import dispatch_of
from orchard.agents.ranking import Nearest
from orchard.agents.routes import route_of, way_to
from orchard.contract.agent import LARGEST_MEMORY, Action, Heard, Hold, Mail, Observation
from orchard.contract.messages import (
    LAST_TICK,
    Answer,
    CarrierComing,
    CarrierQuery,
    CarrierStatus,
    Fetch,
    No,
    pack,
    unpack,
)
from orchard.field.layout import Layout
from orchard.field.plugins import MISTAKES, place_of_class, place_of_error, reraise_ctrl_c, text_of
from orchard.field.problems import printable
from orchard.field.scenario import END, TIME_STEP

log = logging.getLogger("orchard")

POLL_TICKS = 10  # ticks between two questions to the carriers
FORGET_TICKS = 60  # ticks after which a bin that does not report again is dropped: a bin reports every 20 ticks
LARGEST_POLICY_MEMORY = (
    LARGEST_MEMORY // 2
)  # bytes: it is sent in the dispatcher's memory, with the bins and the bookings
BOOKED_TICKS = 10  # ticks for which a carrier counts as taken after its bin was answered: its status shows the job 4 ticks later


class PolicyFault(RuntimeError):
    """Raised where a decision that cannot be ends a run: the text says what is wrong, and where in the user's file."""


class Booking(msgspec.Struct):
    """A carrier that the policy has sent to a bin."""

    carrier: str
    told: int = -1  # tick at which the bin was answered; -1: not yet


class DispatcherMemory(msgspec.Struct):
    """The bins that need a carrier, and the decisions."""

    bins: dict[str, BinReport] = {}  # as they were when the bin last reported
    heard: dict[str, int] = {}  # bin -> tick of its last report
    bookings: dict[str, Booking] = {}  # bin -> the carrier that comes
    asked: int = -POLL_TICKS  # tick at which the carriers were last asked
    policy: bytes = b""  # the policy's memory, packed
    refused: int = 0  # decisions of the policy that could not be


class Dispatcher:
    """Sends carriers to bins, by the policy of the scenario.

    A bin reports to it again and again until the answer names a carrier. While bins wait, the dispatcher asks all carriers for their
    state, and lets the policy decide. The bin then sends for its carrier. A decision that cannot be is refused and logged; the manual's
    policy then decides, and the dispatcher is `broken` in that tick.
    """

    Memory = DispatcherMemory
    holds = True

    def __init__(self, layout: Layout, name: str) -> None:
        self.layout, self.policy, self.route = layout, dispatch_of(layout), route_of(layout)
        self._ways: dict[tuple[int, str], tuple[float, float]] = {}
        self.carriers = [start.name for start in layout.starts if start.kind == "carrier"]
        self.manual = Nearest(layout)

    def way_to(self, lane: int, side: str) -> tuple[float, float]:
        """Return how far it is to the end of a lane, m, and how long a carrier takes to it, s."""
        if (lane, side) not in self._ways:
            self._ways[lane, side] = way_to(self.route, lane, self.route.sides[side])
        return self._ways[lane, side]

    def tick(self, seen: Observation, mail: Mail, memory: DispatcherMemory | None) -> Action:
        memory = memory or self.Memory()
        self.forget(memory, seen.tick)
        action = Action(
            memory=memory,
            answers=[(heard, self.answer(memory, heard, seen.tick)) for heard in mail.requests],
        )
        refused = memory.refused
        told = {
            reply.sender: reply.body
            for reply in mail.replies
            if isinstance(reply.body, CarrierStatus)
        }  # of a carrier the last one
        if carriers := [
            CarrierReport(name, status.job, status.is_next, status.metres)
            for name, status in told.items()
        ]:
            self.decide(memory, carriers, seen.tick)
        waiting = [name for name in memory.bins if name not in memory.bookings]
        if waiting and seen.tick - memory.asked >= POLL_TICKS:
            action.requests, memory.asked = (
                [(carrier, CarrierQuery()) for carrier in self.carriers],
                seen.tick,
            )
        action.doing, action.state = (
            f"{len(waiting)} bins wait for a carrier",
            "waiting" if waiting else "resting",
        )
        if memory.refused > refused:
            action.state = "broken"
            return action
        forgets = [heard + FORGET_TICKS for heard in memory.heard.values()]
        forgets += [
            booking.told + BOOKED_TICKS for booking in memory.bookings.values() if booking.told >= 0
        ]
        action.hold = Hold(
            min([LAST_TICK, *forgets, *([memory.asked + POLL_TICKS] if waiting else [])])
        )
        return action

    def answer(self, memory: DispatcherMemory, heard: Heard, tick: int) -> Answer:
        """Answer a bin: the carrier that comes, or '' while the policy has none for it."""
        body, name = heard.body, heard.sender
        if not isinstance(body, Fetch):
            return No("the dispatcher knows nothing of that")
        if not 1 <= body.lane <= len(self.layout.lanes):
            return No("there is no such row")
        memory.bins[name], memory.heard[name] = self.report(name, body), tick
        booking = memory.bookings.get(name)
        if (
            booking is None or booking.told >= 0
        ):  # no decision yet, or the bin reports again after an answer
            return CarrierComing("")
        booking.told = tick
        del memory.bins[name]
        return CarrierComing(booking.carrier)

    def report(self, name: str, body: Fetch) -> BinReport:
        metres, reach = self.way_to(body.lane, body.side)
        return BinReport(
            name, body.lane, body.side, body.picker, body.since, metres, body.seconds_to_full, reach
        )

    def decide(self, memory: DispatcherMemory, carriers: list[CarrierReport], tick: int) -> None:
        """Let the policy send free carriers to waiting bins; the manual's policy to full ones, if that fails."""
        booked = {booking.carrier for booking in memory.bookings.values()}
        bins = [
            aged(report, tick - memory.heard[name])
            for name, report in sorted(memory.bins.items())
            if name not in memory.bookings
        ]
        free = [carrier for carrier in carriers if carrier.name not in booked]
        try:
            assignments = self.orders(memory, bins, free, tick)
        except MISTAKES as error:
            self.refuse(memory, error, tick)
            assignments = self.manual.assign(
                tick, [report for report in bins if report.seconds_to_full <= 0.0], free, {}
            )
        memory.bookings |= {
            assignment.bin: Booking(assignment.carrier) for assignment in assignments
        }

    def orders(
        self, memory: DispatcherMemory, bins: list[BinReport], free: list[CarrierReport], tick: int
    ) -> list[Assignment]:
        """Return the policy's decision. Raises what the policy raises, and TypeError or ValueError for what cannot be."""
        remembered = (
            unpack(memory.policy, self.policy.Memory) if memory.policy else self.policy.Memory()
        )
        assignments = checked(
            self.policy.assign(tick, list(bins), list(free), remembered), bins, free
        )
        memory.policy = as_kept(remembered, self.policy)
        return assignments

    def refuse(self, memory: DispatcherMemory, error: BaseException, tick: int) -> None:
        """Count a decision that cannot be; log the first one, with its place in the user's file."""
        reraise_ctrl_c(error)
        if not memory.refused:
            fault = fault_of(self.policy, self.layout.scenario.dispatch, error, tick)
            then = (
                "the run ends" if self.layout.scenario.dispatch_errors == END else "nearest decides"
            )
            log.error("%s; its orders are refused, and %s", fault, then)
        memory.refused += 1

    def forget(self, memory: DispatcherMemory, tick: int) -> None:
        """Drop bins that no longer report, and bookings that are over."""
        memory.heard = {
            name: heard for name, heard in memory.heard.items() if tick - heard < FORGET_TICKS
        }
        memory.bins = {name: report for name, report in memory.bins.items() if name in memory.heard}
        for name, booking in list(memory.bookings.items()):
            if (
                name not in memory.heard
                if booking.told < 0
                else tick - booking.told >= BOOKED_TICKS
            ):
                del memory.bookings[name]


def aged(report: BinReport, ticks: int) -> BinReport:
    """Return a report that is some ticks old as it would be now."""
    return replace(report, seconds_to_full=max(0.0, report.seconds_to_full - ticks * TIME_STEP))


def fault_of(policy: Dispatch, path: str, error: BaseException, tick: int) -> str:
    """Return what is wrong with a policy's decision, and where in the user's file. `path`: its name in the scenario."""
    fault = printable(f"{type(error).__name__}: {text_of(error)}", 500)
    return f"dispatch policy {path}, tick {tick}: {fault}{place_of_error(error) or place_of_class(type(policy))}"


def as_kept(remembered: object, policy: Dispatch) -> bytes:
    """Return a policy's memory as it is kept. Raises TypeError or ValueError if it is too large, or no data of its class."""
    packed = pack(remembered)
    if len(packed) > LARGEST_POLICY_MEMORY:
        raise ValueError(
            f"the policy's memory takes {len(packed)} bytes; at most {LARGEST_POLICY_MEMORY}"
        )
    unpack(packed, policy.Memory)
    return packed


def checked(
    assignments: object, bins: list[BinReport], carriers: list[CarrierReport]
) -> list[Assignment]:
    """Return a policy's decision, its names as plain text. Raises TypeError if it is no list of assignments, ValueError if one of them
    cannot be: its bin does not wait, its carrier is not free to leave, or either of them comes twice."""
    if not isinstance(assignments, list | tuple) or not all(
        isinstance(one, Assignment) for one in assignments
    ):
        raise TypeError(
            f"assign returned {assignments!r}; it must return a list of Assignment(bin, carrier)"
        )
    orders = [Assignment(str(one.bin), str(one.carrier)) for one in assignments]
    waiting, free = (
        [report.name for report in bins],
        [carrier.name for carrier in carriers if carrier.is_next],
    )
    for what, names, known in (
        ("bin", [one.bin for one in orders], waiting),
        ("carrier", [one.carrier for one in orders], free),
    ):
        for name in names:
            if name not in known or names.count(name) > 1:
                fault = (
                    " twice"
                    if name in known
                    else f", which is not available; available: {', '.join(known) or 'none'}"
                )
                raise ValueError(f"the dispatch policy assigns {what} {name}{fault}")
    return orders
