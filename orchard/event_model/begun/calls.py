"""Calls at a moment: which bins call, which carriers come, and what the dispatcher is about to
do.
"""

from typing import Any

from orchard.behaviour.bin import CALL_AGAIN, BinMemory
from orchard.behaviour.dispatcher import Booking, DispatcherMemory
from orchard.contract.messages import CarrierStatus, Here, Offer, unpack
from orchard.dispatch.policies import dispatch_of
from orchard.event_model import codes as c
from orchard.event_model.begun.doing import Doing
from orchard.event_model.begun.moment import RunMoment
from orchard.event_model.begun.ops import Ops
from orchard.event_model.harvest import EventHarvest
from orchard.event_model.kernel import calls as kernel
from orchard.event_model.kernel import reports
from orchard.event_model.kernel.handling import MAIL
from orchard.event_model.kernel.reports import HEARD, ORDERED, REPORTED
from orchard.event_model.plain import as_python
from orchard.field.kinds import DISPATCH
from orchard.field.scenario import TIME_STEP
from orchard.plans.forecast import ALONG
from orchard.sim.world import NONE


class CallsOfBins:
    """Takes over what bins, carriers and the dispatcher know of calls.

    The model has a row of `calls` for each picker, about the bin that it fills or has left.
    """

    def __init__(
        self, moment: RunMoment, harvest: EventHarvest, ops: Ops, robots: list[Doing]
    ) -> None:
        self._moment = moment
        self._tick = moment.tick
        self._harvest = harvest
        self._model = harvest.model
        self._passes = harvest.program.passes.array
        self._ops = ops
        self._robots = robots
        self._numbers = {me.name: me for me in robots}
        self._bins = {name: number for number, name in enumerate(harvest.bin_names)}
        self._coupled = moment.world.coupled.tolist()
        self._full = moment.world.full.tolist()
        self._index = moment.world.layout.index
        self._is_early = as_python(reports.is_early)(harvest.model)
        self._has_dispatcher = harvest.model.desk[0].policy != c.BY_CALLS
        self._dispatcher: DispatcherMemory = moment.memories.get(DISPATCH) or DispatcherMemory()
        self._bookings = self._dispatcher.bookings

    def take_over(self) -> None:
        """Set the calls of all bins, and when the next ones are heard."""
        for me in self._robots:
            if "offered" in me.more:
                self._take_over_call(me)
            elif "asked" in me.more:
                self._hand_over(me)
        if self._has_dispatcher:
            self._take_over_policy()
        else:
            self._take_over_offers()

    def take_over_desk(self) -> None:
        """Set what the dispatcher does next. The columns of robots must have been written."""
        desk = self._model.desk[0]
        # A quarter after the last tick, when its agents have acted: their letters are events to
        # come.
        desk.now = c.QUARTERS * (self._tick - 1) + 1
        desk.deliveries = self._moment.world.delivered
        if self._has_dispatcher:
            self._go_on_dispatching(desk)

    # -- bins that are handed over

    def _hand_over(self, carrier: Doing) -> None:
        """Let the picker of a carrier that has left its empty bin know, or take, that bin."""
        name = carrier.memory.delivered
        picker = self._robots[carrier.more["customer"]]
        picker.more["bringer"] = carrier.number
        self._model.bins[self._bins[name]].taken = c.NEVER
        if picker.memory.taken == name:
            # The picker took it in the last tick or before. The carrier's next question gets the
            # same answer in both cases.
            self._model.bins[self._bins[name]].taken = self._tick - 1
        requests = self._moment.requests(carrier.name)
        if any(isinstance(request, Here) for request in requests):
            brought = c.QUARTERS * (self._tick - 1) + MAIL
            self._model.timers[c.BROUGHT, picker.number] = brought

    # -- calls

    def _take_over_call(self, picker: Doing) -> None:
        """Set the call of the bin that a picker fills, or has left."""
        if picker.bin == c.NONE or picker.kind == c.FETCH_EMPTY:
            self._call_of_left_bin(picker)
        elif self._is_early:
            self._call_of_filling_bin(picker)

    def _call_of_left_bin(self, picker: Doing) -> None:
        """Set the call of a full bin that stands in its lane."""
        number = picker.more["left_bin"]
        left = self._last_op(picker, c.LEAVE_BIN)
        if number == c.NONE or left is None:
            return
        name = self._harvest.bin_names[number]
        body = self._index[name]
        if self._coupled[body] == NONE and self._full[body]:
            self._model.bins[number].is_left = True
            self._model.bins[number].left_at = self._tick - 1
        memory = self._begin_call(picker, number, self._passes[self._ops.arg[left]])
        if memory.since < 0:
            return
        call = self._model.calls[picker.number]
        call.full = memory.since
        self._go_on_calling(picker, name, memory)

    def _call_of_filling_bin(self, picker: Doing) -> None:
        """Set the call of a bin that its picker fills."""
        begun = self._last_op(picker, c.BEGIN_ROW)
        if begun is None:
            return
        drive = self._passes[self._ops.arg[begun]]
        memory = self._begin_call(picker, picker.bin, drive)
        call = self._model.calls[picker.number]
        call.full = self._full_at(picker, begun, drive)
        call.silent_since = self._silent_since(picker, memory)
        is_repaired = picker.state == c.REPAIRED
        if is_repaired and self._picks(picker):
            call.failed = self._tick
        calls_at = as_python(reports.first_report)(self._model, call.full)
        if memory.since < 0 or not (memory.carrier or calls_at <= self._tick):
            # It has not called yet, or has paused: it had thought that its picker would be faster.
            call.is_reported = False
            call.since = max(self._tick, calls_at)
            call.reports_from = call.since
            # One whose picker is repaired begins to call after that.
            fills = call.failed == c.NONE or call.since <= call.failed
            if fills and call.since < call.silent_since:
                self._model.timers[c.REPORT, picker.number] = c.QUARTERS * call.since
        else:
            self._go_on_calling(picker, self._harvest.bin_names[picker.bin], memory)

    def _begin_call(self, picker: Doing, number: int, drive: Any) -> BinMemory:
        """Set the call of a bin that is left after a pass. Return the bin's memory."""
        memory = self._moment.memories.get(self._harvest.bin_names[number]) or BinMemory()
        call = self._model.calls[picker.number]
        call.bin = number
        call.end = drive.end
        call.failed = c.NONE
        call.is_reported = memory.since >= 0
        # A bin that has paused, because it was to be full later than it had thought, reports in
        # another rhythm than that of its first report.
        call.since = memory.since + (memory.asked - memory.since) % CALL_AGAIN
        call.reports_from = call.since
        call.known_since = call.since
        call.silent_since = c.NEVER
        call.is_served = bool(memory.carrier)
        return memory

    def _silent_since(self, picker: Doing, memory: BinMemory) -> int:
        """Return the tick from which a bin that its picker fills does not report; NEVER: it does.

        What is silent now has been since any tick after its last report.
        """
        silent = memory.asked + 1
        if picker.kind == c.LEAVE_BIN:
            return silent
        if picker.kind != c.DRIVE or not self._ops.is_seen[picker.op]:
            return c.NEVER
        stands = self._ops.tells_on_drive[picker.op] and not picker.memory.driving
        is_out = picker.here > float(self._ops.tells_to[picker.op]) + ALONG
        if stands or is_out:
            return silent
        return c.NEVER

    def _last_op(self, picker: Doing, kind: int) -> int | None:
        """Return a picker's last op of a kind since it got its present bin; None if there is
        none.
        """
        for op in range(picker.op - 1, picker.first - 1, -1):
            kind_before = int(self._ops.kind[op])
            if kind_before == kind:
                return op
            # By this op it got its present bin.
            if kind_before == c.FETCH_EMPTY:
                return None
        return None

    def _picks(self, picker: Doing) -> bool:
        """Whether a picker is on a drive on which it picks."""
        return picker.kind == c.DRIVE and self._ops.speed[picker.op] == 0.0

    def _full_at(self, picker: Doing, begun: int, drive: Any) -> float:
        """Return the tick at which a bin is full whose picker has begun a row."""
        elapsed = 0.0
        for op in range(begun, picker.op):
            elapsed += float(self._ops.ticks[op])
            if int(self._ops.kind[op]) == c.DRIVE:
                elapsed += float(self._ops.metres[op]) / self._speed(op) / TIME_STEP
        if picker.kind == c.DRIVE:
            ahead = float(self._ops.target[picker.op]) - picker.here
            driven = float(self._ops.metres[picker.op]) - ahead
            elapsed += driven / self._speed(picker.op) / TIME_STEP
        elapsed += picker.turned
        op = self._model.ops[begun]
        speed = as_python(reports.speed_seen)(self._model, op)
        ticks = as_python(reports.ticks_to_fill)(self._model, op, drive, speed)
        return self._tick - elapsed + float(ticks)

    def _speed(self, op: int) -> float:
        """Return the speed of a drive, m/s."""
        return float(self._ops.speed[op]) or float(self._model.speeds[self._ops.arg[op]])

    def _go_on_calling(self, picker: Doing, name: str, memory: BinMemory) -> None:
        """Set when a bin that calls is heard next, and which carrier comes."""
        if memory.carrier and memory.coming:
            return
        if self._has_dispatcher:
            self._go_on_reporting(picker, name, memory)
        else:
            self._go_on_asking_all(picker, name, memory)

    def _has_job(self, carrier: str, bin_name: str) -> bool:
        """Whether a carrier has taken the job of a bin."""
        job = self._numbers[carrier].memory.job
        return job is not None and job.bin == bin_name

    # -- calls that ask all carriers

    def _go_on_asking_all(self, picker: Doing, name: str, memory: BinMemory) -> None:
        """Set when all carriers hear a bin, or the one that it has chosen."""
        timers = self._model.timers
        self._model.bins[self._bins[name]].since = memory.since
        call = self._model.calls[picker.number]
        chosen = memory.carrier or self._chosen(name)
        if chosen and self._has_job(chosen, name):
            # It has agreed, and the bin will hear of that.
            return
        if chosen:
            call.carrier = self._numbers[chosen].number
            # It is sent for two ticks after the call was heard, and hears that a tick later.
            sent = self._tick
            if memory.carrier:
                sent = memory.asked
            timers[c.COME, picker.number] = c.QUARTERS * max(self._tick, sent + ORDERED)
        elif memory.asked == self._tick - 1:
            timers[c.CALL_HEARD, picker.number] = c.QUARTERS * self._tick
        else:
            # Carriers hear a call in the tick after it.
            heard = memory.asked + CALL_AGAIN + 1
            timers[c.CALL_HEARD, picker.number] = c.QUARTERS * heard

    def _chosen(self, name: str) -> str:
        """Return the carrier that a bin chooses at the next tick; '' if it hears no offer."""
        offers = []
        for sender, answer in self._moment.answers(name):
            if isinstance(answer, Offer):
                offers.append((round(answer.distance, 3), sender))
        if not offers:
            return ""
        _, nearest = min(offers)
        return nearest

    def _take_over_offers(self) -> None:
        """Set which calls carriers have heard, and which offers they have made."""
        for me in self._robots:
            for name, heard in getattr(me.memory, "calls", {}).items():
                bin_ = self._model.bins[self._bins[name]]
                bin_.since = heard.since
                bin_.called = max(int(bin_.called), heard.tick)
                self._model.offers[me.number, self._bins[name]] = min(c.NEVER, heard.offered)

    # -- the dispatcher

    def _go_on_reporting(self, picker: Doing, name: str, memory: BinMemory) -> None:
        """Set what the dispatcher knows of a bin, and when its carrier hears that it was sent."""
        call = self._model.calls[picker.number]
        is_told = memory.asked >= self._tick - REPORTED
        call.is_open = is_told or name in self._dispatcher.bins
        booking = self._bookings.get(name)
        if memory.carrier:
            # It was sent for, and hears that a tick later.
            self._order(picker, memory.carrier, memory.asked + ORDERED)
        elif booking is None or self._is_over(booking):
            if not call.is_open and call.silent_since == c.NEVER:
                # The dispatcher of a fork knows nothing, and hears of the bin when it reports next.
                next_report = max(self._tick, memory.asked + CALL_AGAIN)
                self._model.timers[c.REPORT, picker.number] = c.QUARTERS * next_report
        elif booking.is_answered:
            # The dispatcher has answered the report in the tick in which it heard that.
            report = booking.told - REPORTED
            self._order_after(picker, booking.carrier, report)
        else:
            # The bin is told by the answer to a report that the dispatcher has not heard yet: the
            # last one, if that is on its way, or else the next one.
            report = memory.asked
            is_on_its_way = report == self._tick - 1
            if not is_on_its_way:
                report += CALL_AGAIN
            self._order_after(picker, booking.carrier, report)

    def _is_over(self, booking: Booking) -> bool:
        """Whether a carrier that was booked for a bin has come, and the bin calls anew."""
        return booking.is_answered and booking.told + HEARD < self._tick

    def _order_after(self, picker: Doing, carrier: str, report: int) -> None:
        """Let a bin hear by the answer to a report which carrier comes, and order that one."""
        self._order(picker, carrier, report + HEARD + ORDERED)
        self._plan_order(picker, report)

    def _order(self, picker: Doing, carrier: str, tick: int) -> None:
        """Let a carrier hear at a tick that it was sent."""
        call = self._model.calls[picker.number]
        if self._has_job(carrier, self._harvest.bin_names[int(call.bin)]):
            # It has agreed, and the bin will hear of that.
            call.is_open = False
            return
        me = self._numbers[carrier]
        call.is_booked = True
        call.carrier = me.number
        me.more["is_booked"] = True
        self._model.timers[c.ORDER, picker.number] = c.QUARTERS * max(self._tick, tick)

    def _plan_order(self, picker: Doing, report: int) -> None:
        """Let the carrier of a bin that is booked be sent after a report, or be free again."""
        if self._model.calls[picker.number].is_booked:
            as_python(reports.plan_order)(self._model, picker.number, report)
            order = self._model.timers[c.ORDER]
            order[picker.number] = max(order[picker.number], c.QUARTERS * self._tick)

    def _take_over_policy(self) -> None:
        """Set what the policy remembers."""
        for booking in self._bookings.values():
            if booking.is_answered:
                self._numbers[booking.carrier].more["bin_reported"] = booking.told - REPORTED
        if not self._dispatcher.policy:
            return
        policy = dispatch_of(self._moment.world.layout)
        memory = unpack(self._dispatcher.policy, policy.Memory)
        asked = self._harvest.asked_policy
        if asked is not None:
            asked.memory = memory
            if not asked.decides_when_due:
                return
        for name, tick in getattr(memory, "full", {}).items():
            self._model.bins[self._bins[name]].full = tick

    def _go_on_dispatching(self, desk: Any) -> None:
        """Set whether the dispatcher asks, decides, or rests."""
        asked = self._dispatcher.asked
        desk.asked = asked
        if asked == self._tick - 1:
            desk.state = c.ABOUT_TO_ASK
            self._decide_at(self._tick)
        elif asked == self._tick - 2:
            desk.state = c.ABOUT_TO_DECIDE
            self._decide_at(self._tick)
            for sender, answer in self._moment.answers(DISPATCH):
                if isinstance(answer, CarrierStatus):
                    self._hear_status(self._numbers[sender], answer)
        else:
            as_python(kernel.wake_dispatcher)(self._model)

    def _decide_at(self, tick: int) -> None:
        """Let the dispatcher hear the carriers, or decide, at a tick."""
        self._model.timers[c.DISPATCH, 0] = c.QUARTERS * tick

    def _hear_status(self, carrier: Doing, status: CarrierStatus) -> None:
        """Set what a carrier has answered to the dispatcher."""
        me = self._model.robots[carrier.number]
        me.is_ready = status.is_next and not me.is_booked
        me.millimetres_to_head = as_python(kernel.whole_millimetres)(status.metres)
        if self._harvest.asked_policy is not None:
            me.metres_to_head = status.metres
            me.is_told = not me.is_booked
            me.told_job = self._bins.get(status.job, c.NONE)
