"""The schedule of a harvest without traffic: all drives take their time, and no robot waits for a road, a place or the bay.

It is an ideal to compare a harvest with, for the policy and the route of the scenario; for a policy of the user's own it is that of
`nearest`. It is not a proof: another policy may be faster. docs/bounds.md says how far harvests are from it.
"""

import heapq
from dataclasses import dataclass, replace
from math import ceil

from orchard.agents.dispatch import POLICIES, BinReport, CarrierReport, Dispatch, is_early
from orchard.agents.dispatcher import POLL_TICKS
from orchard.agents.forecast import EARLIER, farthest
from orchard.agents.routes import route_of
from orchard.agents.steps import CRUISE
from orchard.agents.timing import duration
from orchard.contract.messages import End
from orchard.field.kinds import name_of
from orchard.field.layout import Layout
from orchard.field.picking import repairs
from orchard.field.queue import PITCH
from orchard.field.rows import Block
from orchard.field.scenario import TIME_STEP
from orchard.report.exchange import HANDOVER, Exchange, exchanges

WORTH = 0.01  # share of the harvest's time by which a number of carriers must shorten it to be worth its cost
POLL = POLL_TICKS * TIME_STEP  # s between two decisions of a policy that waits for a better moment


@dataclass
class ScheduledCall:
    """A bin that needs a carrier, and the exchange that it waits for."""

    picker: str
    count: int  # rows that the picker has done before
    begun: float  # s, when it began to call
    full: float  # s, when it is left in the lane
    exchange: Exchange


class Schedule:
    """The schedule of one orchard. It is made once; `seconds` may then be asked for any number of carriers."""

    def __init__(self, layout: Layout) -> None:
        self._layout, self._route = layout, route_of(layout)
        self._rows = {name: self._exchanges(name, block) for name, block in layout.blocks.items()}
        starts = {start.name: start.pose for start in layout.starts}
        self._begins = {name: duration(self._route.come_in(block), starts[name]) for name, block in layout.blocks.items()}
        self._head, self._horizon = layout.queue.place(0), farthest(self._route) + EARLIER

    def seconds(self, carriers: int) -> float:
        """Return the time of the harvest with this number of carriers, s. The policy decides which bin gets one, and when."""
        policy: Dispatch = POLICIES.get(self._layout.scenario.dispatch, POLICIES["nearest"])(self._layout)
        now, early, memory = 0.0, is_early(policy), policy.Memory()
        free = [0.0] * carriers  # s, when each carrier is at the queue's head

        def opened(picker: str, count: int, begins: float) -> ScheduledCall:
            """Return a call, of which the policy hears when it begins, though no carrier is free: it may remember that."""
            call = self._call(picker, count, begins, early)
            policy.assign(ceil(call.begun / TIME_STEP), [self._report(call, call.begun)], [], memory)
            return call

        calls = [opened(name, 0, begins) for name, begins in self._begins.items()]
        while calls:
            now = max(now, free[0], min(call.begun for call in calls))
            waiting = [call for call in calls if call.begun <= now]
            reports = [self._report(call, now) for call in waiting]
            orders = policy.assign(ceil(now / TIME_STEP), reports, [CarrierReport(name_of("carrier", 1), "", True, 0.0)], memory)
            if not orders:
                now += POLL
                continue
            call = waiting[[report.name for report in reports].index(orders[0].bin)]
            calls.remove(call)
            one, out = call.exchange, call.full + call.exchange.coming_out
            there = max(now + one.approach, out + one.from_hold)
            heapq.heapreplace(free, there + one.cycle - one.approach)
            if call.count + 1 < len(self._rows[call.picker]):
                calls.append(opened(call.picker, call.count + 1, there + HANDOVER + one.going_on))
        return max(free) - (min(carriers, self._layout.queue.places) - 1) * PITCH  # the last carrier stops behind the others of its line

    @property
    def enough_carriers(self) -> int:
        """The number of carriers beyond which more shorten this harvest by at most 1 % (`WORTH`). It is never above the number of bins."""
        times = [self.seconds(carriers) for carriers in range(1, self._layout.scenario.rows + 1)]
        return next(number for number, time in enumerate(times, start=1) if time * (1.0 - WORTH) <= min(times))

    def _exchanges(self, picker: str, block: Block) -> list[Exchange]:
        """A picker's exchanges, with the failures that its seed draws for it in place of their mean."""
        works = [lane.length / lane.pace for lane in map(self._layout.lane, block.rows)]
        stands = repairs(self._layout.scenario, picker, works)
        each = zip(exchanges(self._route, block), works, stands, strict=True)
        return [replace(exchange, picking=work + stand) for exchange, work, stand in each]

    def _call(self, picker: str, count: int, begins: float, early: bool) -> ScheduledCall:
        """Return the call for the bin of a picker that begins a row at a time, s."""
        exchange = self._rows[picker][count]
        full = begins + exchange.picking + exchange.leaving
        seen = begins - self._drive_in(self._layout.blocks[picker], count)
        return ScheduledCall(picker, count, max(seen, full - self._horizon) if early else full, full, exchange)

    def _drive_in(self, block: Block, count: int) -> float:
        """For how long a picker drives to the head of a row, in its direction, s: its bin can call from then on."""
        if count == 0 and block.start == "west":
            return 0.0
        side = self._route.east if self._route.side(count, block.start) is self._route.west else self._route.west
        return abs(side.x(self._route.WAITING) - self._route.end(block.rows[count], side)) / CRUISE

    def _report(self, call: ScheduledCall, now: float) -> BinReport:
        one = call.exchange
        end: End = "east" if one.side is self._route.east else "west"
        metres = self._route.distance(self._head.x, self._head.y, one.lane, one.side)
        since = ceil(call.begun / TIME_STEP)
        return BinReport(call.picker, one.lane, end, call.picker, since, metres, max(0.0, call.full - now), one.approach)
