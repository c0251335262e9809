"""A study: which of many settings of a scenario is best, by how much, and with what confidence."""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import fmean
from typing import Any

from orchard.discrete.harvest import get_ready
from orchard.field.decisions import is_choice
from orchard.field.layout import lay_out
from orchard.field.problems import ScenarioError
from orchard.field.scenario import Scenario
from orchard.report.bounds import proven_seconds
from orchard.report.costs import PAYMENTS
from orchard.study.answer_words import answer
from orchard.study.break_even import KnownSetting, break_even_words, break_evens
from orchard.study.checking import checked_settings
from orchard.study.comparing import LOOKS, Comparison, compare, interval
from orchard.study.notes import StudyNotes, no_room
from orchard.study.options import StudyOptions
from orchard.study.orchard_words import orchard_words
from orchard.study.replications import Replications, confirmed, shown_rate
from orchard.study.result import (
    BreakEven,
    Check,
    Goal,
    Interval,
    Row,
    Standing,
    StoppedBy,
    StudyResult,
)
from orchard.study.runs import RunRecord, software
from orchard.study.settings import (
    ALL_IT_TAKES,
    CARRIERS,
    Setting,
    as_lists,
    have_prices,
    is_open,
    is_possible,
    more_numbers,
    most_carriers,
    numbered,
    settings_of,
)
from orchard.study.spread import number_beyond, spread
from orchard.study.store import Store
from orchard.study.workers import Workers, processes, scheduled

# S between two partial results.
REPORT_SECONDS = 0.5
# Of the budget, which the fast model may use if the full one is to confirm.
FAST_SHARE = 0.5


def study(
    scenario: Scenario,
    varied: Mapping[str, Sequence[Any]] = ALL_IT_TAKES,
    options: StudyOptions = StudyOptions(),
    tell: Callable[[StudyResult], None] = lambda partial: None,
    is_stopped: Callable[[], bool] = lambda: False,
) -> StudyResult:
    """Compare all settings of a scenario, and return the answer.

    `varied`: dotted path of the scenario -> its values; each combination is a setting. Without
    values of `carriers` the study tries as many as it takes. `tell` hears what is known so far.
    When `is_stopped` says True, the study returns what it knows. The same study gives the same
    table, whatever the workers do and the store knows already; only what the budget allows depends
    on the machine.

    Raises ScenarioError or StoreError for what a user can correct; WorkersError, RunFailed or
    StoreFailed if runs cannot be done or kept.
    """
    settings, problems = checked_settings(scenario, varied, options)
    if problems:
        raise ScenarioError(problems)
    if options.model != "full":
        get_ready([scenario])
    if options.scheduler:
        started = scheduled(options.scheduler)
    else:
        started = processes(options.workers)
    with Store(options.store_file, options.anew) as store, started as workers:
        asked = _Study(
            scenario=scenario,
            varied=numbered(scenario, varied),
            settings=settings,
            options=options,
            is_open=is_open(varied),
            store=store,
            workers=workers,
            tell=tell,
            is_stopped=is_stopped,
        )
        return asked.run()


@dataclass(kw_only=True)
class _Study:
    """A study that runs: replications of all settings, look by look, until they answer; then the
    full model's word.

    Settings are numbers from 0: `i` is one of them.
    """

    scenario: Scenario
    varied: dict[str, list[Any]]
    settings: list[Setting]
    options: StudyOptions
    # Whether it chooses the numbers of carriers.
    is_open: bool
    store: Store
    workers: Workers
    tell: Callable[[StudyResult], None]
    is_stopped: Callable[[], bool]

    def __post_init__(self) -> None:
        # S, by the clock of the machine.
        self.begun = time.time()
        self.reported_at = 0.0
        self.goal: Goal = self.options.goal or _goal_of(self.settings)
        self.model = self.options.first_model
        self.runs = Replications(
            self.settings,
            self.goal,
            self.options.horizon,
            self.store,
            self.workers,
            heard=self._report,
            is_stopped=self.is_stopped,
        )
        # The keys that vary and that nobody chooses: settings are compared where they are the same.
        self.circumstances = []
        choices = []
        for key, values in self.varied.items():
            is_compared = len(values) > 1 or (self.is_open and key == CARRIERS)
            if is_compared and is_choice(Scenario, key, values):
                choices.append(key)
            elif is_compared:
                self.circumstances.append(key)
        self.has_choices = bool(choices) or not self.circumstances
        # For how many carriers the orchard has room; 0 if nothing depends on it.
        self.most = 0
        if self.is_open:
            self.most = most_carriers(self.scenario)
        self.checks: dict[int, Check] = {}
        # Setting -> what is proven of its shortest harvest, s.
        self.proven: dict[int, float | None] = {}
        self.notes_of_checks: list[str] = []
        self.stopped_by: StoppedBy = "budget"

    def run(self) -> StudyResult:
        """Do all that the budget allows, and return the answer."""
        fast_share = 1.0
        if self.options.confirms:
            fast_share = FAST_SHARE
        self.stopped_by = self._replicate_until(self._end_of(fast_share))
        comparisons = self._compared()
        if self.options.confirms and comparisons and not self.runs.is_stopped():
            self._confirm(comparisons)
        if self.options.horizon == "harvest":
            for comparison in comparisons:
                for i in (comparison.best, *comparison.leads):
                    self._prove(i)
        return self._result()

    def _end_of(self, share: float) -> float:
        """Return when a share of the budget is used up, s by the clock of the machine."""
        return self.begun + share * self.options.budget_seconds

    def _confirm(self, comparisons: Sequence[Comparison]) -> None:
        """Have the full model do the best setting of each comparison.

        Where there is one comparison only, the full model does the runner-up too.
        """
        best = [comparison.best for comparison in comparisons]
        if len(best) == 1:
            best += comparisons[0].runner_up
        self.checks, self.notes_of_checks = confirmed(
            self.runs, best, self.options.confidence, self._end_of(1.0)
        )

    def _prove(self, i: int) -> None:
        """Prove how short the harvest of a setting could be, if there is time.

        That of the first setting is proven even if the budget is used up. Nothing can be proven
        of a setting in which the seed changes the rows.
        """
        has_time = not self.proven or time.time() < self._end_of(1.0)
        scenario = self.settings[i].scenario
        if has_time and not self.runs.is_stopped() and not scenario.work_is_drawn:
            self.proven[i] = proven_seconds(lay_out(scenario))

    def _report(self) -> None:
        """Tell what is known so far, now that a run is over."""
        if time.time() - self.reported_at > REPORT_SECONDS:
            self.tell(self._result())
            self.reported_at = time.time()

    # -- replications

    def _replicate_until(self, until: float) -> StoppedBy:
        """Do replications of all settings, and return why no more are done.

        The first replication shows which settings jam, and whether other numbers of carriers must
        be tried.
        """
        for look in (1, *LOOKS):
            if not self._replicate(look, until):
                return self._why_cut()
            if all(map(self._is_certain, self._compared())):
                return "certain"
        return "seeds"

    def _why_cut(self) -> StoppedBy:
        """Return why not all replications are done."""
        if self.runs.is_stopped():
            return "stopped"
        return "budget"

    def _is_certain(self, comparison: Comparison) -> bool:
        """Whether no more runs are needed for a comparison."""
        return not comparison.undecided and not self._is_wide(comparison)

    def _replicate(self, count: int, until: float) -> bool:
        """Do so many replications of all settings that do not jam. Return whether all are done."""
        while True:
            is_whole = self.runs.do(self._in_order(), self.model, count, until)
            if not is_whole:
                return False
            if not self.is_open or not self._add_numbers():
                return True

    def _add_numbers(self) -> bool:
        """Add numbers of carriers if the answer so far needs them. Return whether it does."""
        tried = self.varied[CARRIERS]
        wanted = set[int]()
        for comparison in self._compared():
            best_number = self.settings[comparison.best].scenario.carrier_count
            wanted.update(more_numbers(tried, best_number, self.most))
        more = sorted(wanted)
        if more:
            added, _ = settings_of(self.scenario, self.varied | {CARRIERS: more})
            self.settings += added
        self.varied[CARRIERS] = sorted([*tried, *more])
        return bool(more)

    def _is_wide(self, comparison: Comparison) -> bool:
        """Whether the rate of the best setting is not known well enough.

        It needs the runs of the first look. If the setting is alone, its interval must be narrow.
        """
        best = comparison.best
        if not self.settings[best].is_random:
            return False
        if comparison.count < LOOKS[0]:
            return True
        if len(comparison.leads) > 1:
            return False
        sample = self.runs.sample(best, self.model, comparison.count)
        rate = interval(sample, self.options.confidence)
        half_width = rate.high - rate.mean
        return not 0.0 < half_width <= self.options.within * rate.mean

    # -- which settings there are

    @property
    def jammed(self) -> list[int]:
        """The settings of which a run jammed."""
        return [i for i in range(len(self.settings)) if self._jams(i)]

    def _jams(self, i: int) -> bool:
        """Whether a run of a setting jammed."""
        return self.runs.has_jammed(i, self.model)

    def _alive(self) -> list[int]:
        """Return the settings that do not jam."""
        return [i for i in range(len(self.settings)) if not self._jams(i)]

    def _values_of(self, settings: Iterable[int]) -> list[dict[str, Any]]:
        """Return the values of these settings by key."""
        return [self.settings[i].values for i in settings]

    def _in_order(self) -> list[int]:
        """Return the settings that do not jam, those first that tell most of the whole range."""
        alive = set(self._alive())
        order = spread(self.varied, self._values_of(range(len(self.settings))))
        return [i for i in order if i in alive]

    def _robots(self, i: int) -> int:
        """Return how many robots a setting has, of which few are good.

        0 if their cost is in the goal.
        """
        if self.goal == "cost_per_bin":
            return 0
        return self.settings[i].robots

    def _place(self, i: int) -> tuple[int, ...]:
        """Return where a setting stands in the table: in the order of the values of all keys."""
        return self._place_by(self.varied, i)

    def _place_by(self, keys: Iterable[str], i: int) -> tuple[int, ...]:
        """Return where a setting stands by the values of these keys alone."""
        values = self.settings[i].values
        return tuple(self.varied[key].index(values[key]) for key in keys)

    # -- what the runs tell

    def _compared(self) -> list[Comparison]:
        """Return what the settings that do not jam say, on the seeds that all of them have.

        There is a comparison for each combination of what nobody chooses that has a run.
        """
        shown = [i for i in self._alive() if self.runs.known(i, self.model)]
        without_chance = []
        counts = []
        groups: dict[tuple[int, ...], list[int]] = {}
        for i in shown:
            groups.setdefault(self._place_by(self.circumstances, i), []).append(i)
            if self.settings[i].is_random:
                counts.append(len(self.runs.known(i, self.model)))
            else:
                without_chance.append(i)
        count = min(counts, default=1)
        comparisons = []
        for _, group in sorted(groups.items()):
            samples = {}
            robots = {}
            limits = {}
            for i in group:
                samples[i] = self.runs.sample(i, self.model, count)
                robots[i] = self._robots(i)
                if self._has_limit(i):
                    limits[i] = self._limit(i, count)
            comparison = compare(
                samples,
                robots=robots,
                is_max=self.goal == "bins_per_hour",
                confidence=self.options.confidence,
                within=self.options.within,
                without_chance=without_chance,
                limits=limits,
                intervals=len(shown) - len(groups),
            )
            comparisons.append(comparison)
        return comparisons

    def _has_limit(self, i: int) -> bool:
        """Whether no run of a setting can exceed its limit.

        It is the limit of a long run by built-in classes. One harvest begins with full batteries.
        """
        scenario = self.settings[i].scenario
        is_long = self.options.horizon == "long" or not scenario.has_batteries
        # A faster harvest may cost more then: its last day is shorter, and paid for as much.
        least = scenario.prices.picker_least_per_day
        has_short_day = self.options.horizon == "harvest" and least is not None
        is_limited = self.goal != "cost_per_bin" or not has_short_day
        return is_long and is_limited and not scenario.own_classes

    def _limit(self, i: int, count: int) -> float:
        """Return the best mean of the goal that a setting can have on the first seeds, without
        traffic.
        """
        records = self.runs.known(i, self.model)[:count]
        return fmean(self.runs.limit(i, record) for record in records)

    # -- the result

    def _result(self) -> StudyResult:
        """Return what is known so far."""
        comparisons = self._compared()
        with_runs = [*self.jammed]
        undecided: list[int] = []
        for comparison in comparisons:
            with_runs += comparison.leads
            undecided += comparison.undecided
        shown = sorted(with_runs, key=self._place)
        missing = [i for i in range(len(self.settings)) if i not in shown]
        # There is no best of all circumstances.
        best = None
        best_values = None
        if comparisons and not self.circumstances:
            best = comparisons[0].best
            best_values = self.settings[best].values
        beyond = {}
        if not missing:
            # Else a setting that has not run may be better than the last one that has.
            beyond = self._beyond(comparisons)
        result = StudyResult(
            answer="",
            orchard=orchard_words(self.scenario, self.varied),
            best=best_values,
            table=[self._row(i, comparisons) for i in shown],
            goal=self.goal,
            horizon=self.options.horizon,
            confidence=self.options.confidence,
            within=self.options.within,
            scenario=self.scenario.model_dump(),
            varied=as_lists(self.varied),
            wall_seconds=time.time() - self.begun,
            stopped_by=self.stopped_by,
            undecided=self._values_of(undecided),
            seconds_needed=self._seconds_needed(comparisons, missing),
            beyond=beyond,
            notes=self._notes(comparisons, shown, missing, best),
            version=software(),
            violations=self.runs.violations,
            given=self.circumstances,
            not_run=self._values_of(sorted(missing, key=self._place)),
            break_even=self._break_even(comparisons, best),
        )
        notes = [*result.notes, *map(break_even_words, result.break_even)]
        return replace(result, answer=answer(result), notes=notes)

    def _break_even(self, comparisons: Sequence[Comparison], best: int | None) -> list[BreakEven]:
        """Return what the last robots of the best setting may cost, if there are prices."""
        if best is None or not self.settings[best].has_prices:
            return []
        count = comparisons[0].count
        known = {}
        for i in comparisons[0].leads:
            records = self.runs.first_records(i, self.model, count)
            known[i] = KnownSetting(self.settings[i], records)
        return break_evens(known.pop(best), list(known.values()), self.options.confidence)

    def _notes(
        self,
        comparisons: Sequence[Comparison],
        shown: Sequence[int],
        missing: Sequence[int],
        best: int | None,
    ) -> list[str]:
        """Return what a reader must know beside the table.

        `shown`, `missing`: the settings with and without a run. `best`: None if there is none, or
        one for each combination of what nobody chooses.
        """
        notes = StudyNotes(self.runs, self.model, self.options, self.varied)
        sentences = notes.nothing_random()
        sentences += notes.missing(missing, was_stopped=self.stopped_by == "stopped")
        sentences += notes.jammed(self.jammed)
        sentences += notes.unequal(shown)
        sentences += notes.faulty([i for i in shown if not self._jams(i)])
        best_numbers = [self.settings[each.best].scenario.carrier_count for each in comparisons]
        if self.is_open and self.most in best_numbers:
            sentences.append(no_room(self.most))
        scenario = self.scenario
        if best is not None:
            sentences += notes.row_ends(best)
            scenario = self.settings[best].scenario
        if not self.circumstances:
            sentences += notes.part_full(scenario)
            sentences += notes.rare_truck(scenario)
        sentences += notes.heavier_bins(self.scenario)
        return sentences + self.notes_of_checks + notes.damaged()

    def _row(self, i: int, comparisons: Sequence[Comparison]) -> Row:
        """Return the line of a setting in the table."""
        records = self.runs.known(i, self.model)
        for comparison in comparisons:
            if i in comparison.leads:
                row = row_of(self.settings[i], records[: comparison.count], self.options.confidence)
                return self._compared_row(row, i, comparison)
        return row_of(self.settings[i], records, self.options.confidence)

    def _compared_row(self, row: Row, i: int, comparison: Comparison) -> Row:
        """Return a row with what its comparison, the simulator and the proof say of it."""
        if not self.has_choices:
            standing: Standing = "alone"
        elif i == comparison.best:
            standing = "best"
        else:
            standing = comparison.standing(i)
        behind = None
        if i != comparison.top:
            behind = comparison.ahead[i]
        return replace(
            row,
            standing=standing,
            lead=comparison.leads[i],
            behind=behind,
            check=self.checks.get(i),
            proven_seconds=self.proven.get(i),
        )

    def _seconds_needed(
        self, comparisons: Sequence[Comparison], missing: Sequence[int]
    ) -> float | None:
        """Return how long a run of each missing setting takes, or else what decides all.

        None: it is not known, or all is decided.
        """
        if missing and not comparisons:
            return None
        if missing:
            return self.runs.seconds_for(missing, self.model, 1)
        more = 0
        for comparison in comparisons:
            if not comparison.undecided:
                continue
            replications = comparison.replications_needed()
            if replications is None:
                return None
            more = max(more, replications - comparison.count)
        if not more:
            return None
        return self.runs.seconds_for(self._alive(), self.model, more)

    def _beyond(self, comparisons: Sequence[Comparison]) -> dict[str, Any]:
        """Return the next value of each key of which a best setting has the last one tried.

        A value that the scenario cannot have is left out, and one that nobody chooses.
        """
        beyond = dict[str, Any]()
        if not self.has_choices:
            return beyond
        chosen = [key for key in self.varied if key not in self.circumstances]
        for comparison in comparisons:
            best = self.settings[comparison.best].values
            for key in chosen:
                following = number_beyond(self.varied[key], best[key])
                if following is None:
                    continue
                if is_possible(self.scenario, best | {key: following}):
                    beyond.setdefault(key, following)
        return beyond


def _goal_of(settings: Sequence[Setting]) -> Goal:
    """Return the goal of a study without one of its own."""
    if have_prices(settings):
        return "cost_per_bin"
    return "bins_per_hour"


def row_of(setting: Setting, records: Sequence[RunRecord], confidence: float) -> Row:
    """Return the line of a setting in the table, from its runs by one model, with the standing of
    one that jams.
    """
    jammed = sum(record.is_jammed for record in records)
    harvested = records
    if jammed:
        # The others would tell of lucky runs.
        harvested = []
    rates = []
    seconds = []
    costs = []
    payments = []
    picker_waiting = []
    carrier_utilisations = []
    for record in harvested:
        rates.append(shown_rate(setting, record))
        picker_waiting.append(record.picker_waiting_seconds)
        carrier_utilisations.append(record.carrier_utilisation)
        of_run = setting.payments(record.bins_per_hour, record.counted_bins)
        payments.append(of_run)
        if record.horizon == "harvest":
            seconds.append(record.sim_seconds)
        if setting.has_prices:
            costs.append(sum(of_run.values()))
    count = max(1, len(harvested))
    return Row(
        setting=setting.values,
        model=records[0].model,
        replications=len(records),
        jammed=jammed,
        bins_per_hour=_interval_of(rates, confidence),
        harvest_seconds=_interval_of(seconds, confidence),
        cost_per_bin=_interval_of(costs, confidence),
        picker_waiting_seconds=sum(picker_waiting) / count,
        carrier_utilisation=sum(carrier_utilisations) / count,
        bound_bins_per_hour=setting.limit.bins_per_hour,
        bottleneck=setting.limit.bottleneck,
        standing="jammed",
        lead=None,
        paid=_mean_payments(payments),
    )


def _interval_of(values: Sequence[float], confidence: float) -> Interval | None:
    """Return the interval of a mean; None without values."""
    if not values:
        return None
    return interval(values, confidence)


def _mean_payments(payments: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Return the mean of each payment for a bin, in the order in which they are shown.

    `payments`: of each run, purpose -> amount.
    """
    means: dict[str, float] = {}
    for of_run in payments:
        for purpose, amount in of_run.items():
            means[purpose] = means.get(purpose, 0.0) + amount / len(payments)
    return {purpose: means[purpose] for purpose in PAYMENTS if purpose in means}
