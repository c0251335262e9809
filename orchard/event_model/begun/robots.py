"""What each robot does at a moment: its op, the state in it, and when it goes on."""

from collections.abc import Callable
from math import ceil
from typing import Any

from orchard.contract.messages import BinState, StateRequest, Yes
from orchard.event_model import codes as c
from orchard.event_model.begun.claims import Claims
from orchard.event_model.begun.doing import (
    Doing,
    NotInPlanError,
    has_step,
    inserted_steps,
    step_of,
)
from orchard.event_model.begun.moment import RunMoment
from orchard.event_model.begun.ops import Ops
from orchard.event_model.harvest import EventHarvest
from orchard.event_model.kernel.bay import later
from orchard.event_model.picker_plans import end_number
from orchard.event_model.plain import as_python
from orchard.field.geometry import HEADINGS, Pose, angle_between
from orchard.field.kinds import kind_of
from orchard.field.queue import BESIDE
from orchard.field.scenario import TIME_STEP
from orchard.field.ticks import BIN_FOLLOWS, ROUNDING, whole_ticks
from orchard.plans import steps as st
from orchard.plans.handling import EXCHANGE
from orchard.plans.robot import ASK, PATIENCE, Step
from orchard.sim.world import NONE

# A robot that comes from such an op has just come to stand.
MOVES = (c.DRIVE, c.TURN)
# Such ops are over in the tick in which they begin.
AT_ONCE = (c.BEGIN_ROW, c.END_ROW, c.FREE, c.HAUL, c.HOME, c.MAY_CHARGE, c.CHARGE)


class Robots:
    """Finds what the robots of a harvest do at a moment."""

    def __init__(self, moment: RunMoment, harvest: EventHarvest, claims: Claims) -> None:
        self.moment = moment
        self._claims = claims
        self._harvest = harvest
        self.tick = moment.tick
        self.layout = moment.world.layout
        self.program = harvest.program
        # Name -> number in the event model, of robots and of bins.
        self.numbers = {name: number for number, name in enumerate(harvest.names)}
        self.bins = {name: number for number, name in enumerate(harvest.bin_names)}
        # Of each body, by its index in the layout.
        self._pose = moment.world.pose.tolist()
        self._coupled = moment.world.coupled.tolist()
        self._full = moment.world.full.tolist()
        self._charge = moment.world.charge.tolist()
        self._translate_jobs()
        self.ops = Ops(self.program)

    def _translate_jobs(self) -> None:
        """Translate the jobs that carriers do. The program may grow by that."""
        for name in self.numbers:
            if name not in self.layout.blocks:
                self._plan_of_carrier(name)

    def all(self) -> list[Doing]:
        """Return what each robot does, in the order of their names.

        Raises NotInPlanError.
        """
        doing = []
        for name in self.numbers:
            if name in self.layout.blocks:
                doing.append(self._picker(name))
            else:
                doing.append(self._carrier(name))
        return doing

    # -- plans

    def _picker(self, name: str) -> Doing:
        """Return what a picker does."""
        memory = self._memory(name)
        first = self.program.harvests[name]
        # The last of `begins` is the end of the plan, and no step.
        unplanned = len(self.program.begins[first]) - 1 - memory.planned
        me = self._doing(name, first, max(0, unplanned))
        me.more["offered"] = self.bins.get(memory.offered, c.NONE)
        me.more["left_bin"] = self.bins.get(memory.full_bin, c.NONE)
        if me.bin == c.NONE:
            me.more["full_since"] = memory.since
        return me

    def _carrier(self, name: str) -> Doing:
        """Return what a carrier does."""
        memory = self._memory(name)
        job_first = self._plan_of_carrier(name)
        decided = self._op_that_let_charge(memory, job_first)
        first = job_first
        if decided != c.NONE:
            # The column `arg` of such an op is the first op of the plan to charge.
            first = int(self.ops.arg[decided])
        me = self._doing(name, first, 0)
        me.decided = decided
        me.job_first = job_first
        me.more["queue_line"] = self._queue_line(name)
        me.more["is_free"] = memory.job is None
        me.more["left_bin"] = self.bins.get(memory.delivered, c.NONE)
        if memory.job is not None:
            me.more["customer"] = self.numbers[memory.job.picker]
            me.more["job_bin"] = self.bins[memory.job.bin]
            me.more["knows_left"] = memory.left == memory.job.bin
            question = f"StateRequest {memory.job.bin}"
            if me.kind == c.DRIVE and question in memory.asked:
                me.more["bin_asked"] = memory.asked[question]
            if decided == c.NONE or has_step(memory, st.Charge):
                # It has not come to the end of its way, in a line of the queue: `Charge` is done
                # there. When it left the queue is not known, so the way is counted from here.
                me.more["away"] = self.tick
        if isinstance(me.step, st.Haul):
            self._be_away(me)
        return me

    def _op_that_let_charge(self, memory: Any, job_first: int) -> int:
        """Return the op of a job at which a carrier began to drive to the chargers; NONE if it
        does not charge.
        """
        if not has_step(memory, st.Charged):
            return c.NONE
        op = job_first
        while int(self.ops.kind[op]) != c.MAY_CHARGE:
            op += 1
        return op

    def _be_away(self, me: Doing) -> None:
        """Be away at the load-out for the rest of the time.

        It gets calls once it is back; if it charges then, only after that. Its way was counted
        when it came to its line: it is outside the queue no longer.
        """
        me.more["is_free"] = not has_step(me.memory, st.Charge)
        me.more["away"] = c.NEVER
        me.more["back"] = me.memory.since + self.layout.machines["carrier"].haul_ticks

    def _memory(self, name: str) -> Any:
        """Return what a robot remembers. Raises NotInPlanError if it is driven from elsewhere."""
        memory = self.moment.memories.get(name)
        if memory is None:
            raise NotInPlanError(f"{name} does not say what it remembers")
        return memory

    def _queue_line(self, name: str) -> int:
        """Return the number of the line of the queue that a carrier's plan begins in.

        That is the charging line in which the carrier stands, or else the line that is its own.
        """
        x, y, _ = self._pose[self.layout.index[name]]
        area = self.layout.queue.area
        for line in self.program.charging_lines:
            is_beside = abs(y - self.program.queue_lines[line]) < BESIDE
            if is_beside and area.west <= x <= area.east:
                return line
        return self.program.queue_line(name)

    def _plan_of_carrier(self, name: str) -> int:
        """Return the op at which a carrier's plan begins: its job, or waiting in the queue."""
        job = self._memory(name).job
        line = self._queue_line(name)
        if job is None:
            return self.program.waiting[line]
        end = end_number(job.lane, job.side)
        first = int(self.program.jobs[line, end])
        if first == c.NONE:
            first = self.program.translate_job(line, end)
        return first

    def _doing(self, name: str, first: int, unplanned: int) -> Doing:
        """Return what a robot does. `unplanned`: steps of its plan that its memory has not yet."""
        memory = self._memory(name)
        if memory.way:
            raise NotInPlanError(f"{name} comes back to its course")
        inserted = inserted_steps(memory)
        op = self._op_of(name, first, inserted, unplanned)
        body = self.layout.index[name]
        me = Doing(
            name=name,
            number=self.numbers[name],
            memory=memory,
            pose=Pose(*self._pose[body]),
            bin=self._bin_on(body),
            first=first,
            op=op,
            kind=int(self.ops.kind[op]),
            step=step_of(memory),
            alarm=self.tick,
        )
        me.more["done"] = memory.done
        me.more["stood"] = memory.since
        if memory.moving:
            me.more["stood"] = self.tick
        me.more["failures"] = memory.failures
        me.more["worked"] = memory.worked
        me.more["is_emptied"] = self._is_emptied(me)
        if inserted:
            self._be_repaired(me, memory.plan[:inserted])
        else:
            self._go_on(me)
        return me

    def _is_emptied(self, me: Doing) -> bool:
        """Whether a carrier, on its drive to its place in the bay, has a bin that the bay has
        emptied.
        """
        drives_to_bay = me.kind == c.DRIVE and int(self.ops.kind[me.op + 1]) == c.UNLOAD
        body = self._coupled[self.layout.index[me.name]]
        return drives_to_bay and not bool(self._full[body])

    def _op_of(self, name: str, first: int, inserted: int, unplanned: int) -> int:
        """Return the op in which a robot is. `inserted`: steps that a failure has put before its
        plan. `first`, `unplanned`: see `_doing`.

        A memory has only the steps that are not done. So the steps to come are counted from the end
        of the plan: if it has 5 steps, and 2 of them are left, the robot is in step 3, counted
        from 0.
        """
        memory = self._memory(name)
        # The op at which each step begins, and last the one that ends the plan.
        begins = self.program.begins[first]
        steps = len(begins) - 1
        left = len(memory.plan) - inserted + unplanned
        number = steps - left
        if number >= 0:
            return self._lasting(begins[number])
        if number == -1 and isinstance(step_of(memory), st.Realign):
            # At the start of a run it turns to face along its line.
            return begins[0]
        raise NotInPlanError(f"{name} has steps that are not of its plan")

    def _bin_on(self, body: int) -> int:
        """Return the bin on the bar of a robot, which is a body of the layout; NONE: none."""
        hitch = self._coupled[body]
        if hitch == NONE:
            return c.NONE
        return self.bins[self.layout.names[hitch]]

    def _lasting(self, op: int) -> int:
        """Return the first op from here on that takes time.

        The step has begun, so those of its ops that take none are over.
        """
        while int(self.ops.kind[op]) in AT_ONCE:
            op += 1
        return op

    # -- ops

    def _go_on(self, me: Doing) -> None:
        """Set the state of a robot in its op, and when it goes on."""
        if me.kind == c.DRIVE:
            if not me.memory.moving:
                self._be_emptied(me)
            return
        go_on = self._ways_on.get(me.kind, self._begin)
        go_on(me)

    @property
    def _ways_on(self) -> dict[int, Callable[[Doing], None]]:
        """How a robot goes on, by the kind of its op. One that drives has none: it looks again, and
        `lines` sets from where.
        """
        return {
            c.END: self._rest,
            c.TURN: self._turn,
            c.PAUSE: self._pause,
            c.NEED: self._await_places,
            c.ALONE_IN: self._await_partner_gone,
            c.LEAVE_BIN: self._leave_bin,
            c.TAKE_BIN: self._take_bin,
            c.DELIVER: self._deliver,
            c.FETCH_EMPTY: self._fetch,
            c.UNLOAD: self._unload,
            c.CHARGED: self._await_charge,
        }

    def _begin(self, me: Doing) -> None:
        """Begin the op at the next tick.

        To the machine the robot has just done the op before it.
        """
        me.state = c.IDLE
        me.more["next_op"] = me.op
        me.op -= 1

    def _rest(self, me: Doing) -> None:
        """Have nothing to do until an order comes."""
        me.state = c.IDLE
        me.alarm = None

    def _pause(self, me: Doing) -> None:
        """Stand for the rest of the time."""
        begun = me.memory.since
        if isinstance(me.step, st.Confirmed):
            # A carrier that was sent does that step in the middle of another plan.
            begun = me.memory.asked.get(f"Confirm {me.step.bin}", self.tick)
        self._last(me, begun + int(self.ops.ticks[me.op]))

    def _await_places(self, me: Doing) -> None:
        """Ask for the op's places, or go on with them, at the next tick."""
        me.state = c.WAITING_FOR_PLACES

    def _leave_bin(self, me: Doing) -> None:
        """Uncouple the full bin for the rest of the time that it takes."""
        self._uncouple(me, c.LEAVING_BIN, me.memory.full_bin)

    def _last(self, me: Doing, until: int) -> None:
        """Last up to a tick, and go on then."""
        me.state = c.LASTING
        me.alarm = max(self.tick, until)

    def _turn(self, me: Doing) -> None:
        """Turn for the rest of the turn."""
        left = 0.0
        if isinstance(me.step, st.Face):
            left = abs(angle_between(me.pose.yaw, HEADINGS[me.step.heading]))
        turn = self.layout.machines[kind_of(me.name)].turn
        ticks = ceil(left / (turn * TIME_STEP) - ROUNDING)
        me.turned = int(self.ops.ticks[me.op]) - ticks
        self._last(me, self.tick + ticks)

    def _await_partner_gone(self, me: Doing) -> None:
        """Look at the next tick if the robot hears then that it is alone; or else in the tick after
        it sends a claim, because traffic has heard the claim by then.
        """
        assert isinstance(me.step, st.Alone)
        me.state = c.WAITING_FOR_PARTNER
        claimed = me.memory.claimed
        answer = self._claims.answer(me.name)
        if answer is not None and me.step.place in answer.alone:
            me.alarm = self.tick
        elif claimed < self.tick - 1:
            # Its last claim was heard before, so it looks after its next one.
            next_claim = max(self.tick, claimed + PATIENCE)
            me.alarm = next_claim + 1
        else:
            me.alarm = claimed + 1

    def _handle(self, me: Doing, state: int) -> None:
        """Couple or uncouple for the rest of the time that it takes.

        That is less time if the robot had stood before it began.
        """
        handles = self.ops.handles_at_rest
        if int(self.ops.kind[me.op - 1]) in MOVES:
            handles = self.ops.handles
        ticks = int(handles[me.op])
        me.state = state
        me.alarm = max(self.tick, me.memory.since + ticks)

    def _uncouple(self, me: Doing, state: int, bin_name: str) -> None:
        """Uncouple a bin for the rest of the time that it takes."""
        self._handle(me, state)
        if me.bin == c.NONE:
            # Physics has uncoupled it, and the robot will see that.
            me.bin = self.bins[bin_name]
            me.alarm = self.tick

    def _take_bin(self, me: Doing) -> None:
        """Couple the full bin for the rest of the time that it takes."""
        self._handle(me, c.TAKING_BIN)
        if me.bin != c.NONE:
            # Physics has coupled it, and the carrier will see that.
            me.bin = c.NONE
            me.alarm = self.tick

    def _deliver(self, me: Doing) -> None:
        """Leave the empty bin; or ask the picker again and again whether it has taken that, and go
        on when it is heard that it has.
        """
        assert isinstance(me.step, st.Deliver)
        picker = me.step.picker
        asked = me.memory.asked.get(f"Here {picker}")
        if asked is None:
            self._uncouple(me, c.DROPPING_BIN, me.memory.delivered)
            return
        me.more["asked"] = asked
        hears = asked + ASK
        is_yet_to_hear = hears >= self.tick
        if is_yet_to_hear and self._has_taken(me.name, picker, me.memory.delivered, asked):
            self._last(me, hears)
        else:
            me.state = c.HANDING_OVER
            me.alarm = asked + PATIENCE

    def _has_taken(self, carrier: str, picker: str, bin_name: str, asked: int) -> bool:
        """Whether a picker says yes, because it has taken the bin, to a carrier's question to which
        the answer is not heard yet.

        `asked`: the tick of that question, the last one or the one before.
        """
        if self.moment.memories[picker].taken != bin_name:
            return False
        if asked == self.tick - 1:
            # The picker will hear the question, and knows by now what it answers.
            return True
        # It has answered, perhaps before it took the bin.
        heard = self.moment.answers(carrier)
        return any(sender == picker and isinstance(answer, Yes) for sender, answer in heard)

    def _fetch(self, me: Doing) -> None:
        """Wait for the empty bin, couple it, or take over its place."""
        if me.memory.offered == "":
            me.state = c.WAITING_FOR_BIN
            me.alarm = None
            return
        begun = me.memory.asked.get(EXCHANGE)
        if begun is not None:
            # It has the bin and its place. The op after this one is the time of the exchange.
            me.op += 1
            self._last(me, begun + int(self.ops.ticks[me.op]))
        elif me.bin != c.NONE and self._has_claimed_place(me):
            me.state = c.TAKING_PLACE
        else:
            # Physics may have coupled it, and the picker will see that.
            me.state = c.COUPLING
            me.bin = c.NONE
            asked = me.memory.asked.get(f"couple {me.memory.offered}")
            if asked is not None and self.layout.machines["picker"].rest_before_coupling:
                me.alarm = max(self.tick, asked + int(self.ops.handles_at_rest[me.op]))

    def _has_claimed_place(self, me: Doing) -> bool:
        """Whether a picker has asked for the place of its empty bin."""
        assert isinstance(me.step, st.FetchEmpty)
        place = me.step.place
        return place in me.memory.reserved or self._claims.is_waiting_for(me.name, place)

    def _unload(self, me: Doing) -> None:
        """Wait until the bay takes the bin, and it is empty; or, if it is, until the carrier hears
        of that.
        """
        body = self._coupled[self.layout.index[me.name]]
        if body == NONE or not self._full[body]:
            # The op after this one is the time until the carrier hears.
            me.op += 1
            self._last(me, self._hears_of_empty(me.name, self.layout.names[body]))
            return
        # The tick from which on the bay may take the bin, which comes to stand after its carrier.
        rests = me.memory.since + BIN_FOLLOWS
        # Ticks for which it was unloaded by now.
        unloaded = int(self.moment.world.bay_ticks[body])
        me.more["asked"] = me.memory.since
        me.more["is_taken"] = unloaded > 0
        if not unloaded:
            # It looks whether the bay takes its bin.
            self._last(me, rests)
            return
        taken = self.tick - unloaded
        waited = taken - rests
        # From when the carrier stands until its bin is empty, if the bay takes that at once.
        ticks = int(self.ops.ticks[me.op])
        me.more["hears_later"] = as_python(later)(ticks, waited)
        self._last(me, me.memory.since + waited + ticks)

    def _hears_of_empty(self, carrier: str, bin_name: str) -> int:
        """Return the tick at which a carrier hears that its bin is empty."""
        for sender, answer in self.moment.answers(carrier):
            if sender == bin_name and isinstance(answer, BinState) and not answer.full:
                return self.tick
        asked = self._memory(carrier).asked[f"{StateRequest.__name__} {bin_name}"]
        if asked < self.tick - 1:
            # The bin has heard that question, and was full then: the carrier will ask again.
            asked += PATIENCE
        return int(asked + ASK)

    def _await_charge(self, me: Doing) -> None:
        """Stand until the battery is full; or, if it is, until the carrier sees that."""
        me.state = c.WAITING_FOR_CHARGE
        if self._charge[self.layout.index[me.name]] < 1.0:
            me.alarm = None

    # -- failures

    def _be_repaired(self, me: Doing, inserted: list[Step]) -> None:
        """Drive up to where the robot fails, or be repaired there.

        `inserted`: the steps of that, which are not of the plan.
        """
        step = inserted[0]
        repairs = [part.seconds for part in inserted if isinstance(part, st.Repair)]
        me.more["repair"] = sum(repairs)
        me.more["fails"] = True
        if isinstance(step, st.Wait):
            me.state = c.REPAIRED
            part_ends = max(self.tick, me.memory.since + whole_ticks(step.seconds))
            me.more["part_ends"] = part_ends
            me.alarm = part_ends
            self._be_emptied(me)

    def _be_emptied(self, me: Doing) -> None:
        """Let the bay go on with the bin of a carrier that is repaired or held up in it."""
        body = self._coupled[self.layout.index[me.name]]
        if int(self.ops.kind[me.op + 1]) != c.UNLOAD or self._is_emptied(me):
            return
        x, y, _ = self._pose[body]
        if not self.layout.bay.contains(x, y):
            return
        unloaded = int(self.moment.world.bay_ticks[body])
        me.more["is_taken"] = unloaded > 0
        # The bay looks again in this tick whether it takes the bin, unless it has.
        next_look = self.tick
        if unloaded:
            next_look += int(self.ops.ticks[me.op + 1]) - BIN_FOLLOWS - unloaded
        me.more["emptied_next"] = c.QUARTERS * next_look
        assert me.alarm is not None
        me.alarm = min(me.alarm, next_look)
