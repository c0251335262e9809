"""The dispatcher: it gathers the reports of bins and carriers, and sends carriers.

The scenario's policy (orchard/dispatch) decides. The dispatcher is an agent without a body, and
there is none with the policy `nearest`. Its memory has "bookings": which carrier is sent to which
bin. A booking is "answered" once the bin has heard of it.
"""

import logging

import msgspec
from msgspec.structs import replace

from orchard.contract.agent import Action, Heard, Hold, Mail, Observation
from orchard.contract.messages import (
    LAST_TICK,
    Answer,
    CarrierComing,
    CarrierQuery,
    CarrierStatus,
    Fetch,
    No,
    unpack,
)
from orchard.dispatch.kept_memory import as_kept
from orchard.dispatch.policies import dispatch_of
from orchard.dispatch.policy import Assignment, BinReport, CarrierReport, Dispatch
from orchard.dispatch.ranking import Nearest
from orchard.field.layout import Layout
from orchard.field.plugins import (
    LONGEST_FAULT,
    MISTAKES,
    fault_words,
    place_of_class,
    place_of_error,
    reraise_ctrl_c,
)
from orchard.field.problems import printable
from orchard.field.scenario import END, TIME_STEP
from orchard.plans.routes import route_of, way_to

log = logging.getLogger("orchard")

# Ticks between two questions to the carriers.
POLL_TICKS = 10
# Ticks after which a bin that does not report again is dropped: a bin reports every 20 ticks.
FORGET_TICKS = 60
# Ticks for which a carrier counts as taken after its bin was answered: its status shows the job
# 4 ticks later.
BOOKED_TICKS = 10


class PolicyFault(RuntimeError):
    """Raised where a decision that cannot be ends a run.

    The text says what is wrong, and where in the user's file.
    """


class Booking(msgspec.Struct):
    """A carrier that the policy has sent to a bin."""

    carrier: str
    # Tick at which the bin was answered, and so told; -1: not yet.
    told: int = -1

    @property
    def is_answered(self) -> bool:
        """Whether the bin has been told which carrier comes."""
        return self.told >= 0


class DispatcherMemory(msgspec.Struct):
    """The bins that need a carrier, and the decisions."""

    # Bin -> its report, as it was when the bin last reported.
    bins: dict[str, BinReport] = {}
    # Bin -> tick of its last report.
    heard: dict[str, int] = {}
    # Bin -> the carrier that comes.
    bookings: dict[str, Booking] = {}
    # Tick at which the carriers were last asked.
    asked: int = -POLL_TICKS
    # The policy's memory, packed.
    policy: bytes = b""
    # Decisions of the policy that could not be.
    refused: int = 0


class Dispatcher:
    """Sends carriers to bins, by the policy of the scenario.

    A bin reports to it again and again until the answer names a carrier. While bins wait, the
    dispatcher asks all carriers for their state, and lets the policy decide. The bin then sends for
    its carrier. A decision that cannot be is refused and logged; the manual's policy then decides,
    and the dispatcher is `broken` in that tick.
    """

    Memory = DispatcherMemory
    holds = True

    def __init__(self, layout: Layout, name: str) -> None:
        self.layout = layout
        self.policy = dispatch_of(layout)
        self.route = route_of(layout)
        # What `way_to` has returned for an end of a lane.
        self._ways: dict[tuple[int, str], tuple[float, float]] = {}
        self.carriers = layout.names_of("carrier")
        # The manual's policy, for a decision of another policy that cannot be.
        self.manual = Nearest(layout)

    def way_to(self, lane: int, side: str) -> tuple[float, float]:
        """Return how far it is to the end of a lane, m, and how long a carrier takes to it, s."""
        if (lane, side) not in self._ways:
            self._ways[lane, side] = way_to(self.route, lane, self.route.sides[side])
        return self._ways[lane, side]

    def tick(self, seen: Observation, mail: Mail, memory: DispatcherMemory | None) -> Action:
        """Hear bins and carriers, let the policy decide, and answer."""
        memory = memory or self.Memory()
        self.forget(memory, seen.tick)
        answers = [(heard, self.answer(memory, heard, seen.tick)) for heard in mail.requests]
        action = Action(memory=memory, answers=answers)
        refused_before = memory.refused
        # Carriers report if they were asked two ticks ago: then it is time to decide.
        carriers = carrier_reports(mail)
        if carriers:
            self.decide(memory, carriers, seen.tick)
        waiting = [name for name in memory.bins if name not in memory.bookings]
        if waiting and seen.tick - memory.asked >= POLL_TICKS:
            action.requests = [(carrier, CarrierQuery()) for carrier in self.carriers]
            memory.asked = seen.tick
        action.doing = f"{len(waiting)} bins wait for a carrier"
        if memory.refused > refused_before:
            action.state = "broken"
            return action
        if waiting:
            action.state = "waiting"
        else:
            action.state = "resting"
        action.hold = Hold(self._next_tick(memory, bool(waiting)))
        return action

    @staticmethod
    def _next_tick(memory: DispatcherMemory, has_waiting: bool) -> int:
        """Return the tick at which it has something to do, if it hears nothing before."""
        ticks = [LAST_TICK]
        ticks += [heard_at + FORGET_TICKS for heard_at in memory.heard.values()]
        for booking in memory.bookings.values():
            if booking.is_answered:
                ticks.append(booking.told + BOOKED_TICKS)
        if has_waiting:
            ticks.append(memory.asked + POLL_TICKS)
        return min(ticks)

    def answer(self, memory: DispatcherMemory, heard: Heard, tick: int) -> Answer:
        """Note what a bin reports, and answer: the carrier that comes, or '' while the policy has
        none for it.
        """
        body = heard.body
        name = heard.sender
        if not isinstance(body, Fetch):
            return No("the dispatcher knows nothing of that")
        if not 1 <= body.lane <= len(self.layout.lanes):
            return No("there is no such row")
        memory.bins[name] = self.report(name, body)
        memory.heard[name] = tick
        booking = memory.bookings.get(name)
        # There is no decision yet, or the bin reports again after an answer.
        if booking is None or booking.is_answered:
            return CarrierComing("")
        booking.told = tick
        del memory.bins[name]
        return CarrierComing(booking.carrier)

    def report(self, name: str, body: Fetch) -> BinReport:
        """Return what a bin reports, for the policy."""
        metres, reach = self.way_to(body.lane, body.side)
        return BinReport(
            name=name,
            lane=body.lane,
            side=body.side,
            picker=body.picker,
            since=body.since,
            metres=metres,
            seconds_to_full=body.seconds_to_full,
            seconds_to_reach=reach,
        )

    def decide(self, memory: DispatcherMemory, carriers: list[CarrierReport], tick: int) -> None:
        """Let the policy send free carriers to waiting bins.

        If that fails, the manual's policy sends them to full ones.
        """
        booked = {booking.carrier for booking in memory.bookings.values()}
        bins = []
        for name, report in sorted(memory.bins.items()):
            if name not in memory.bookings:
                bins.append(aged(report, tick - memory.heard[name]))
        free = [carrier for carrier in carriers if carrier.name not in booked]
        try:
            assignments = self.orders(memory, bins, free, tick)
        except MISTAKES as error:
            self.refuse(memory, error, tick)
            full = [report for report in bins if report.seconds_to_full <= 0.0]
            assignments = self.manual.assign(tick, full, free, {})
        for assignment in assignments:
            memory.bookings[assignment.bin] = Booking(assignment.carrier)

    def orders(
        self, memory: DispatcherMemory, bins: list[BinReport], free: list[CarrierReport], tick: int
    ) -> list[Assignment]:
        """Return the policy's decision, and keep the policy's memory.

        Raises what the policy raises, and TypeError or ValueError for what cannot be.
        """
        if memory.policy:
            remembered = unpack(memory.policy, self.policy.Memory)
        else:
            remembered = self.policy.Memory()
        decision = self.policy.assign(tick, list(bins), list(free), remembered)
        assignments = checked(decision, bins, free)
        memory.policy = as_kept(remembered, self.policy)
        return assignments

    def refuse(self, memory: DispatcherMemory, error: BaseException, tick: int) -> None:
        """Count a decision that cannot be carried out. Log the first one, with its source line."""
        reraise_ctrl_c(error)
        if memory.refused == 0:
            scenario = self.layout.scenario
            fault = fault_of(self.policy, scenario.dispatch, error, tick)
            consequence = "nearest decides"
            if scenario.dispatch_errors == END:
                consequence = "the run ends"
            log.error("%s; its orders are refused, and %s", fault, consequence)
        memory.refused += 1

    def forget(self, memory: DispatcherMemory, tick: int) -> None:
        """Drop bins that no longer report, and bookings that are over."""
        for bin_name, heard_at in list(memory.heard.items()):
            if tick - heard_at >= FORGET_TICKS:
                del memory.heard[bin_name]
                memory.bins.pop(bin_name, None)
        for bin_name, booking in list(memory.bookings.items()):
            if booking.is_answered:
                is_over = tick - booking.told >= BOOKED_TICKS
            else:
                is_over = bin_name not in memory.heard
            if is_over:
                del memory.bookings[bin_name]


def carrier_reports(mail: Mail) -> list[CarrierReport]:
    """Return what carriers answer in this tick: of each the last answer."""
    reports = {}
    for reply in mail.replies:
        status = reply.body
        if isinstance(status, CarrierStatus):
            report = CarrierReport(reply.sender, status.job, status.is_next, status.metres)
            reports[reply.sender] = report
    return list(reports.values())


def aged(report: BinReport, ticks: int) -> BinReport:
    """Return a report that is some ticks old as it would be now."""
    return replace(report, seconds_to_full=max(0.0, report.seconds_to_full - ticks * TIME_STEP))


def fault_of(policy: Dispatch, path: str, error: BaseException, tick: int) -> str:
    """Return what is wrong with a policy's decision, and where in the user's file.

    `path`: the policy's name in the scenario.
    """
    fault = printable(fault_words(error), LONGEST_FAULT)
    place = place_of_error(error) or place_of_class(type(policy))
    return f"dispatch policy {path}, tick {tick}: {fault}{place}"


def checked(
    assignments: object, bins: list[BinReport], carriers: list[CarrierReport]
) -> list[Assignment]:
    """Return a policy's decision, its names as plain text.

    Raises TypeError if it is no list of assignments, ValueError if one of them cannot be: its bin
    does not wait, its carrier is not free to leave, or either of them comes twice.
    """
    if not isinstance(assignments, list | tuple):
        raise _no_list(assignments)
    orders = []
    for assignment in assignments:
        if not isinstance(assignment, Assignment):
            raise _no_list(assignments)
        orders.append(Assignment(str(assignment.bin), str(assignment.carrier)))
    waiting = [report.name for report in bins]
    free = [carrier.name for carrier in carriers if carrier.is_next]
    _check_names("bin", [order.bin for order in orders], waiting)
    _check_names("carrier", [order.carrier for order in orders], free)
    return orders


def _no_list(decision: object) -> TypeError:
    wanted = "it must return a list of Assignment(bin, carrier)"
    return TypeError(f"assign returned {decision!r}; {wanted}")


def _check_names(kind: str, names: list[str], available: list[str]) -> None:
    """Raise ValueError if a name is not available, or comes twice.

    `kind`: of what these names are.
    """
    for name in names:
        if name not in available:
            known = ", ".join(available) or "none"
            fault = f", which is not available; available: {known}"
        elif names.count(name) > 1:
            fault = " twice"
        else:
            continue
        raise ValueError(f"the dispatch policy assigns {kind} {name}{fault}")
