"""A whole harvest in the event model: how it goes on, and what came of it.

`orchard.discrete` is the door to it for other packages. The class holds the arrays of a harvest,
lets the machine carry them on, and does what the machine stops for: see "why the machine stopped"
in codes.py.
"""

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property
from math import inf
from statistics import fmean
from typing import Any

import numpy as np

from orchard.dispatch.policy import Assignment
from orchard.event_model import codes as c
from orchard.event_model import columns
from orchard.event_model.draws import FIRST, draws, more_draws
from orchard.event_model.kernel.drives import FAR
from orchard.event_model.kernel.entry import addressed, run, with_arrays
from orchard.event_model.known import refuse_unknown
from orchard.event_model.picker_plans import SIDES
from orchard.event_model.policies import AskedPolicy, PolicyQuestion, PolicyQuestions
from orchard.event_model.results import JAM, LONGEST, Exchange
from orchard.event_model.start import STATE, prepare
from orchard.field.kinds import kind_of
from orchard.field.layout import Layout
from orchard.field.scenario import TIME_STEP

# Carries a harvest on to a time, exclusive, and returns why it stopped.
CarryOn = Callable[[columns.Model, int], int]
# Rows of a log before it grows.
LOG_ROWS = 4096


class EventHarvest:
    """One harvest. `run` does it; then `seconds` and `delivered` tell how it went."""

    def __init__(
        self,
        layout: Layout,
        is_logged: bool = False,
        free_roads: bool = False,
        carry_on: CarryOn = run,
    ) -> None:
        """`is_logged`: note what each robot does when, for a trace. `free_roads`: no robot is in
        another's way. `carry_on`: the machine, compiled or as plain Python.

        Raises ValueError for what the model does not know: see `refuse_unknown`;
        NotImplementedError for a step that it does not know.
        """
        refuse_unknown(layout.scenario)
        prepared = prepare(layout)
        self.layout = layout
        self._carry_on = carry_on
        self.program = prepared.program
        self.names = prepared.names
        self.bin_names = prepared.bin_names
        own = {name: getattr(prepared.model, name).copy() for name in STATE}
        own["speeds"] = prepared.program.pass_speeds.in_layout(layout)
        self._drawn = dict(FIRST)
        # The layout whose seed decides which people and animals robots meet.
        self._met_in = layout
        own |= self._draws()
        own["robots"].clear = FAR
        if own["encounters"].size:
            own["robots"].clear = own["encounters"][:, 0].metres
        if free_roads:
            own["robots"].roads = np.arange(len(self.names))
            own["rears"] = np.repeat(own["rears"], len(self.names), axis=0)
        if is_logged:
            own["log"] = np.zeros(LOG_ROWS, columns.LOG).view(np.recarray)
        # The size that the program had when the model took over its arrays.
        self._taken = prepared.program.size
        own |= prepared.program.arrays()
        self._model = with_arrays(prepared.model, own)
        # The tick up to which `run` has carried it on.
        self._until = 0
        # The bins that were delivered before it began, if it goes on from a run.
        self.delivered_before = 0
        # The time at which the exchanges were last read, and the exchanges: reading takes long.
        self._exchanged: tuple[int, dict[str, list[Exchange]]] = (c.NONE, {})
        self._policy: AskedPolicy | None = None
        if self.model.desk[0].policy == c.IN_PYTHON:
            self._policy = AskedPolicy(layout)
            self._ask_python(self._policy.is_early)
            if self._policy.decides_when_due:
                self.model.desk.policy = c.IN_PYTHON_WHEN_DUE

    @classmethod
    def paused(cls, layout: Layout, is_early: bool) -> "EventHarvest":
        """Return a harvest that `advance` carries on to each decision. The caller decides.

        `is_early`: whether bins report before they are full. Raises as the class does.
        """
        harvest = cls(layout)
        harvest._policy = None
        harvest._ask_python(is_early)
        return harvest

    def _ask_python(self, is_early: bool) -> None:
        """Stop at each decision."""
        self.model.desk.policy = c.IN_PYTHON_EARLY if is_early else c.IN_PYTHON

    def __getstate__(self) -> dict[str, Any]:
        """Return all but the addresses of the arrays, which are those of this process."""
        state = {name: value for name, value in vars(self).items() if name != "_decisions"}
        return state | {"_model": self._model._replace(addresses=None)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Be a harvest that goes on from a state."""
        vars(self).update(state)
        self._model = addressed(self._model)

    def __deepcopy__(self, memo: dict[int, Any]) -> "EventHarvest":
        """Return a harvest that goes on from here by itself. Both share the program."""
        twin = copy(self)
        own = {name: getattr(self.model, name).copy() for name in (*STATE, "log")}
        twin._model = with_arrays(self.model, own)
        twin._policy = copy(self._policy)
        return twin

    def goes_on_from(self, tick: int) -> None:
        """Note that the state of a run at a tick was filled in."""
        self._until = tick
        self.delivered_before = self.delivered
        most = int(self.model.robots.failures.max())
        while self.model.failures.shape[1] and self.model.failures.shape[1] <= most:
            self._draw_more()

    def meet_as_with(self, seed: int) -> None:
        """Let robots meet people and animals from now on as a run with another seed does."""
        scenario = self.layout.scenario.model_copy(update={"seed": seed})
        self._met_in = replace(self.layout, scenario=scenario)
        self._model = with_arrays(self.model, self._draws())
        if self.model.encounters.size:
            robots = self.model.robots
            robots.clear = self.model.encounters[:, 0].metres
            robots.meeting = robots.here + robots.clear

    @property
    def asked_policy(self) -> AskedPolicy | None:
        """The policy in Python that is asked; None if it is compiled."""
        return self._policy

    @property
    def model(self) -> columns.Model:
        """The arrays. Those of the state are changed in place, and are never others."""
        return self._model

    @cached_property
    def _decisions(self) -> PolicyQuestions:
        """The decisions of this harvest. They look at arrays of the state."""
        return PolicyQuestions(self.model, self.names, self.bin_names)

    def spread_charges(self) -> None:
        """Let carriers begin with batteries charged differently, as they are after some days, and
        not all full.
        """
        carriers = [number for number, name in enumerate(self.names) if kind_of(name) == "carrier"]
        scenario = self.layout.scenario
        reserve = scenario.carrying.battery.reserve
        for number, carrier in enumerate(carriers):
            self.model.robots[carrier].charge = 1.0 - (1.0 - reserve) * number / len(carriers)

    # -- the harvest

    def run(self, goes_on: Callable[[], bool] = lambda: True) -> "EventHarvest":
        """Do the whole harvest, or all until robots wait for each other, or it no longer
        `goes_on`.
        """
        # It looks every JAM ticks whether a step was done, or a robot drives.
        before = -1
        longest = LONGEST * self.program.bins
        while goes_on() and self._until < longest and (self.done > before or self.drives):
            before = self.done
            self._until = min(longest, self._until + JAM)
            if self.advance(self._until) == c.ENDED:
                break
        return self

    @property
    def now(self) -> float:
        """The time of the last event, in ticks."""
        return float(self.model.desk[0].now) / c.QUARTERS

    @property
    def decision(self) -> PolicyQuestion:
        """The decision at which `advance` has stopped."""
        return self._decisions.read()

    def decide(self, decision: PolicyQuestion, orders: Sequence[Assignment]) -> None:
        """Make the decision at which `advance` has stopped."""
        self._decisions.note(decision, orders)

    def advance(self, until: int) -> int:
        """Carry the harvest on to a tick, exclusive. Return why it stopped: see `codes.PAUSED`.

        It translates the jobs that it lacks, and asks the policy; a harvest that is `paused` stops
        for that. Raises PolicyFault.
        """
        # Another harvest of this program may have made it grow.
        self.take_program()
        while True:
            reason = self._carry_on(self.model, c.QUARTERS * until)
            if reason == c.LACKS_JOB:
                desk = self.model.desk[0]
                self.program.translate_job(int(desk.missing_line), int(desk.missing_end))
                self.take_program()
            elif reason == c.LACKS_DRAWS:
                self._draw_more()
            elif reason == c.ASKS_POLICY and self._policy is not None:
                decision = self.decision
                if self._policy.decides_when_due:
                    self._policy.memory.full.update(self._decisions.full())
                orders = self._policy.orders(decision.now, decision.bins, decision.carriers)
                self.decide(decision, orders)
            elif reason == c.ASKS_WAYS:
                self._tell_ways()
            elif reason == c.LOG_IS_FULL:
                longer = np.concatenate([self.model.log, np.zeros_like(self.model.log)])
                self._model = with_arrays(self.model, {"log": longer.view(np.recarray)})
            else:
                return reason

    def _draw_more(self) -> None:
        """Draw more of what happens at random."""
        self._drawn = more_draws(self._drawn, self.model.robots)
        self._model = with_arrays(self.model, self._draws())
        self.model.desk.lacks_draws = False

    def _draws(self) -> dict[str, np.ndarray]:
        """Return what happens at random."""
        seed = self.program.failure_seed(self.layout.scenario)
        return draws(self._met_in, self.names, self._drawn, seed)

    def _tell_ways(self) -> None:
        """Tell how far free carriers are from the bins that call, as the route measures it."""
        route = self.program.route
        ends = {int(call.end) for call in self.model.calls if call.bin != c.NONE}
        for carrier in np.flatnonzero(self.model.robots.is_free):
            robot = self.model.robots[carrier]
            for end in ends:
                lane, side = divmod(end, 2)
                metres = route.distance(
                    float(robot.x_at_call), float(robot.y), lane + 1, route.sides[SIDES[side]]
                )
                self.model.distances[carrier, end] = metres
        self.model.desk.knows_ways = True

    def take_program(self) -> None:
        """Take over the arrays of the program, if it has grown since they were last taken over."""
        # To take them over takes ten times as long as most events between two decisions.
        size = self.program.size
        if size != self._taken:
            self._model = with_arrays(self.model, self.program.arrays())
            self._taken = size

    # -- what came of it

    @property
    def drives(self) -> bool:
        """Whether a robot is on its way, charges, is at the load-out, or waits in the bay until
        that takes its bin: the harvest goes on.
        """
        robots = self.model.robots
        is_any_away = np.any(c.QUARTERS * robots.back >= self.model.desk[0].now)
        is_any_away |= np.any(c.QUARTERS * self.model.trailers.back >= self.model.desk[0].now)
        is_any_away |= np.any((robots.state == c.DRIVING) | (robots.state == c.LASTING))
        return bool(robots.is_charging.any() or is_any_away)

    @property
    def done(self) -> int:
        """The steps that all robots have done."""
        robots = self.model.robots
        return int(robots.done.sum())

    @property
    def bins(self) -> int:
        """The bins that are filled."""
        return self.program.bins

    @property
    def delivered(self) -> int:
        """The bins that were unloaded."""
        return int(self.model.desk[0].deliveries)

    @property
    def deliveries(self) -> list[float]:
        """When each bin was unloaded, s; of a harvest that goes on from a run, since then."""
        ticks = self.model.deliveries[self.delivered_before : self.delivered]
        seconds: list[float] = (ticks * TIME_STEP).tolist()
        return seconds

    @property
    def is_over(self) -> bool:
        """Whether all bins were delivered, and no battery is flat; if not, robots wait for each
        other.
        """
        return self.delivered == self.bins and not self.flat

    @property
    def seconds(self) -> float:
        """The length of the harvest, s."""
        robots = self.model.robots
        stand = np.minimum(robots.stood, robots.parked)
        last = float(max(stand.max(), robots.back.max())) * TIME_STEP
        return max(last, self.trailers_back)

    @property
    def trailers_back(self) -> float:
        """The time at which the last trailer is back from the load-out, s; 0 without trailers."""
        return float(max([0, *self.model.trailers.back.tolist()])) * TIME_STEP

    @property
    def flat(self) -> list[str]:
        """The carriers whose batteries are flat."""
        return [self.names[robot] for robot in np.flatnonzero(self.model.robots.charge <= 0.0)]

    @property
    def stood(self) -> dict[str, float]:
        """The time since which each robot stands, s, and is back from the load-out."""
        robots = self.model.robots
        ticks = np.maximum(robots.stood, robots.back).tolist()
        return {name: tick * TIME_STEP for name, tick in zip(self.names, ticks, strict=True)}

    def share_done(self, picker: str) -> float:
        """Return which share of its plan a picker has begun, 0 to 1."""
        first, end = self.program.harvests[picker], self.program.harvest_ends[picker]
        op = int(self.model.robots["op"][self.names.index(picker)])
        return max(0, op - first) / (end - first)

    def exchange_counts(self, since: float = 0.0) -> dict[str, int]:
        """Return how many empty bins each picker got for full ones, from a time on, s."""
        rows = self._exchanges()
        pickers = rows["picker"][rows["tick"] * TIME_STEP >= since]
        counts = np.bincount(pickers, minlength=len(self.names)).tolist()
        return {name: counts[self.names.index(name)] for name in self.layout.blocks}

    @property
    def exchanges(self) -> dict[str, list[Exchange]]:
        """Of each picker, in the order in which it got empty bins for full ones."""
        now = int(self.model.desk[0].now)
        if self._exchanged[0] != now:
            self._exchanged = (now, self._read_exchanges())
        return self._exchanged[1]

    def _read_exchanges(self) -> dict[str, list[Exchange]]:
        """Return the exchanges of each picker, from the model."""
        columns = ["tick", "picker", "carrier_ticks", "battery_used"]
        rows = self._exchanges()[columns].tolist()
        exchanges: dict[str, list[Exchange]] = {name: [] for name in self.layout.blocks}
        for tick, picker, carrier_ticks, battery_used in rows:
            busy = carrier_ticks if carrier_ticks > 0.0 else None
            exchanges[self.names[picker]].append(Exchange(tick, busy, battery_used))
        return exchanges

    @property
    def waited_seconds(self) -> float:
        """The time for which all pickers together have had no bin to fill so far, s, drives
        included.
        """
        now = self.model.desk[0].now / c.QUARTERS
        since = self.model.robots["full_since"]
        still = np.maximum(0.0, now - since[since != c.NONE])
        return float(self._exchanges()["without"].sum() + still.sum()) * TIME_STEP

    def picker_waiting_seconds(self, since: float = 0.0, until: float = inf) -> float:
        """Return the mean time for which pickers stood until they got empty bins, s; 0 if they got
        none.

        Of bins that they got between two times. The drive to the place where they stand is no wait.
        """
        waits = [
            int(exchange.stood)
            for exchange in self._exchanges()
            if since <= exchange.tick * TIME_STEP <= until
        ]
        return fmean(waits) * TIME_STEP if waits else 0.0

    def carrier_utilisation(self, since: float = 0.0, until: float | None = None) -> float:
        """Return the share of the time for which a carrier is outside the queue, 0 to 1, as the
        mean.
        """
        end = self.seconds if until is None else until
        trips = [(trip.since, trip.until) for trip in self._trips()]
        carriers = 0
        for name, robot in zip(self.names, self.model.robots, strict=True):
            if kind_of(name) == "carrier":
                carriers += 1
                if not robot.is_free:
                    trips.append((robot.away, inf))
        busy = 0.0
        for left, came in trips:
            busy += max(0.0, min(end, came * TIME_STEP) - max(since, left * TIME_STEP))
        return busy / ((end - since) * carriers)

    def _exchanges(self) -> Any:
        """Return the rows of the exchanges so far."""
        return self.model.exchanges[: self.model.desk[0].exchanges]

    def _trips(self) -> Any:
        """Return the rows of the carriers' trips so far."""
        return self.model.trips[: self.model.desk[0].trips]
