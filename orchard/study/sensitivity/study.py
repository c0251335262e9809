"""The sensitivity of a result: runs at quasi-random points, and the effect of each value.

A factor is a value that is moved. A point has a share for each factor: where its value stands
between the ends of its range, 0 to 1. `orchard.study.sensitivity.surrogate` computes the effects.
"""

import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from orchard.discrete.harvest import get_ready
from orchard.field.problems import Problem, ScenarioError
from orchard.field.scenario import Scenario
from orchard.report.limits import with_seed
from orchard.study.checking import checked_settings
from orchard.study.options import StudyOptions
from orchard.study.orchard_words import orchard_words
from orchard.study.replications import Replications
from orchard.study.result import Goal, Interval, StoppedBy
from orchard.study.runs import RunFailed, RunRecord, software
from orchard.study.sensitivity.factors import MOST_FACTORS, Factor
from orchard.study.sensitivity.result import Effect, SensitivityResult
from orchard.study.sensitivity.surrogate import (
    RUNS_OF_A_POINT,
    Array,
    Shares,
    design,
    points_for,
    shares_of,
)
from orchard.study.sensitivity.words import answer, value_name
from orchard.study.settings import Setting, settings_of
from orchard.study.store import Store
from orchard.study.words import setting_words
from orchard.study.workers import Workers, processes, scheduled

# s between two reports of progress.
REPORT_SECONDS = 0.2
# R2 of a fit at points that it has not seen. Below this a note says that the fit is poor.
GOOD_FIT = 0.9
# From here on the mean results at the ends of the values are shown too: a fit errs most there.
FIT_OF_ENDS = 0.98
NONE = Interval(mean=0.0, low=0.0, high=0.0)
# How many points that jam a note names, and how many faults of points that are left out.
MOST_JAMS_NAMED = 3
MOST_FAULTS_NAMED = 2
# Of so large a share of the points more cannot be left out: the others no longer fill the ranges.
# It was chosen.
MOST_LEFT_OUT = 0.25
# Percent of the runs on each side of the spread that is shown, which has 95 % of them.
TAIL = 2.5


def sensitivity(
    scenario: Scenario,
    factors: Sequence[Factor],
    options: StudyOptions = StudyOptions(),
    tell: Callable[[float], None] = lambda share: None,
    is_stopped: Callable[[], bool] = lambda: False,
) -> SensitivityResult:
    """Move values of a scenario through their ranges, and return what its result depends on.

    `tell` gets the share of the runs that are done. When `is_stopped` returns True, the answer is
    that of the points which are done. The same question has the same answer, whatever the workers
    do.

    Raises as `orchard.study.study.study` does. All points need the same own classes, so the first
    run that fails ends it: RunFailed names the values of its point.
    """
    problems = sensitivity_problems(scenario, factors, options)
    if problems:
        raise ScenarioError(problems)
    points = _points(scenario, factors)
    get_ready([scenario])
    started: AbstractContextManager[Workers] = processes(options.workers)
    if options.scheduler:
        started = scheduled(options.scheduler)
    with Store(options.store_file, options.anew) as store, started as workers:
        asked = _Sensitivity(
            scenario=scenario,
            factors=factors,
            points=points,
            options=options,
            tell=tell,
        )
        return asked.run(store, workers, is_stopped)


def sensitivity_problems(
    scenario: Scenario, factors: Sequence[Factor], options: StudyOptions
) -> list[Problem]:
    """Return what is wrong with a question."""
    problems = []
    if not factors:
        text = "this scenario has none of the values that are moved by default; name some"
        problems.append(Problem("--vary", text))
    if len(factors) > MOST_FACTORS:
        text = f"{len(factors)} values; at most {MOST_FACTORS} can be moved at once"
        problems.append(Problem("--vary", text))
    if options.model == "full":
        text = "a sensitivity needs hundreds of harvests by the fast model; leave out --model"
        return [*problems, Problem("--model full", text)]
    return problems + checked_settings(scenario, {}, options)[1]


@dataclass(frozen=True)
class _Points:
    """The points that are run, with the setting of each."""

    #: In the unit cube, (n, f).
    shares: Array
    settings: list[Setting]
    #: What is wrong with points that are left out, each fault once.
    faults: list[Problem]
    #: How many points there are with those that are left out.
    asked: int


def _points(scenario: Scenario, factors: Sequence[Factor]) -> _Points:
    """Return the points. No two of them have a common seed.

    A point is left out if its values cannot stand together. Raises ScenarioError if one end of a
    range is wrong by itself, or if too many points are left out for a fit of the whole ranges.
    """
    problems = _wrong_ends(scenario, factors)
    if problems:
        raise ScenarioError(problems)
    shares = design(len(factors), points_for(len(factors)), scenario.seed)
    numbers = []
    settings = []
    faults: dict[str, Problem] = {}
    for number, of_point in enumerate(shares):
        seeded = with_seed(scenario, scenario.seed + RUNS_OF_A_POINT * number)
        values = {}
        for factor, share in zip(factors, of_point, strict=True):
            values[factor.key] = factor.value(float(share))
        possible, problems = settings_of(seeded, {key: [value] for key, value in values.items()})
        for setting in possible:
            numbers.append(number)
            settings.append(Setting(values, setting.scenario))
        for problem in problems:
            faults.setdefault(problem.text, problem)
    if len(shares) - len(settings) > MOST_LEFT_OUT * len(shares):
        raise ScenarioError(list(faults.values()))
    return _Points(shares[numbers], settings, list(faults.values()), len(shares))


def _wrong_ends(scenario: Scenario, factors: Sequence[Factor]) -> list[Problem]:
    """Return what is wrong with ends of ranges, if no other value is moved."""
    problems = []
    for factor in factors:
        ends = [factor.value(0.0), factor.value(1.0)]
        problems += settings_of(scenario, {factor.key: ends})[1]
    return problems


@dataclass
class _DonePoints:
    """The points of which all runs are done."""

    #: The shares of each point, (f,).
    shares: list[Sequence[float]] = field(default_factory=list)
    #: The values of the goal in the runs of each point.
    results: list[list[float]] = field(default_factory=list)
    #: The values of points in which a run has jammed. These points are not in the other lists.
    jammed: list[dict[str, Any]] = field(default_factory=list)


@dataclass(kw_only=True)
class _Sensitivity:
    """The runs at all points, and their result."""

    scenario: Scenario
    factors: Sequence[Factor]
    points: _Points
    options: StudyOptions
    tell: Callable[[float], None]

    def __post_init__(self) -> None:
        self.begun = time.time()
        self.told_at = 0.0
        self.done = 0
        usual: Goal = "bins_per_hour"
        if self.scenario.prices.are_set:
            usual = "cost_per_bin"
        self.goal = self.options.goal or usual

    def run(
        self, store: Store, workers: Workers, is_stopped: Callable[[], bool]
    ) -> SensitivityResult:
        """Do all runs that the budget allows, and return the answer."""
        runs = Replications(
            self.points.settings,
            self.goal,
            self.options.horizon,
            store,
            workers,
            heard=self._report,
            is_stopped=is_stopped,
        )
        until = self.begun + self.options.budget_seconds
        try:
            is_whole = runs.do(range(len(self.points.settings)), "fast", RUNS_OF_A_POINT, until)
        except RunFailed:
            ((number, failure),) = runs.failing("fast").items()
            raise RunFailed(f"{self.points.settings[number].words}: {failure}") from None
        stopped_by: StoppedBy = "budget"
        if is_whole:
            stopped_by = "certain"
        elif is_stopped():
            stopped_by = "stopped"
        return self._result(runs, stopped_by)

    def _report(self) -> None:
        """Tell which share of the runs is done."""
        self.done += 1
        if time.time() - self.told_at > REPORT_SECONDS:
            self.tell(self.done / (RUNS_OF_A_POINT * len(self.points.settings)))
            self.told_at = time.time()

    def _value(self, setting: Setting, record: RunRecord) -> float:
        """Return the value of the goal in a run.

        A harvest counts with the rows that its seed has drawn, because this is part of its luck.
        """
        if self.goal == "harvest_seconds":
            return record.sim_seconds
        if self.goal == "cost_per_bin":
            return setting.cost_per_bin(record.bins_per_hour, record.counted_bins) or 0.0
        if self.options.horizon == "harvest":
            return record.bins_per_hour * setting.full_share
        return record.bins_per_hour

    def _result(self, runs: Replications, stopped_by: StoppedBy) -> SensitivityResult:
        """Return the result of the points of which all runs are done."""
        done = self._done_points(runs)
        results = done.results
        shares = None
        values = np.zeros(1)
        if results:
            values = np.concatenate(results)
            shares = shares_of(
                self.factors,
                np.array(done.shares),
                results,
                self.options.confidence,
                self.scenario.seed,
            )
        luck = NONE
        unfitted = NONE
        fit = 0.0
        if shares is not None:
            luck = shares.luck
            unfitted = shares.unfitted
            fit = shares.fit
        mean = float(np.mean(values))
        low, high = np.percentile(values, [TAIL, 100.0 - TAIL])
        result = SensitivityResult(
            answer="",
            orchard=orchard_words(self.scenario, [factor.key for factor in self.factors]),
            goal=self.goal,
            horizon=self.options.horizon,
            within=self.options.within,
            confidence=self.options.confidence,
            effects=self._effects(shares),
            mean=mean,
            spread=Interval(mean=mean, low=float(low), high=float(high)),
            luck=luck,
            unfitted=unfitted,
            fit=fit,
            points=len(results),
            points_asked=self.points.asked,
            runs=sum(map(len, results)),
            jammed=done.jammed,
            stopped_by=stopped_by,
            wall_seconds=time.time() - self.begun,
            scenario=self.scenario.model_dump(),
            version=software(),
        )
        result = replace(result, notes=[*_notes(result), *self._notes_of_points()])
        return replace(result, answer=answer(result))

    def _notes_of_points(self) -> list[str]:
        """Return how many points are left out because their values cannot stand together."""
        left_out = self.points.asked - len(self.points.settings)
        if not left_out:
            return []
        why = "; ".join(map(str, self.points.faults[:MOST_FAULTS_NAMED]))
        count = f"{left_out} of {self.points.asked} points"
        return [f"{count} are left out, because their values cannot stand together: {why}"]

    def _done_points(self, runs: Replications) -> _DonePoints:
        """Return the points of which all runs are done."""
        done = _DonePoints()
        for number, setting in enumerate(self.points.settings):
            records = runs.known(number, "fast")
            if len(records) < setting.seeds_that_differ(RUNS_OF_A_POINT):
                continue
            if runs.has_jammed(number, "fast"):
                done.jammed.append(setting.values)
                continue
            done.shares.append(self.points.shares[number])
            done.results.append([self._value(setting, record) for record in records])
        return done

    def _effects(self, shares: Shares | None) -> list[Effect]:
        """Return the effect of each value, the greatest first."""
        if shares is None:
            return []
        effects = []
        has_ends = shares.fit >= FIT_OF_ENDS
        for number, factor in enumerate(self.factors):
            effect = Effect(
                key=factor.key,
                low=factor.low,
                high=factor.high,
                at_low=None,
                at_high=None,
                first_order=shares.first_order[number],
                total=shares.total[number],
            )
            if has_ends:
                at_low, at_high = map(float, shares.ends[number])
                effect = replace(effect, at_low=at_low, at_high=at_high)
            effects.append(effect)
        return sorted(effects, key=lambda effect: -effect.total.mean)


def _notes(result: SensitivityResult) -> list[str]:
    """Return what a reader must know beside the table."""
    notes = _fit_notes(result)
    small = []
    for effect in result.effects:
        if effect.swing is not None and effect.swing < result.within * abs(result.mean):
            small.append(value_name(effect.key))
    if small:
        words = f"less than {100.0 * result.within:g} % from its low end to its high one"
        notes.append(f"each of these moves the mean by {words}: {', '.join(small)}")
    if result.stopped_by == "budget":
        words = f"the budget allowed {result.points} of {result.points_asked} points"
        if result.effects:
            words += "; without it intervals are narrower: --budget"
        notes.append(words)
    if result.jammed:
        words = "; ".join(setting_words(values) for values in result.jammed[:MOST_JAMS_NAMED])
        count = f"{len(result.jammed)} of {result.points_asked} points"
        notes.append(f"{count} jammed, and are left out: {words}")
    if result.horizon == "long" and result.effects:
        notes.append(
            "in the long run rows take their mean times, so luck is small; --horizon harvest has"
            " that of one harvest"
        )
    return notes


def _fit_notes(result: SensitivityResult) -> list[str]:
    """Return how good the fit is; nothing where all results are the same."""
    if not result.effects or result.spread.low == result.spread.high:
        return []
    notes = [_fit_words(result)]
    if result.fit < GOOD_FIT:
        notes.append("this fit is poor: smaller ranges, or fewer values, are told better")
    if result.fit < FIT_OF_ENDS:
        first = result.effects[0]
        ends = f"--vary {first.key}={first.low:g},{first.high:g}"
        notes.append(
            f"at low and at high need a fit of {100.0 * FIT_OF_ENDS:g} %; a study without"
            f" --sensitivity runs the ends themselves: {ends}"
        )
    return notes


def _fit_words(result: SensitivityResult) -> str:
    """Return how well the fit tells what the values move."""
    runs = f"{result.points} points, {result.runs} runs"
    if result.fit == 1.0:
        return f"the fit misses no more than seeds do ({runs})"
    words = f"the fit tells {100.0 * result.fit:.0f} % of what the values move"
    return f"{words} (R2, at points that it has not seen; {runs})"
