"""The search for the cheapest fleet that finishes in time: `orchard study` with a deadline.

A fleet is in time if enough of its harvests are: for a confidence of 95 % 19 of 20 (`Trial`). It is
out as soon as more harvests are late than that allows. A harvest is late by its run, or already by
its limit, the shortest time that it can take without traffic.

The search has two steps. It first runs FIRST harvests of fleets, and chooses the cheapest fleet
that is in time in them. Then it runs this fleet as often as the confidence asks. If the fleet
fails, the first step goes on with the others.

A fleet of which a run fails, as by an error in a policy, is out, and the others go on.

Fleets are run in the order of the least that the first harvests may cost, which follows from their
limits (`orchard.study.fleets`). When this least cost is not below the cost of the best fleet so
far, but for a difference that is worth nothing, all later fleets are too dear. All fleets have the
same seeds.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import Any

from orchard.discrete.harvest import get_ready
from orchard.field.problems import Problem, ScenarioError
from orchard.field.scenario import Scenario
from orchard.study.checking import checked_settings, free_robots
from orchard.study.deadline import Deadline, Trial
from orchard.study.finish_words import SmallerFleet, finish_answer, too_early
from orchard.study.fleets import PICKERS, Fleet, Fleets
from orchard.study.notes import StudyNotes
from orchard.study.options import StudyOptions
from orchard.study.orchard_words import orchard_words
from orchard.study.replications import Replications, go_on
from orchard.study.result import Goal, Row, Standing, StoppedBy, StudyResult
from orchard.study.rows import row_of
from orchard.study.runs import RunRecord, software
from orchard.study.settings import CARRIERS, Setting
from orchard.study.store import Store
from orchard.study.workers import Workers, processes, scheduled

# Harvests of each fleet in the first step of the search. Chosen: few, because many fleets are
# tried.
FIRST = 4
# Harvests of the slightly smaller fleets beside the answer, which only show how much later they
# are.
BESIDE = 2
# s between two partial results.
REPORT_SECONDS = 0.5
# The keys that may vary with a deadline.
OF_FLEETS = (PICKERS, CARRIERS)


def finish_study(
    scenario: Scenario,
    varied: Mapping[str, Sequence[Any]],
    deadline: Deadline,
    options: StudyOptions = StudyOptions(horizon="harvest"),
    *,
    tell: Callable[[StudyResult], None] = lambda partial: None,
    is_stopped: Callable[[], bool] = lambda: False,
) -> StudyResult:
    """Return the cheapest fleet that finishes in time; without prices the one with fewest robots.

    `varied`: pickers, carriers, or both -> their numbers; []: as many as it takes. `tell` and
    `is_stopped` are as in `orchard.study.study.study`. Raises ScenarioError, also if the limit of
    each fleet misses the deadline; StoreError, WorkersError, RunFailed and StoreFailed as `study`
    does.
    """
    problems = finish_problems(scenario, varied, deadline, options)
    if problems:
        raise ScenarioError(problems)
    pickers = list(varied.get(PICKERS, [scenario.pickers]))
    fleets = Fleets(scenario, deadline, pickers, varied.get(CARRIERS))
    if not fleets.fleets:
        raise ScenarioError([Problem(deadline.option, too_early(fleets.fastest(), deadline))])
    if options.model != "full":
        get_ready([scenario])
    started: AbstractContextManager[Workers] = processes(options.workers)
    if options.scheduler:
        started = scheduled(options.scheduler)
    with Store(options.store_file, options.anew) as store, started as workers:
        search = _Search(
            scenario=scenario,
            fleets=fleets,
            options=options,
            store=store,
            workers=workers,
            tell=tell,
            is_stopped=is_stopped,
        )
        return search.run()


def finish_problems(
    scenario: Scenario,
    varied: Mapping[str, Sequence[Any]],
    deadline: Deadline,
    options: StudyOptions,
) -> list[Problem]:
    """Return what is wrong with a question, before any limit is known."""
    problems = _problems_of_deadline(scenario, varied, deadline, options)
    asked = {key: varied[key] for key in OF_FLEETS if varied.get(key)}
    settings, faults = checked_settings(scenario, asked, replace(options, goal=None))
    for key in OF_FLEETS:
        # One problem with prices is enough: the others may follow from it.
        are_prices_wrong = any(fault.path == "prices" for fault in faults)
        if settings and key in varied and not are_prices_wrong:
            faults += free_robots(settings, key)
    return problems + faults


def _problems_of_deadline(
    scenario: Scenario,
    varied: Mapping[str, Sequence[Any]],
    deadline: Deadline,
    options: StudyOptions,
) -> list[Problem]:
    """Return what cannot be asked together with a deadline."""
    problems = []
    others = [key for key in varied if key not in OF_FLEETS]
    if others:
        text = f"with a deadline only pickers and carriers vary, and not {', '.join(others)}"
        problems.append(Problem(deadline.option, text))
    if deadline.days is not None and not scenario.shift.is_set:
        text = "days need a shift: set shift.begin and shift.end, or use --finish-within"
        problems.append(Problem(deadline.option, text, "shift"))
    if options.goal is not None:
        text = "with a deadline the cheapest fleet is the answer; leave --goal out"
        problems.append(Problem(f"--goal {options.goal}", text))
    return problems


@dataclass
class _Tried:
    """A fleet that has runs, or gets some now."""

    fleet: Fleet
    #: Of its setting among the replications of the search, from 0.
    number: int
    #: Whether too many harvests are late, or one jammed or failed.
    is_out: bool = False


@dataclass
class _Search:
    """The search, and what is known so far. `answer`: the best fleet so far, or None."""

    scenario: Scenario
    fleets: Fleets
    options: StudyOptions
    store: Store
    workers: Workers
    tell: Callable[[StudyResult], None]
    is_stopped: Callable[[], bool]
    tried: list[_Tried] = field(default_factory=list)
    answer: _Tried | None = None
    stopped_by: StoppedBy = "budget"
    notes: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        # s by the clock of the machine: the begin, the last partial result, the end of the budget.
        self.begun = time.time()
        self.reported_at = 0.0
        self.until = self.begun + self.options.budget_seconds
        self.trial = Trial.of(self.options.confidence)
        self.model = self.options.first_model
        self.settings: list[Setting] = []
        self.goal: Goal = "harvest_seconds"
        if self.scenario.prices.are_set:
            self.goal = "cost_per_bin"
        self.runs = Replications(
            self.settings,
            self.goal,
            "harvest",
            self.store,
            self.workers,
            heard=self._report,
            is_stopped=self.is_stopped,
            failed=go_on,
        )

    def run(self) -> StudyResult:
        """Do all that the budget allows, and return the answer."""
        is_whole = self._search()
        self.runs.raise_if_all_failed(self.model)
        if is_whole and self.answer is not None:
            is_whole = self._run_beside(self.answer)
        if is_whole:
            self.stopped_by = "certain"
        elif self.runs.is_stopped():
            self.stopped_by = "stopped"
        else:
            self.notes.append("there was no time for all fleets that may be in time: --budget")
        return self._result()

    # -- the search

    def _search(self) -> bool:
        """Find the answer: both steps of the search. Return whether the budget sufficed."""
        candidates = self._candidates()
        has_time = self._choose(candidates)
        while has_time and self.answer is not None:
            has_time = self._try(self.answer, self.trial.replications)
            if not self.answer.is_out:
                break
            # The fleet was in time in the first harvests only.
            self.answer = None
            has_time = self._choose(candidates)
        return has_time

    def _candidates(self) -> list[Fleet]:
        """Return the fleets that may be in time by their limits, by the least that they may cost.

        If there is none, return the fastest fleet: its runs show the user how late it is.
        """
        candidates = []
        for fleet in self.fleets.fleets:
            if self._late_by_limits(fleet) <= self.trial.late:
                candidates.append(fleet)
        if not candidates:
            return [self.fleets.fastest()]
        return sorted(candidates, key=self._least_cost)

    def _least_cost(self, fleet: Fleet) -> float:
        """Return the least that the FIRST harvests of a fleet may cost, as the mean."""
        return self.fleets.least_mean_cost(fleet, FIRST)

    def _choose(self, candidates: Sequence[Fleet]) -> bool:
        """Do the first step: set `answer` to the cheapest fleet that is in time in FIRST harvests.

        It stays None if there is no such fleet. Return whether the budget sufficed.
        """
        for fleet in candidates:
            if self._is_too_dear(fleet):
                break
            if not self._may_be(fleet):
                continue
            tried = self._tried(fleet)
            if not self._try(tried, FIRST):
                return False
            if not tried.is_out:
                self.answer = self._cheaper(tried)
        return True

    def _is_too_dear(self, fleet: Fleet) -> bool:
        """Whether the least cost of a fleet is not below the cost of the answer, but for a
        difference that is worth nothing.
        """
        if self.answer is None:
            return False
        cost = self._cost(self.answer, FIRST)
        if self.scenario.prices.are_set:
            cost *= 1.0 - self.options.within
        return self._least_cost(fleet) >= cost

    def _may_be(self, fleet: Fleet) -> bool:
        """Whether a fleet may be in time.

        It is not if it is out, or if the same pickers with more carriers were late in all harvests.
        """
        for tried in self.tried:
            if tried.fleet is fleet:
                return not tried.is_out
            is_larger = (
                tried.fleet.pickers == fleet.pickers and tried.fleet.carriers >= fleet.carriers
            )
            is_late = tried.is_out and not self._has_failed(tried)
            if is_larger and is_late and self._in_time(tried) == 0:
                return False
        return True

    def _tried(self, fleet: Fleet) -> _Tried:
        """Return a fleet among those that run. It is added if it is new."""
        for tried in self.tried:
            if tried.fleet is fleet:
                return tried
        self.settings.append(fleet.setting)
        tried = _Tried(fleet, len(self.settings) - 1)
        self.tried.append(tried)
        return tried

    def _try(self, tried: _Tried, count: int) -> bool:
        """Run harvests of a fleet until there are `count`, or the fleet is out. Return whether the
        budget sufficed.

        At least two run at a time: for most confidences the second late harvest puts a fleet out.
        """
        step = max(2, self.workers.count)
        done = 0
        while done < count and not tried.is_out:
            done = min(count, done + step)
            if not self.runs.do([tried.number], self.model, done, self.until):
                return False
            tried.is_out = self._is_out(tried)
            if not tried.fleet.setting.is_random:
                # All harvests are the same.
                break
        return True

    def _run_beside(self, answer: _Tried) -> bool:
        """Run the slightly smaller fleets a few times. Return whether the budget sufficed."""
        for fleet in self.beside(answer):
            tried = self._tried(fleet)
            if not self.runs.do([tried.number], self.model, BESIDE, self.until):
                return False
            tried.is_out = self._is_out(tried) or self._late_by_limits(fleet) > self.trial.late
        return True

    def _late_by_limits(self, fleet: Fleet) -> int:
        """Return how many harvests of a trial must be late, by their limits."""
        return self.fleets.least_late(fleet, self.trial.replications)

    def beside(self, answer: _Tried) -> list[Fleet]:
        """Return the slightly smaller fleets that may be in time by their limits: only these are
        run.
        """
        return [fleet for fleet in self._smaller(answer) if self.fleets.is_possible(fleet)]

    def _smaller(self, answer: _Tried) -> list[Fleet]:
        """Return two fleets, as far as there are such: with the next smaller number of pickers, and
        with one carrier less.
        """
        fleet = answer.fleet
        pickers = 0
        for crew in self.fleets.crews:
            if crew.pickers < fleet.pickers:
                pickers = max(pickers, crew.pickers)
        smaller = []
        if pickers:
            smaller.append(self.fleets.fleet(pickers, fleet.carriers))
        if fleet.carriers > 1 and self.fleets.carriers is not None:
            smaller.append(self.fleets.fleet(fleet.pickers, fleet.carriers - 1))
        return [fleet for fleet in smaller if fleet is not None]

    # -- what the runs tell

    def _records(self, tried: _Tried) -> list[RunRecord]:
        """Return the runs of a fleet, in the order of their seeds."""
        return self.runs.known(tried.number, self.model)

    def _has_failed(self, tried: _Tried) -> bool:
        """Whether a run of a fleet failed, as by an error in a policy."""
        return self.runs.failure(tried.number, self.model) is not None

    def _late(self, tried: _Tried) -> int:
        """Return how many harvests of a fleet were late, or jammed."""
        return len(self._records(tried)) - self._in_time(tried)

    def _in_time(self, tried: _Tried) -> int:
        """Return how many harvests of a fleet met the deadline."""
        most = self.fleets.deadline.seconds(tried.fleet.setting)
        in_time = 0
        for record in self._records(tried):
            in_time += not record.is_jammed and record.sim_seconds <= most
        return in_time

    def _is_out(self, tried: _Tried) -> bool:
        """Whether a harvest jammed or failed, or more were late than the confidence allows."""
        if self._has_failed(tried) or self.runs.has_jammed(tried.number, self.model):
            return True
        if not tried.fleet.setting.is_random:
            # The one run of a fleet without chance stands for all.
            return self._late(tried) > 0
        return self._late(tried) > self.trial.late

    def _cost(self, tried: _Tried, first: int | None = None) -> float:
        """Return what a harvest of a fleet costs, on average; without prices the number of its
        robots.

        `first`: how many harvests count; None: all.
        """
        setting = tried.fleet.setting
        if not self.scenario.prices.are_set:
            return setting.robots
        costs = []
        for record in self._records(tried)[:first]:
            cost = setting.cost_per_bin(record.bins_per_hour, record.counted_bins) or 0.0
            costs.append(cost * record.bins)
        return sum(costs) / len(costs)

    def _cheaper(self, tried: _Tried) -> _Tried:
        """Return the cheaper one of the answer and a fleet that is in time."""
        if self.answer is None or self._cost(tried, FIRST) < self._cost(self.answer, FIRST):
            return tried
        return self.answer

    # -- the result

    def _report(self) -> None:
        """Tell what is known so far, now that a run is over."""
        if time.time() - self.reported_at > REPORT_SECONDS:
            self.tell(self._result())
            self.reported_at = time.time()

    def _result(self) -> StudyResult:
        """Return what is known so far."""
        best = None
        smaller: list[SmallerFleet] = []
        days = None
        # While the search goes on, a run of the fleet may just have failed.
        if self.answer is not None and not self._has_failed(self.answer):
            setting = self.answer.fleet.setting
            best = setting.values
            days = setting.days
            for fleet in self._smaller(self.answer):
                smaller.append(SmallerFleet(fleet, self._late_by_limits(fleet)))
        result = StudyResult(
            answer="",
            orchard=orchard_words(self.scenario, OF_FLEETS),
            best=best,
            table=self._rows(),
            goal=self.goal,
            horizon="harvest",
            confidence=self.options.confidence,
            within=self.options.within,
            scenario=self.scenario.model_dump(),
            varied=self._tried_values(),
            wall_seconds=time.time() - self.begun,
            stopped_by=self.stopped_by,
            undecided=[],
            seconds_needed=None,
            beyond={},
            notes=self._notes(),
            version=software(),
            violations=self.runs.violations,
            failed=self._failed_values(),
            deadline=self.fleets.deadline.words,
            deadline_option=self.fleets.deadline.option,
        )
        return replace(result, answer=finish_answer(result, smaller, self.trial, days))

    def _with_runs(self) -> list[_Tried]:
        """Return the fleets that have runs, of which none failed, in the order of the table."""
        with_runs = []
        for tried in self.tried:
            if self._records(tried) and not self._has_failed(tried):
                with_runs.append(tried)
        return sorted(with_runs, key=attrgetter("fleet.pickers", "fleet.carriers"))

    def _failed_values(self) -> list[dict[str, Any]]:
        """Return the numbers of robots of the fleets of which a run failed."""
        return [self.settings[number].values for number in self.runs.failing(self.model)]

    def _rows(self) -> list[Row]:
        """Return the table: a row for each fleet that has runs."""
        return [self._row(tried) for tried in self._with_runs()]

    def _tried_values(self) -> dict[str, list[Any]]:
        """Return the numbers of robots that have runs, by the key of the scenario."""
        values: dict[str, set[Any]] = {PICKERS: set(), CARRIERS: set()}
        for tried in self._with_runs():
            for key, of_key in values.items():
                of_key.add(tried.fleet.setting.values[key])
        return {key: sorted(of_key) for key, of_key in values.items()}

    def _row(self, tried: _Tried) -> Row:
        """Return the line of a fleet in the table."""
        standing: Standing = "unknown"
        if tried is self.answer:
            standing = "best"
        elif tried.is_out or (self.answer is not None and self._is_dearer(tried)):
            standing = "worse"
        row = row_of(tried.fleet.setting, self._records(tried), self.options.confidence)
        if row.jammed:
            standing = "jammed"
        return replace(row, standing=standing, in_time=self._in_time(tried))

    def _is_dearer(self, tried: _Tried) -> bool:
        """Whether there is an answer, and a fleet costs at least as much."""
        return self.answer is not None and self._cost(tried) >= self._cost(self.answer)

    def _notes(self) -> list[str]:
        """Return what a reader must know beside the table."""
        of_runs = StudyNotes(self.runs, self.model, self.options, {})
        notes = [*self.notes, *of_runs.failed(self.runs.failing(self.model))]
        if self.options.model == "both":
            notes.append("the fast model alone answers; --model full asks the simulator")
        if self.scenario.shift.is_set:
            notes.append(
                "the harvest's time is working time; before a day's end carriers only finish their"
                " jobs and drive home"
            )
        return notes
