"""Programs: the step lists that robots follow, translated into ops.

An op is a row of an array, see `program_columns.OP`. A program belongs to a geometry: orchards that
differ only in the speeds of their rows share one. A job is translated when it is first ordered.
"""

from threading import RLock
from typing import Any

import numpy as np

from orchard.event_model import codes as c
from orchard.event_model import program_columns
from orchard.event_model.draws import has_failures
from orchard.event_model.picker_plans import SIDES, end_number, picker_plans
from orchard.event_model.writer import Writer
from orchard.field.kinds import number_of
from orchard.field.layout import Layout
from orchard.field.scenario import TIME_STEP, Scenario
from orchard.plans.forecast import EARLIER
from orchard.plans.route import OneWay
from orchard.plans.routes import route_of, way_to

# m of rounding.
ROUNDING = 1e-6
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
        of_pickers = picker_plans(layout, self.route)
        self._plans = of_pickers.translator
        self.ops = self._plans.ops
        self.needs = self._plans.needs
        self.frees = self._plans.frees
        self.places = self._plans.places
        self.lines = self._plans.lines
        self.steps = self._plans.steps
        self.begins = self._plans.begins
        self.queue_lines = self._plans.queue_lines
        self.passes = of_pickers.passes
        self.pass_speeds = of_pickers.pass_speeds
        # Bins that all pickers fill.
        self.bins = of_pickers.bins
        # Picker -> the ops at which its plan begins and ends.
        self.harvests = of_pickers.first_ops
        self.harvest_ends = of_pickers.last_ops
        waiting_lines = len(self.queue_lines) - len(layout.charging_lines)
        # The lines of the queue in which carriers charge.
        self.charging_lines = range(waiting_lines, len(self.queue_lines))
        self.jobs = np.full((len(self.queue_lines), 2 * lanes), c.NONE)
        self.ends = np.zeros(2 * lanes, program_columns.LANE_END).view(np.recarray)
        for lane in layout.lanes:
            for side in SIDES:
                metres, seconds = way_to(self.route, lane.number, self.route.sides[side])
                self.ends[end_number(lane.number, side)] = (metres, seconds)
        # (lines of the queue, ends of lanes) m by road, from the head of a line. Behind the head
        # the way is longer by the distance from it, unless a route of the user's own measures
        # otherwise.
        self.ways = np.zeros(self.jobs.shape)
        self.has_own_measure = False
        self._measure_ways()
        # s before it is full at which a bin calls, as `forecast.horizon` says.
        self.horizon = float(max(self.ends.seconds)) + EARLIER
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

    def queue_line(self, carrier: str) -> int:
        """Return the line of the queue in which a carrier waits."""
        y = self.layout.queue.place(number_of(carrier) - 1).y
        return self.queue_lines.index(y)

    def failure_seed(self, scenario: Scenario) -> int | None:
        """Return the seed by which robots fail in a harvest of a scenario; None: none fails."""
        if self._plans.own_failure_seed is not None:
            return self._plans.own_failure_seed
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
        first = self._plans.translate(Writer(job, self.layout.queue.place(place), self._carrier))
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

    def _translate_waiting(self, y: float) -> int:
        """Translate how a carrier waits in the line of the queue at y, m. Return its first op."""
        head = self.layout.queue.place(0)
        return self._plans.translate(
            Writer(self.route.wait_in_queue(), head._replace(y=y), self._carrier)
        )
