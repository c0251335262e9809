"""Programs: the step lists that robots follow, translated into ops.

An op is a row of an array, see `program_columns.OP`. Steps that take no time and change nothing for
others give no op. Durations stay in the step classes, and rules where they are. A program belongs
to a geometry: orchards that differ only in the speeds of their rows share one. A job is translated
when it is first ordered.
"""

from functools import singledispatchmethod
from math import floor
from threading import RLock
from typing import Any

import numpy as np

from orchard.event_model import codes as c
from orchard.event_model import program_columns
from orchard.event_model.draws import has_failures
from orchard.event_model.pass_speeds import PassSpeeds
from orchard.event_model.repeated_parts import (
    Beginning,
    Part,
    beginning_of,
    end_of_part,
    of_pass,
)
from orchard.event_model.tables import Lines, PlaceLists, Table
from orchard.event_model.writer import (
    INSERTING,
    Writer,
    along,
    failing,
    handling,
    metres_until_picking,
    pace,
    put_by,
    seen,
    sign_of,
    unloads_from,
)
from orchard.field.geometry import Pose
from orchard.field.kinds import number_of
from orchard.field.layout import Layout
from orchard.field.queue import BESIDE
from orchard.field.scenario import TIME_STEP, Scenario
from orchard.field.ticks import whole_ticks
from orchard.plans import steps as st
from orchard.plans.forecast import ALONG, EARLIER, until_full
from orchard.plans.robot import Gate, Step
from orchard.plans.route import OneWay
from orchard.plans.routes import ROUTES, route_of, way_to

# m of rounding.
ROUNDING = 1e-6
# How many places and lines a program may have. The arrays are as large, so the first three figures
# are chosen with room to spare. Those beside the lanes: corners, lines of the queue, roads.
BESIDE_LANES = 128
# A lane has a place of each of two roads, on each of its two sides.
PLACES_PER_LANE = 4
LINES_PER_LANE = 12
# A route of the user's own may have so many times as many.
OWN_SHARE = 8
SIDES = ("east", "west")
# What stands in a job for its picker and its full bin.
THE_PICKER = "the picker"
THE_BIN = "the full bin"


class Program:
    """The ops of one geometry: the whole plan of each picker, and the jobs that were ordered."""

    def __init__(self, layout: Layout) -> None:
        """Translate what does not wait for an order.

        Raises NotImplementedError for a step that the model does not know, and for a route with
        very many places.
        """
        # Harvests in several threads may share a program, which grows.
        self._lock = RLock()
        self.layout = layout
        self._carrier = layout.machines["carrier"]
        self.route: OneWay = route_of(layout)
        lanes = len(layout.lanes)
        self.ops = Table(program_columns.OP)
        self.needs = Table(program_columns.GATE)
        self.frees = Table(program_columns.GATE)
        self.passes = Table(program_columns.PASS)
        self.pass_speeds = PassSpeeds()
        self._parts: dict[Beginning | None, Part] = {}
        # Of each op the step, for a trace; None at the end of a plan.
        self.steps: list[Step | None] = []
        # The first op of a plan -> of each of its steps the op at which it, or what follows it,
        # begins, and last the op that ends the plan.
        self.begins: dict[int, list[int]] = {}
        share = 1
        if layout.scenario.route not in ROUTES:
            share = OWN_SHARE
        self.places = PlaceLists(share * (PLACES_PER_LANE * lanes + BESIDE_LANES))
        self.lines = Lines(share * (LINES_PER_LANE * lanes + BESIDE_LANES))
        # Of the failures on a route of the user's own; None: that of the scenario.
        self._own_failure_seed: int | None = None
        queue = layout.queue
        self.queue_lines = [y for y in queue.used(layout.queue_places)]
        waiting_lines = len(self.queue_lines) - len(layout.charging_lines)
        # The lines of the queue in which carriers charge.
        self.charging_lines = range(waiting_lines, len(self.queue_lines))
        self.jobs = np.full((len(self.queue_lines), 2 * lanes), c.NONE)
        self.ends = np.zeros(2 * lanes, program_columns.LANE_END).view(np.recarray)
        for lane in layout.lanes:
            for side in SIDES:
                metres, seconds = way_to(self.route, lane.number, self.route.sides[side])
                self.ends[self.end_number(lane.number, side)] = (metres, seconds)
        # (lines of the queue, ends of lanes) m by road, from the head of a line. Behind the head
        # the way is longer by the distance from it, unless a route of the user's own measures
        # otherwise.
        self.ways = np.zeros(self.jobs.shape)
        self.has_own_measure = False
        self._measure_ways()
        # s before it is full at which a bin calls, as `forecast.horizon` says.
        self.horizon = float(max(self.ends.seconds)) + EARLIER
        # Bins that all pickers fill.
        self.bins = 0
        # Picker -> the ops at which its plan begins and ends.
        self.harvest_ends: dict[str, int] = {}
        self.harvests = {name: self._translate_harvest(name) for name in layout.blocks}
        # Of each line of the queue, the op at which waiting begins.
        self.waiting = [self._translate_waiting(y) for y in self.queue_lines]

    def _measure_ways(self) -> None:
        """Set the ways from the heads of the queue's lines to all ends of lanes."""
        head = self.layout.queue.head
        for queue_line, end in np.ndindex(self.ways.shape):
            y = self.queue_lines[queue_line]
            metres = self._metres_to(head, y, end)
            self.ways[queue_line, end] = metres
            # A metre behind the head.
            longer = self._metres_to(head - 1.0, y, end) - metres
            if abs(longer - 1.0) > ROUNDING:
                self.has_own_measure = True

    def __getstate__(self) -> dict[str, Any]:
        """Return all but the lock, which is of this process."""
        return {name: value for name, value in vars(self).items() if name != "_lock"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Be a copy, with a lock of its own."""
        vars(self).update(state)
        self._lock = RLock()

    def arrays(self) -> dict[str, np.ndarray]:
        """Return the arrays of the program that grow, as they are now.

        A harvest keeps those that it got until it asks for them again: see `size`.
        """
        with self._lock:
            return {
                "ops": self.ops.array,
                "needs": self.needs.array,
                "frees": self.frees.array,
                "places": self.places.array,
                "lines": self.lines.array,
                "jobs": self.jobs.copy(),
            }

    @property
    def size(self) -> tuple[int, int]:
        """The ops and the lists of places: `arrays` are others only when there are more of them."""
        with self._lock:
            return len(self.ops), len(self.places)

    def end_number(self, row: int, side: str) -> int:
        """Return the number of a lane's end."""
        return 2 * (row - 1) + SIDES.index(side)

    def queue_line(self, carrier: str) -> int:
        """Return the line of the queue in which a carrier waits."""
        y = self.layout.queue.place(number_of(carrier) - 1).y
        return self.queue_lines.index(y)

    def failure_seed(self, scenario: Scenario) -> int | None:
        """Return the seed by which robots fail in a harvest of a scenario; None: none fails."""
        if self._own_failure_seed is not None:
            return self._own_failure_seed
        return scenario.seed if has_failures(scenario) else None

    def translate_job(self, queue_line: int, end: int) -> int:
        """Translate a carrier's job, from a line of the queue to a lane's end.

        Return its first op.
        """
        with self._lock:
            return self._translate_job(queue_line, end)

    def _translate_job(self, queue_line: int, end: int) -> int:
        """Translate a job, while no other thread does."""
        lane, side = divmod(end, 2)
        place = queue_line * self.layout.queue.places
        job = self.route.fetch(
            place + 1, lane + 1, self.route.sides[SIDES[side]], THE_PICKER, THE_BIN
        )
        first = self._translate(Writer(job, self.layout.queue.place(place), self._carrier))
        self.jobs[queue_line, end] = first
        return first

    def translate_all(self) -> None:
        """Translate all jobs. Raises NotImplementedError for a step that the model does not know.

        It takes as long as some harvests.
        """
        for queue_line, line in enumerate(self.jobs):
            for end, first in enumerate(line):
                if first == c.NONE:
                    self.translate_job(queue_line, end)

    def ticks(self, first: int, speeds: np.ndarray) -> float:
        """Return how long the plan that begins at an op lasts on free roads, in ticks.

        `speeds`: m/s at which pickers pick on each pass.
        """
        total = 0.0
        # When the carrier is back from the load-out, whose time passes while it drives on.
        back = 0.0
        for op in self.ops.array[first:]:
            if op.kind == c.END:
                break
            if op.kind == c.HAUL:
                back = total + op.ticks
                continue
            total += op.ticks
            if op.kind == c.DRIVE:
                speed = op.speed or speeds[op.arg]
                total += op.metres / speed / TIME_STEP
        return max(total, back)

    def _metres_to(self, x: float, y: float, end: int) -> float:
        """Return the way by road from a place in the queue to a lane's end, m."""
        lane, side = divmod(end, 2)
        return self.route.distance(x, y, lane + 1, self.route.sides[SIDES[side]])

    # -- plans

    def _translate_harvest(self, picker: str) -> int:
        """Translate the plan of a picker. Return its first op."""
        layout = self.layout
        block = layout.blocks[picker]
        start = next(start.pose for start in layout.starts if start.name == picker)
        passes = []
        fills_on = False
        for drive in layout.passes(block):
            passes.append((len(self.passes), drive))
            self.bins += drive.leaves_bin
            self.pass_speeds.add(picker, drive)
            self.passes.append(
                row=drive.row - 1,
                end=self.end_number(drive.row, drive.end),
                metres=drive.metres,
                is_full=drive.is_full,
                leaves_bin=drive.leaves_bin,
                fills_on=fills_on,
            )
            fills_on = not drive.leaves_bin
        first = self._translate(
            Writer(self.route.harvest(block), start, layout.machines["picker"], passes=passes)
        )
        self.harvest_ends[picker] = len(self.ops) - 1
        return first

    def _translate_waiting(self, y: float) -> int:
        """Translate how a carrier waits in the line of the queue at y, m. Return its first op."""
        head = self.layout.queue.place(0)
        return self._translate(
            Writer(self.route.wait_in_queue(), head._replace(y=y), self._carrier)
        )

    def _translate(self, writer: Writer) -> int:
        """Translate the steps of a plan, and those that may take the place of its rest.

        Return the first op.
        """
        first = len(self.ops)
        begins = self.begins[first] = []
        while writer.number < len(writer.steps):
            end = end_of_part(writer)
            # Together with the step that begins the next part.
            steps = writer.steps[writer.number : end + 1]
            beginning = beginning_of(writer)
            known = self._parts.get(beginning)
            if known is not None and known.steps == steps:
                self._copy_part(known, writer, begins)
                continue
            part = self._translate_part(writer, steps, end, begins)
            if part.is_of_pass and not writer.otherwise:
                self._parts[beginning] = part
        begins.append(len(self.ops))
        self._append(None, c.END)
        for decides, instead, pose in writer.otherwise:
            other = Writer(list(instead), pose, writer.machine)
            self.ops.array[decides].arg = self._translate(other)
        return first

    def _translate_part(
        self, writer: Writer, steps: list[Step], end: int, begins: list[int]
    ) -> Part:
        """Translate the steps of a plan up to the number `end`, and return them as a part.

        `steps`: as the part keeps them. `begins`: the list of the plan, which goes on here.
        """
        first = len(self.ops)
        passes = list(writer.passes)
        number = passes[0][0] if passes else c.NONE
        before = len(begins)
        steps_done = end - writer.number
        left = len(writer.steps) - end
        # Each look-up of a method with many forms costs as much as a short step.
        write = self._write
        while len(writer.steps) - writer.number > left:
            step = writer.steps[writer.number]
            if isinstance(step, INSERTING):
                # What it puts in its place is translated next.
                writer.steps[writer.number : writer.number + 1] = put_by(step, writer.pose)
                continue
            begins.append(len(self.ops))
            write(step, writer)
            writer.pose, _ = step.motion(writer.pose, writer.machine)
            writer.number += 1
        ops = self.ops.plain[first:].copy()
        return Part(
            steps=steps,
            steps_done=steps_done,
            number=number,
            passes_done=len(passes) - len(writer.passes),
            first=first,
            last=len(self.ops),
            ops=ops,
            of_pass=of_pass(ops),
            begins=begins[before:],
            pose=writer.pose,
            state=writer.state,
        )

    def _copy_part(self, part: Part, writer: Writer, begins: list[int]) -> None:
        """Do what `_translate_part` would do, if it has translated the same part before."""
        later = len(self.ops) - part.first
        self.ops.extend(part.with_number(writer.passes[0][0]))
        self.steps += self.steps[part.first : part.last]
        begins += [begin + later for begin in part.begins]
        del writer.passes[: part.passes_done]
        writer.pose = part.pose
        writer.state = part.state
        writer.number += part.steps_done

    # -- steps

    @singledispatchmethod
    def _write(self, step: Step, writer: Writer) -> None:
        """Translate a step."""
        name = type(step).__name__
        raise NotImplementedError(f"the discrete-event model does not know the step {name}")

    @_write.register
    def _(self, step: st.DriveTo, writer: Writer) -> None:
        pose = writer.pose
        end, _ = step.motion(pose, writer.machine)
        sign = sign_of(pose)
        metres = abs(end.x - pose.x) + abs(end.y - pose.y)
        self._begin_row_on_drive(step, writer, metres)
        first_need = len(self.needs)
        for gate in step.needs:
            self._append_gate(self.needs, gate, sign)
        first_free = len(self.frees)
        for gate in sorted(step.frees, key=lambda gate: (sign * gate.at, gate.places)):
            self._append_gate(self.frees, gate, sign)
        self._append(
            step,
            c.DRIVE,
            target=sign * along(step, end),
            metres=metres,
            line=self._line_of(step, pose),
            first_need=first_need,
            last_need=len(self.needs),
            first_free=first_free,
            last_free=len(self.frees),
            is_queueing=step.queueing,
            unloads_from=unloads_from(step, sign),
            picks=writer.state == "picking",
            **pace(step, writer, self.layout),
            **seen(writer, self.layout, self.route),
            **failing(writer),
        )

    @_write.register(st.Face)
    @_write.register(st.Realign)
    def _(self, step: st.Face | st.Realign, writer: Writer) -> None:
        _, seconds = step.motion(writer.pose, writer.machine)
        ticks = whole_ticks(seconds)
        if ticks:
            self._append(step, c.TURN, ticks=ticks, swings=floor(st.Face.swings * ticks))

    @_write.register
    def _(self, step: st.Say, writer: Writer) -> None:
        before = writer.state
        writer.state = step.state
        if step.state == "picking":
            self._append_begin_row(step, writer, 0.0)
        elif before == "picking":
            number, drive = writer.passes[0]
            self._append(step, c.END_ROW, arg=number)
            if not drive.leaves_bin:
                del writer.passes[0]

    @_write.register
    def _(self, step: st.Wait, writer: Writer) -> None:
        self._append(step, c.PAUSE, ticks=whole_ticks(step.seconds))

    @_write.register(st.Announce)
    @_write.register(st.Confirmed)
    def _(self, step: st.Announce | st.Confirmed, writer: Writer) -> None:
        self._append(step, c.PAUSE, ticks=step.ticks(writer.machine))

    @_write.register
    def _(self, step: st.Need, writer: Writer) -> None:
        self._append(
            step,
            c.NEED,
            ticks=step.ticks(writer.machine),
            places=self.places.number_of(step.places),
        )

    @_write.register
    def _(self, step: st.Free, writer: Writer) -> None:
        self._append(step, c.FREE, places=self.places.number_of(step.places))

    @_write.register
    def _(self, step: st.Alone, writer: Writer) -> None:
        self._append(step, c.ALONE_IN, places=self.places.number_of([step.place]))

    @_write.register
    def _(self, step: st.FetchEmpty, writer: Writer) -> None:
        places = self.places.number_of([step.place])
        self._append(
            step,
            c.FETCH_EMPTY,
            ticks=step.ticks(writer.machine),
            **handling(step, writer),
            places=places,
        )

        exchange = step.exchange_ticks(writer.machine)
        if exchange:
            self._append(step, c.PAUSE, ticks=exchange)

    @_write.register
    def _(self, step: st.LeaveBin, writer: Writer) -> None:
        number, _ = writer.passes.pop(0)
        self._append(
            step,
            c.LEAVE_BIN,
            ticks=step.ticks(writer.machine),
            **handling(step, writer),
            arg=number,
        )

    @_write.register
    def _(self, step: st.Deliver, writer: Writer) -> None:
        self._append(step, c.DELIVER, ticks=step.ticks(writer.machine), **handling(step, writer))

    @_write.register
    def _(self, step: st.TakeBin, writer: Writer) -> None:
        self._append(step, c.TAKE_BIN, ticks=step.ticks(writer.machine), **handling(step, writer))

    @_write.register
    def _(self, step: st.Unload, writer: Writer) -> None:
        until_empty = step.ticks_until_empty(writer.machine)
        self._append(step, c.UNLOAD, ticks=until_empty)
        # The carrier does not know at once that its bin is empty.
        self._append(step, c.PAUSE, ticks=step.ticks(writer.machine) - until_empty)

    @_write.register
    def _(self, step: st.Haul, writer: Writer) -> None:
        self._append(step, c.HAUL, ticks=writer.machine.haul_ticks)

    @_write.register
    def _(self, step: st.Home, writer: Writer) -> None:
        self._append(step, c.HOME, arg=self._queue_line_at(writer.pose))

    @_write.register
    def _(self, step: st.MayCharge, writer: Writer) -> None:
        writer.otherwise.append((len(self.ops), step.otherwise, writer.pose))
        self._append(step, c.MAY_CHARGE, reserve=step.reserve)

    @_write.register
    def _(self, step: st.Charge, writer: Writer) -> None:
        self._append(step, c.CHARGE, arg=self._queue_line_at(writer.pose))

    @_write.register
    def _(self, step: st.Charged, writer: Writer) -> None:
        self._append(step, c.CHARGED)

    @_write.register
    def _(self, step: st.MayFail, writer: Writer) -> None:
        scenario = self.layout.scenario
        if step.mean_between and (step.seed != scenario.seed or not has_failures(scenario)):
            if self._own_failure_seed not in (None, step.seed):
                raise NotImplementedError("the event model knows one seed of failures")
            self._own_failure_seed = step.seed
        if not isinstance(writer.steps[writer.number + 1], st.DriveTo):
            raise NotImplementedError("the event model knows failures on drives only")
        writer.may_fail = step

    @_write.register
    def _(self, step: st.BeginPickingAt, writer: Writer) -> None:
        """Drop it: the drives tell where the picker picks."""

    # -- what bins see of their pickers

    def _begin_row_on_drive(self, step: st.DriveTo, writer: Writer, metres: float) -> None:
        """Let a bin see that its picker drives to fruit, perhaps through a part of the row."""
        further = metres_until_picking(step, writer)
        if further is not None:
            self._append_begin_row(step, writer, metres + further)

    def _append_begin_row(self, step: Step, writer: Writer, before: float) -> None:
        """Append what tells a bin when it will be full.

        `before`: m that its picker drives first.
        """
        number, drive = writer.passes[0]
        if not drive.leaves_bin:
            return
        side = self.route.sides[drive.end]
        to_end = abs(self.route.end(drive.row, side) - drive.stop)
        seconds = until_full(self.layout, drive.row, side.name, 0.0, before + to_end)
        self._append(
            step,
            c.BEGIN_ROW,
            metres=before,
            seconds=seconds,
            arg=number,
            tells_on_drive=before + to_end > ALONG,
        )

    def _line_of(self, step: st.DriveTo, pose: Pose) -> int:
        """Return the line along which a drive leads that begins at a pose."""
        if step.x is None:
            return self.lines.number_of(1, pose.x, sign_of(pose))
        return self.lines.number_of(0, pose.y, sign_of(pose))

    # -- rows

    def _append(self, step: Step | None, kind: int, **values: Any) -> None:
        """Append an op. `step`: of which it is made. `values`: of its columns."""
        self.ops.append(kind=kind, **values)
        self.steps.append(step)

    def _append_gate(self, gates: Table, gate: Gate, sign: int) -> None:
        """Append a gate of a drive. `sign`: of the drive's line."""
        places = self.places.number_of(gate.places)
        gates.append(at=sign * gate.at, places=places, after_bin=gate.bin != "")

    def _queue_line_at(self, pose: Pose) -> int:
        """Return the line of the queue in which a robot is; NONE: it is in none."""
        for number, y in enumerate(self.queue_lines):
            if abs(pose.y - y) < BESIDE:
                return number
        return c.NONE
