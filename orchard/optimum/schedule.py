"""The schedule of a harvest's jobs that ends first, and a proof that none ends before a time, by the solver CP-SAT.

Why no dispatch policy can beat it: each constraint is one that the simulator enforces, and whatever else it enforces is left out.

- A picker goes on with its next row only once it has an empty bin; a carrier gets the lane's place only once the picker has left it.
- A carrier does one job after the other, and each takes at least what its plan takes on free roads.
- Of the jobs of all carriers at most as many are done at a time as there are carriers.
- A bin is unloaded alone, and the next one is then at least `HEADWAY` behind.
"""

from dataclasses import dataclass

from ortools.sat.python.cp_model import CpModel, CpSolver

from orchard.agents.steps import Unload
from orchard.field.layout import Layout
from orchard.field.scenario import TIME_STEP
from orchard.optimum.jobs import Job, jobs_of

HEADWAY = 40  # ticks: 4 m at 1 m/s from a carrier to the next one behind its bin, which is at least 0.7 m before it
LIMIT = 10.0  # of the solver's work, which it counts, so that the answer is the same on every machine: about s
PATIENCE = 10.0  # times the limit, in s, after which a machine that is too slow ends the search
SEARCH = {  # one worker: several would depend on each other's speed. It raises the bound step by step; linear relaxations prove less here
    "num_workers": 1,
    "use_objective_lb_search": True,
    "linearization_level": 0,
    "use_overload_checker_in_cumulative": True,
    "use_timetable_edge_finding_in_cumulative": True,
}


@dataclass(frozen=True)
class Optimum:
    """The shortest time of a harvest."""

    proven_seconds: float  #: no dispatch policy makes a shorter harvest
    best_seconds: float  #: of the best schedule that was found without traffic
    bins: int
    solver_seconds: float  #: of this machine

    @property
    def gap(self) -> float:
        """How far the best schedule may be from the optimum, as a share of it."""
        return self.best_seconds / self.proven_seconds - 1.0


def optimum(layout: Layout, limit: float = LIMIT) -> Optimum:
    """Return what is proven of the shortest harvest of an orchard, with exact sensors. `limit`: of the solver's work.

    Raises NoBound for agents and steps of the user's own.
    """
    jobs = jobs_of(layout)
    solver, schedule = CpSolver(), Schedule(jobs, layout.scenario.carrier_count)
    for name, value in SEARCH.items():
        setattr(solver.parameters, name, value)
    solver.parameters.max_deterministic_time, solver.parameters.max_time_in_seconds = limit, PATIENCE * limit
    solver.solve(schedule.model)
    proven, best = (round(ticks * TIME_STEP, 1) for ticks in (solver.best_objective_bound, solver.objective_value))
    return Optimum(proven, best, len(jobs), solver.wall_time)


class Schedule:
    """The model: when each job's carrier stops at its lane, and when it stands in the bay, in ticks."""

    def __init__(self, jobs: list[Job], carriers: int) -> None:
        self.jobs, self.carriers, self.model = jobs, carriers, CpModel()
        horizon = sum(job.ready + job.approach + job.to_bay + job.to_head + job.going_on for job in jobs)
        self.stops = [self.model.new_int_var(earliest, horizon, "") for earliest in self._earliest()]
        self.bays = [self.model.new_int_var(0, horizon, "") for _ in jobs]
        self.end = self.model.new_int_var(0, horizon, "end")
        self._order_of_pickers()
        self._carriers()
        self._bay()
        self.model.minimize(self.end)

    def _earliest(self) -> list[int]:
        """The earliest stop of each job."""
        earliest: list[int] = []
        for number, job in enumerate(self.jobs):
            before = self._before(number)
            since = 0 if before is None else earliest[before] + self.jobs[before].going_on
            earliest.append(max(since + job.ready, job.approach))
        return earliest

    def _before(self, number: int) -> int | None:
        """The job of the same picker before a job."""
        return number - 1 if number and self.jobs[number - 1].picker == self.jobs[number].picker else None

    def _order_of_pickers(self) -> None:
        for number, job in enumerate(self.jobs):
            if (before := self._before(number)) is not None:
                self.model.add(self.stops[number] >= self.stops[before] + self.jobs[before].going_on + job.ready)
            self.model.add(self.bays[number] >= self.stops[number] + job.to_bay)
            self.model.add(self.end >= self.bays[number] + job.to_rest)

    def _carriers(self) -> None:
        rounds = [job.approach + job.to_bay + job.to_head for job in self.jobs]
        begun = [stop - job.approach for stop, job in zip(self.stops, self.jobs, strict=True)]
        intervals = [self.model.new_fixed_size_interval_var(*one, "") for one in zip(begun, rounds, strict=True)]
        self.model.add_cumulative(intervals, [1] * len(intervals), self.carriers)
        first = sorted(earliest - job.approach for earliest, job in zip(self._earliest(), self.jobs, strict=True))[: self.carriers]
        over = max(job.to_head - job.to_rest for job in self.jobs)
        if len(first) == self.carriers:
            self.model.add(self.carriers * (self.end + over) >= sum(rounds) + sum(first))

    def _bay(self) -> None:
        occupied = [self.model.new_fixed_size_interval_var(bay, Unload.ticks + HEADWAY, "") for bay in self.bays]
        self.model.add_no_overlap(occupied)
