"""Which robot follows which at a moment: on which lines robots are, and in which order.

A line is a straight on which robots drive in one direction (`program_columns.LINE`). "Along" it
means the coordinate in its direction, m; a robot further on has a larger one. A robot with a bin
that turns off its line swings the bin "across" it.

A robot's last ops tell on which line it is: it enters the line of a drive once it has driven so far
that its bin has left the line before.
"""

from dataclasses import dataclass

import numpy as np

from orchard.event_model import codes as c
from orchard.event_model.begun.doing import Doing
from orchard.event_model.begun.ops import Ops
from orchard.event_model.harvest import EventHarvest
from orchard.event_model.kernel import roads, turns
from orchard.event_model.kernel.roads import BESIDE, CLEAR, NEAR, OFF_THE_LINE
from orchard.event_model.plain import as_python
from orchard.event_model.program import Program
from orchard.plans import steps as st

# After such an op a robot has no bin on its bar, or has one.
DROPS = (c.DELIVER, c.LEAVE_BIN)
TAKES = (c.TAKE_BIN, c.FETCH_EMPTY)
# Ops before the present one that are looked at: between two of them is a drive that is long enough.
LOOKED_BACK = 40


@dataclass
class OnLine:
    """A robot on a line, as others that drive there see it."""

    # NONE: it is on no line.
    line: int = c.NONE
    # Where it is along the line, m.
    at: float = 0.0
    # Up to where it drives there, m.
    end: float = 0.0
    # Whether its bin stands across the line, or has left it.
    is_across: bool = False


class LinesOfRobots:
    """Finds on which lines robots are, and puts them there in their order."""

    def __init__(self, harvest: EventHarvest, ops: Ops) -> None:
        self._harvest = harvest
        self._model = harvest.model
        self._program: Program = harvest.program
        self._ops = ops
        self._blocks = harvest.layout.blocks
        table = self._program.lines
        lines = table.array.view(np.ndarray)
        self._axis = lines["axis"]
        self._other = lines["other"]
        self._sign = lines["sign"]

    def place(self, me: Doing) -> OnLine:
        """Return where a robot is on its line. Set what remains of its drive, if it drives."""
        on_line = self._at_first(me)
        has_bin = True
        for op in ops_before(me):
            kind = int(self._ops.kind[op])
            if kind in DROPS:
                has_bin = False
            elif kind in TAKES:
                has_bin = True
            elif kind == c.DRIVE:
                self._arrive(on_line, op, self._end_of(op, me))
            elif kind == c.TURN:
                self._swing(on_line, me, has_bin)
        if me.kind == c.TURN:
            self._go_on_turning(on_line, me)
        elif me.kind == c.DRIVE and me.state != c.IDLE:
            self._go_on_driving(on_line, me)
        return on_line

    def _at_first(self, me: Doing) -> OnLine:
        """Return on which line a robot is when its plan begins: a carrier that gets a job stands in
        its line of the queue.
        """
        done = me.op - me.first
        if me.decided != c.NONE:
            done = me.decided - me.job_first
        if "customer" not in me.more or done > LOOKED_BACK:
            return OnLine()
        line = int(self._ops.line[self._program.waiting[me.more["queue_line"]]])
        here = self._along(line, me.pose.x, me.pose.y)
        return OnLine(line=line, at=here, end=here)

    def _along(self, line: int, x: float, y: float) -> float:
        """Return where a point is along a line, m."""
        if self._axis[line] == 0:
            return float(self._sign[line]) * x
        return float(self._sign[line]) * y

    # -- what was before

    def _end_of(self, op: int, me: Doing) -> float:
        """Return where a drive that a robot has done has led to, along its line, m."""
        target = float(self._ops.target[op])
        if np.isinf(self._ops.unloads_from[op]):
            return target
        # A carrier may stand at a place of the bay before it.
        return min(target, self._along(int(self._ops.line[op]), me.pose.x, me.pose.y))

    def _left_at(self, on_line: OnLine, op: int, begun: float) -> float:
        """Return where a robot that began a drive had left the line before it, along the drive."""
        line = int(self._ops.line[op])
        if on_line.line == c.NONE or self._axis[on_line.line] == self._axis[line]:
            return begun
        return min(begun, float(self._sign[line] * self._other[on_line.line]))

    def _arrive(self, on_line: OnLine, op: int, at: float) -> bool:
        """Be on the line of a drive at a place, if it is far enough. Return whether it is."""
        line = int(self._ops.line[op])
        begun = float(self._ops.target[op] - self._ops.metres[op])
        driven = at - self._left_at(on_line, op, begun)
        if on_line.line not in (c.NONE, line) and driven < CLEAR - NEAR:
            return False
        if on_line.line != line:
            on_line.is_across = False
        on_line.line = line
        on_line.at = at
        on_line.end = at
        return True

    def _swing(self, on_line: OnLine, me: Doing, has_bin: bool) -> None:
        """Swing the bin across the line, or leave that."""
        if has_bin and not on_line.is_across:
            on_line.is_across = True
        elif on_line.is_across and self._is_beside(on_line, me):
            on_line.line = c.NONE

    def _is_beside(self, on_line: OnLine, me: Doing) -> bool:
        """Whether a robot is clear of the line on which it was."""
        if on_line.line == c.NONE:
            return False
        across = me.pose.x
        if self._axis[on_line.line] == 0:
            across = me.pose.y
        return abs(across - float(self._other[on_line.line])) > BESIDE

    # -- what goes on

    def _go_on_turning(self, on_line: OnLine, me: Doing) -> None:
        """Set what remains until the bin, or the robot, is out of the way of those behind."""
        if me.turned == 0:
            # Something was in its way in the last tick, and it looks again.
            me.state = c.LOOKING_AROUND
            me.alarm = self._turns_until(me) - int(self._ops.ticks[me.op])
            return
        has_bin = me.bin != c.NONE
        is_carrier_towing = has_bin and me.name not in self._blocks
        swings = int(self._ops.swings[me.op])
        if has_bin and not on_line.is_across:
            if is_carrier_towing:
                self._note_swing(me, is_aside=False)
            self._swing_for(on_line, me, swings, c.SWINGING_BIN)
        elif on_line.is_across and self._is_beside(on_line, me):
            if is_carrier_towing and self._leads_back(on_line, me):
                self._note_swing(me, is_aside=True)
                off_the_line = as_python(roads.ticks_of_parts)(self._model, OFF_THE_LINE)
                swings = min(int(self._ops.ticks[me.op]), off_the_line)
            self._swing_for(on_line, me, swings, c.SWINGING_OFF)

    def _leads_back(self, on_line: OnLine, me: Doing) -> bool:
        """Whether a robot turns into a line beside the one that it has left, along it."""
        leads_back: bool = as_python(turns.leads_back)(self._model, me.op, on_line.line)
        return leads_back

    def _note_swing(self, me: Doing, is_aside: bool) -> None:
        """Set since when a carrier swings its bin, as those behind it see."""
        me.more["swings_since"] = self._turns_until(me) - int(self._ops.ticks[me.op])
        me.more["swings_aside"] = is_aside

    def _swing_for(self, on_line: OnLine, me: Doing, swings: int, state: int) -> None:
        """Be out of the way after so many ticks of the turn, or be so by now."""
        if me.turned >= swings:
            self._swing(on_line, me, me.bin != c.NONE)
            return
        me.state = state
        me.alarm = self._turns_until(me) - (int(self._ops.ticks[me.op]) - swings)

    def _turns_until(self, me: Doing) -> int:
        """Return the tick at which a robot that turns has turned."""
        assert me.alarm is not None
        return me.alarm

    def _go_on_driving(self, on_line: OnLine, me: Doing) -> None:
        """Set where a robot is on its drive, and up to where it drives."""
        ops = self._ops
        line = int(ops.line[me.op])
        sign = float(self._sign[line])
        target = float(ops.target[me.op])
        me.here = self._along(line, me.pose.x, me.pose.y)
        begun = target - float(ops.metres[me.op])
        me.more["here"] = me.here
        me.more["left_at"] = self._left_at(on_line, me.op, begun)
        me.more["stop"] = target
        if me.more.get("fails") and isinstance(me.step, st.DriveTo):
            # One of the two is None.
            me.more["stop"] = sign * float(me.step.x or me.step.y or 0.0)
        me.more["next_need"] = int(ops.first_need[me.op])
        me.more["next_free"] = int(ops.first_free[me.op])
        has_arrived = self._arrive(on_line, me.op, me.here)
        me.more["has_arrived"] = has_arrived
        course = me.memory.course
        if has_arrived and course is not None:
            goal = self._along(line, course.x, course.y)
            on_line.end = max(me.here, min(goal, me.more["stop"]))

    # -- the order

    def line_up(self, places: list[OnLine], tick: int) -> None:
        """Put robots on their lines, each behind the one that is further on.

        `places`: of each robot, by its number. Its bin and its size must have been set before.
        """
        on_line: dict[int, list[int]] = {}
        for number, place in enumerate(places):
            if place.line != c.NONE:
                on_line.setdefault(place.line, []).append(number)
        for line, numbers in on_line.items():
            numbers.sort(key=lambda number: -places[number].at)
            self._line_up(line, numbers, places, tick)

    def _line_up(self, line: int, numbers: list[int], places: list[OnLine], tick: int) -> None:
        """Put robots on a line, the first one first."""
        model = self._harvest.model
        ahead = c.NONE
        for number in numbers:
            me = model.robots[number]
            place = places[number]
            me.line = line
            me.is_across = place.is_across
            me.line_end = place.end
            me.ahead = ahead
            if ahead != c.NONE:
                model.robots[ahead].behind = number
                room = float(as_python(roads.room_at)(model, number, ahead, tick))
                me.line_end = max(place.at, min(place.end, room))
            ahead = number
        model.rears[0, line] = ahead


def ops_before(me: Doing) -> list[int]:
    """Return the last ops that a robot has done. Those to charge follow a part of a job."""
    if me.decided == c.NONE:
        return [*range(max(me.first, me.op - LOOKED_BACK), me.op)]
    in_job = range(max(me.job_first, me.decided - LOOKED_BACK), me.decided)
    return [*in_job, *range(me.first, me.op)]
