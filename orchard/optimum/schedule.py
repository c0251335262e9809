"""The schedule of a harvest's jobs that ends first, and a proof that no schedule ends before a
certain time, by the solver CP-SAT.

A job is one exchange of bins: a carrier brings an empty bin to a lane, where it stops, takes the
full one to the bay, and drives back to the queue (`TimedJob`). All times in the model are in ticks
of 0.1 s. `orchard bound` and the summary of a run ask for the proof.

Why no dispatch policy can be faster than what is proven: each constraint here is one that the
simulator enforces too, and all its other rules are left out, so that the model allows more.

- A picker goes on with its next row only once it has an empty bin. A carrier gets the lane's place
  only once the picker has left it. A picker that is away meanwhile leaves it later: of that the
  model has what follows if no picker ever waits for a carrier.
- A job takes its carrier at least what its plan takes on free roads, and no more jobs are done at a
  time than there are carriers.
- A harvest ends when the last carrier stands in the queue, behind the others of its line.
- With traffic: a place on the roads belongs to one robot, from its gate there until it has left the
  place and the next one has heard so. The bay unloads one bin at a time, or as many as it has
  places; the carrier that comes for the next one is then at least `least_headway` behind.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ortools.sat.python.cp_model import (
    INFEASIBLE,
    OPTIMAL,
    CpModel,
    CpSolver,
    IntervalVar,
    IntVar,
    LinearExprT,
)

from orchard.field.layout import Layout
from orchard.field.scenario import TIME_STEP
from orchard.optimum import NoBound
from orchard.plans.jobs import TimedJob, Use, jobs_of, least_headway, ticks
from orchard.plans.routes import route_of

# How much work the solver may do. It counts its own work ("deterministic time"), so the answer is
# the same on every machine. A unit is about a second, so this is some seconds.
WORK = 10.0
# A search also ends after LEAST_PATIENCE + PATIENCE_FOR_WORK * work seconds of the clock. That is a
# safety net for very slow machines. A busy machine, which needs some seconds for a unit of work,
# must not reach it, because then the answer depends on the machine.
LEAST_PATIENCE = 600.0
PATIENCE_FOR_WORK = 100.0
# Share of the work for the first search, which finds schedules. The rest is for the second one,
# which raises the bound step by step.
FIRST = 0.2
# Parameters of the solver. One worker, because several depend on each other's speed. No linear
# relaxations, because with them the solver proves less here in the same time.
SEARCH = {
    "num_workers": 1,
    "linearization_level": 0,
    "use_overload_checker_in_cumulative": True,
    "use_timetable_edge_finding_in_cumulative": True,
}


@dataclass(frozen=True)
class Optimum:
    """The shortest time of a harvest."""

    #: It is proven that no dispatch policy makes a shorter harvest.
    proven_seconds: float
    #: The length of the best schedule that was found.
    best_seconds: float
    bins: int
    #: The limit of the clock that cut a search short, s; None: all searches did their work.
    cut_after_seconds: float | None = None

    @property
    def gap(self) -> float:
        """How far the best schedule may be from the optimum, as a share of it."""
        return self.best_seconds / self.proven_seconds - 1.0


def optimum(layout: Layout, work: float = WORK, free_roads: bool = False) -> Optimum:
    """Return what is proven of the shortest harvest of an orchard, with exact sensors, without
    people and animals.

    `work`: of the solver, at most; see WORK. `free_roads`: robots share neither roads nor the bay,
    as if no robot were ever in another's way. Raises NoBound for agents and steps of the user's
    own.
    """
    fault = _unknown(layout)
    if fault:
        raise NoBound(fault)
    jobs = jobs_of(layout)
    schedule = Schedule(jobs, layout.scenario.carrier_count)
    least = schedule.least
    cuts = list[float]()
    if not free_roads:
        # With free roads a bound is proven sooner, and it holds with shared roads too.
        alone = optimum(layout, FIRST * work, free_roads=True)
        least = round(alone.proven_seconds / TIME_STEP)
        if alone.cut_after_seconds is not None:
            cuts.append(alone.cut_after_seconds)
        carrier = layout.machines["carrier"]
        headway = ticks(least_headway(carrier) / carrier.speed)
        schedule.share_roads()
        schedule.share_bay(headway, layout.scenario.bays)
        schedule.model.add(schedule.end >= least)
    first = _solved(schedule.model, FIRST * work)
    solvers = [first]
    is_optimal = _has_solution(first) and first.best_objective_bound >= first.objective_value
    if not is_optimal:
        schedule.hint(first)
        solvers.append(_solved(schedule.model, (1.0 - FIRST) * work, use_objective_lb_search=True))
    proven: float = least
    # If no schedule was found: one job after the other.
    best: float = schedule.horizon
    for solver in solvers:
        proven = max(proven, solver.best_objective_bound)
        if _has_solution(solver):
            best = min(best, solver.objective_value)
        limit = _cut_after(solver)
        if limit is not None:
            cuts.append(limit)
    return Optimum(
        proven_seconds=round(proven * TIME_STEP, 1),
        best_seconds=round(best * TIME_STEP, 1),
        bins=len(jobs),
        cut_after_seconds=max(cuts, default=None),
    )


def _has_solution(solver: CpSolver) -> bool:
    """Whether a solver has found a schedule."""
    return bool(solver.response_proto.solution)


def _unknown(layout: Layout) -> str:
    """Say what the bound does not know of an orchard; '' if it knows all of it."""
    scenario = layout.scenario
    route = route_of(layout)
    own = sorted({*scenario.agents, *scenario.agents_without_body})
    if own:
        return f"the bound knows built-in agents only, and not {', '.join(own)}"
    if route.Steps:
        return (
            "the bound does not know the steps of your route:"
            f" {', '.join(step.__name__ for step in route.Steps)}"
        )
    return ""


def _carrier_ticks(job: TimedJob) -> int:
    """Return how long a job takes its carrier, until it stands at the head of the queue, ticks."""
    return job.approach + job.to_bay + job.to_head


def _solved(model: CpModel, work: float, **search: bool) -> CpSolver:
    """Return a solver that has searched. `work`: at most; `search`: parameters beside SEARCH."""
    solver = CpSolver()
    for name, value in (SEARCH | search).items():
        setattr(solver.parameters, name, value)
    solver.parameters.max_deterministic_time = work
    solver.parameters.max_time_in_seconds = LEAST_PATIENCE + PATIENCE_FOR_WORK * work
    solver.solve(model)
    return solver


def _cut_after(solver: CpSolver) -> float | None:
    """Return the limit of the clock that ended a search, s; None if its work or a proof ended it.

    The time that the solver reports does not tell: a search may end a little before its limit.
    """
    parameters = solver.parameters
    response = solver.response_proto
    is_proven = response.status in (OPTIMAL, INFEASIBLE)
    if is_proven or response.deterministic_time >= parameters.max_deterministic_time:
        return None
    return float(parameters.max_time_in_seconds)


class Schedule:
    """The model of the solver: when each job's carrier stops at its lane, and when it stands in the
    bay.

    Jobs are numbered from 0. The jobs of a picker stand together, in the order of its bins.
    """

    def __init__(self, jobs: Sequence[TimedJob], carriers: int) -> None:
        """`carriers`: how many there are."""
        self.jobs = jobs
        self.carriers = carriers
        self.model = CpModel()
        # All variables of the model; see `_time`.
        self.times = list[IntVar]()
        # No schedule need be longer than one in which one job is done after the other, once no
        # picker is away any more.
        self.horizon = sum(job.ready + _carrier_ticks(job) + job.going_on for job in jobs)
        self.horizon += max((job.all_there for job in jobs), default=0)
        # By job: when its carrier stops at its lane, and when it stands in the bay.
        self.stops = [self._time(earliest) for earliest in self._earliest()]
        self.bays = [self._time() for _ in jobs]
        self.end = self._time(self.least)
        for number, job in enumerate(jobs):
            self.model.add(self.stops[number] >= self._went_on(number) + job.ready)
            self.model.add(self.bays[number] >= self.stops[number] + job.to_bay)
            self.model.add(self.end >= self.bays[number] + job.to_rest)
        self._share_carriers()
        self.model.minimize(self.end)

    def _time(self, earliest: int = 0) -> IntVar:
        """Return a new variable of the model: a time from `earliest` to the horizon."""
        self.times.append(self.model.new_int_var(earliest, self.horizon, ""))
        return self.times[-1]

    def hint(self, solver: CpSolver) -> None:
        """Let the next search begin with the schedule that `solver` has found, if any."""
        if solver.response_proto.solution:
            for time in self.times:
                self.model.add_hint(time, solver.value(time))

    def _before(self, number: int) -> int | None:
        """Return the number of the picker's job before a job; None if it is its first one."""
        if number == 0 or self.jobs[number - 1].picker != self.jobs[number].picker:
            return None
        return number - 1

    def _went_on(self, number: int) -> LinearExprT:
        """Return when the picker of a job went on with its next row, after its job before."""
        before = self._before(number)
        if before is None:
            return 0
        return self.stops[before] + self.jobs[before].going_on

    def _earliest(self) -> list[int]:
        """Return the earliest stop of each job, ticks."""
        earliest: list[int] = []
        for number, job in enumerate(self.jobs):
            went_on = 0
            before = self._before(number)
            if before is not None:
                went_on = earliest[before] + self.jobs[before].going_on
            earliest.append(max(job.earliest_stop(went_on), job.approach))
        return earliest

    @property
    def least(self) -> int:
        """A bound on the harvest's end that needs no search: the later one of two.

        The first is the end of the last job if each is done as early as its picker allows. The
        second is the end if no carrier ever waits: carriers begin when the first jobs can begin,
        share the work of all jobs evenly, and stop in the queue.
        """
        begins = []
        ends = []
        for stop, job in zip(self._earliest(), self.jobs, strict=True):
            begins.append(stop - job.approach)
            ends.append(stop + job.to_bay + job.to_rest)
        last = max(ends)
        if len(self.jobs) < self.carriers:
            # Some carriers do no job, so the work is not shared evenly.
            return last
        # The sum over the carriers of the time at which each is done at the earliest.
        busy = sum(sorted(begins)[: self.carriers]) + sum(map(_carrier_ticks, self.jobs))
        # Rounded up. The last job of a carrier may end before the head of the queue, behind others.
        mean_end = -(-busy // self.carriers)
        end_of_all = mean_end - max(job.to_head - job.to_rest for job in self.jobs)
        return max(last, end_of_all)

    def _share_carriers(self) -> None:
        """Let no more jobs be done at a time than there are carriers."""
        intervals = []
        for stop, job in zip(self.stops, self.jobs, strict=True):
            begin = stop - job.approach
            intervals.append(self.model.new_fixed_size_interval_var(begin, _carrier_ticks(job), ""))
        self.model.add_cumulative(intervals, [1] * len(intervals), self.carriers)

    def share_roads(self) -> None:
        """Let each place of the roads belong to one robot at a time."""
        # Place -> the times in which a robot has it.
        occupied: dict[str, list[IntervalVar]] = {}
        for number, job in enumerate(self.jobs):
            for uses, begins in (
                (job.crossings, self._went_on(number) + job.ready),
                (job.way, job.approach),
            ):
                times = [self._time() for _ in uses]
                for at, use in zip(times, uses, strict=True):
                    self._place_in_order(number, at, use, begins)
                    occupied.setdefault(use.place, []).append(
                        self.model.new_fixed_size_interval_var(at, use.ticks, "")
                    )
                for at, use, later, after in zip(times, uses, times[1:], uses[1:], strict=False):
                    self.model.add(later >= at + ticks(after.at - use.at))
        for place in occupied.values():
            self.model.add_no_overlap(place)

    def share_bay(self, headway: int, bays: int) -> None:
        """Let the bay unload no more than so many bins at a time.

        A carrier that unloads on a place further back counts as if it came to the first place.
        `headway`: ticks from a carrier that leaves the bay to the next one there. `bays`: how many
        bins can be unloaded together.
        """
        occupied = []
        for bay, job in zip(self.bays, self.jobs, strict=True):
            occupied.append(self.model.new_fixed_size_interval_var(bay, job.in_bay + headway, ""))
        if bays == 1:
            self.model.add_no_overlap(occupied)
        else:
            self.model.add_cumulative(occupied, [1] * len(occupied), bays)

    def _place_in_order(self, number: int, at: IntVar, use: Use, begins: Any) -> None:
        """Tie the begin of a use to the stop and the bay of its job.

        `number`: of the job. `at`: the variable for when the use begins. `begins`: the earliest
        stop, in ticks. `use.at` counts from the stop, and is negative before it.
        """
        stop = self.stops[number]
        self.model.add(at >= begins + ticks(use.at))
        if use.at <= 0.0:
            self.model.add(stop >= at + ticks(-use.at))
        else:
            self.model.add(at >= stop + ticks(use.at))
            # One tick less, because `ticks` rounds down.
            self.model.add(self.bays[number] >= at + self.jobs[number].to_bay - ticks(use.at) - 1)
