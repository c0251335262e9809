"""Translates plans of robots into ops: step by step, and parts that come again at once.

`orchard.event_model.program` has the plans of an orchard. Steps that take no time and change
nothing for others give no op. Durations stay in the step classes, and rules where they are.
"""

from copy import copy
from functools import singledispatchmethod
from math import floor
from typing import Any

from orchard.event_model import codes as c
from orchard.event_model import program_columns
from orchard.event_model.draws import has_failures
from orchard.event_model.repeated_parts import (
    PartBeginning,
    PlanPart,
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
    quarter_turn,
    seen,
    sign_of,
    unloads_from,
)
from orchard.field.geometry import Pose
from orchard.field.layout import Layout
from orchard.field.queue import BESIDE
from orchard.field.ticks import whole_ticks
from orchard.plans import steps as st
from orchard.plans.forecast import ALONG, until_full
from orchard.plans.robot import Gate, Step
from orchard.plans.route import OneWay
from orchard.plans.routes import ROUTES

# How many places and lines a program may have. The arrays are as large, so the first three figures
# are chosen with room to spare. Those beside the lanes: corners, lines of the queue, roads.
BESIDE_LANES = 128
# A lane has a place of each of two roads, on each of its two sides.
PLACES_PER_LANE = 4
LINES_PER_LANE = 12
# A route of the user's own may have so many times as many.
OWN_SHARE = 8


class PlanTranslator:
    """The ops of the plans that it was given, with their places and lines."""

    def __init__(self, layout: Layout, route: OneWay) -> None:
        self.layout = layout
        self.route = route
        self.ops = Table(program_columns.OP)
        self.needs = Table(program_columns.GATE)
        self.frees = Table(program_columns.GATE)
        # Of each op the step, for a trace; None at the end of a plan.
        self.steps: list[Step | None] = []
        # The first op of a plan -> of each of its steps the op at which it, or what follows it,
        # begins, and last the op that ends the plan.
        self.begins: dict[int, list[int]] = {}
        self._parts: dict[PartBeginning | None, PlanPart] = {}
        share = 1
        if layout.scenario.route not in ROUTES:
            share = OWN_SHARE
        lanes = len(layout.lanes)
        self.places = PlaceLists(share * (PLACES_PER_LANE * lanes + BESIDE_LANES))
        self.lines = Lines(share * (LINES_PER_LANE * lanes + BESIDE_LANES))
        # y of the lines of the queue that are in use, m.
        self.queue_lines = layout.queue.used(layout.queue_places)
        # Of the failures on a route of the user's own; None: that of the scenario.
        self.own_failure_seed: int | None = None

    def copy_for(self, layout: Layout, route: OneWay) -> "PlanTranslator":
        """Return a translator that goes on from these plans, which are the same in a layout."""
        translator = copy(self)
        translator.layout = layout
        translator.route = route
        translator.queue_lines = layout.queue.used(layout.queue_places)
        translator.ops = self.ops.copy()
        translator.needs = self.needs.copy()
        translator.frees = self.frees.copy()
        translator.steps = list(self.steps)
        translator.begins = dict(self.begins)
        translator.places = self.places.copy()
        translator.lines = self.lines.copy()
        # Only pickers have parts that come again.
        translator._parts = {}
        return translator

    def translate(self, writer: Writer) -> int:
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
            plan = Writer(list(instead), pose, writer.machine)
            self.ops.array[decides].arg = self.translate(plan)
        return first

    def _translate_part(
        self, writer: Writer, steps: list[Step], end: int, begins: list[int]
    ) -> PlanPart:
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
        return PlanPart(
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

    def _copy_part(self, part: PlanPart, writer: Writer, begins: list[int]) -> None:
        """Do what `_translate_part` would do, if it has translated the same part before."""
        # By how many ops the copy is later than the part.
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
            swings = floor(st.Face.swings * ticks)
            self._append(step, c.TURN, ticks=ticks, swings=swings, **quarter_turn(step, writer))

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
            if self.own_failure_seed not in (None, step.seed):
                raise NotImplementedError("the event model knows one seed of failures")
            self.own_failure_seed = step.seed
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
