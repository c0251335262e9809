"""A study: which of many settings of a scenario is best, by how much, and with what confidence."""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean
from typing import Any

from orchard.behaviour.catalogue import check_plugins
from orchard.discrete.harvest import get_ready
from orchard.field.decisions import is_choice
from orchard.field.layout import Layout, lay_out
from orchard.field.problems import Problem, ScenarioError
from orchard.field.scenario import Scenario
from orchard.folders import runs_folder
from orchard.plans.routes import route_of
from orchard.report.bounds import Bounds, proven_seconds
from orchard.report.limits import full_bins
from orchard.study.comparing import LOOKS, Comparison, compare, interval
from orchard.study.replications import Replications, confirmed, shown_rate
from orchard.study.result import (
    Check,
    Goal,
    Horizon,
    Model,
    Models,
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
    is_open,
    more_numbers,
    most_carriers,
    numbered,
    settings_of,
)
from orchard.study.spread import number_beyond, spread
from orchard.study.store import Store
from orchard.study.words import answer, counted, orchard_words
from orchard.study.workers import Workers, processes, scheduled

TOLD = 0.5  # s between two partial results
FAST_SHARE = 0.5  # of the budget, which the fast model may use if the full one is to confirm
STORE = "studies.db"
SHARES = frozenset(
    {"rows", "pickers", "rows_to_pickers"}
)  # keys on which it depends how much each picker has to pick


@dataclass(frozen=True, kw_only=True)
class StudyOptions:
    """How a study is done. The command `orchard study` has an option for each field."""

    horizon: Horizon = "long"
    goal: Goal | None = None  # None: the least cost if the scenario has prices, else the most bins
    confidence: float = 0.95
    within: float = 0.02  # a difference below this share is worth nothing
    budget_seconds: float = 300.0
    model: Models = "both"
    workers: int | None = None  # processes here; None: one per core
    scheduler: str | None = (
        None  # address of a dask.distributed scheduler, which gets the runs instead
    )
    store: Path | None = None  # None: studies.db in the folder of runs
    anew: bool = False  # forget what a store of another version holds

    @property
    def store_file(self) -> Path:
        return self.store or runs_folder() / STORE


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
    started = scheduled(options.scheduler) if options.scheduler else processes(options.workers)
    with Store(options.store_file, options.anew) as store, started as workers:
        numbers = numbered(scenario, varied)
        return _Study(
            scenario, numbers, settings, options, is_open(varied), store, workers, tell, is_stopped
        ).run()


def checked_settings(
    scenario: Scenario, varied: Mapping[str, Sequence[Any]], options: StudyOptions
) -> tuple[list[Setting], list[Problem]]:
    """Return the settings of a study, and all that is wrong with them, with what options ask, and
    with own classes.
    """
    settings, problems = settings_of(scenario, numbered(scenario, varied))
    asked = settings or [Setting({}, scenario)]
    return settings, [
        *problems,
        *_option_problems(asked, options),
        *_plugin_problems(asked, options.model),
    ]


def _option_problems(settings: Sequence[Setting], options: StudyOptions) -> list[Problem]:
    model, is_long, is_fast = (
        f"--model {options.model}",
        options.horizon == "long",
        options.model != "full",
    )
    own = sorted(
        {
            name
            for one in settings
            for name in (*one.scenario.agents, *one.scenario.agents_without_body)
        }
    )
    prices = "needs a price: picker_per_hour, carrier_per_hour, overhead_per_hour or per_bin"
    agents = f"only the full model knows agents of your own ({', '.join(own)}); choose --model full"
    sensors = "only the full model knows errors of sensors; choose --model full"
    no_end = "a long run has no end; choose --horizon harvest, or another goal"
    no_long_run = "only the fast model can tell the long run; choose --horizon harvest"
    found = {
        Problem("--goal cost_per_bin", prices, "prices"): (
            options.goal == "cost_per_bin" and not all(one.has_prices for one in settings)
        ),
        Problem("--goal harvest_seconds", no_end): is_long and options.goal == "harvest_seconds",
        Problem(model, no_long_run): is_long and not is_fast,
        Problem(model, agents, "agents"): is_fast and bool(own),
        Problem(model, sensors, "sensors"): (
            is_fast and not all(one.scenario.sensors.are_exact for one in settings)
        ),
    }
    return [problem for problem, is_there in found.items() if is_there]


def _plugin_problems(settings: Sequence[Setting], model: Models) -> list[Problem]:
    with_own = {
        tuple(classes.items()): setting
        for setting in settings
        if (classes := setting.scenario.own_classes)
    }
    return [
        problem for setting in with_own.values() for problem in _plugin_problems_of(setting, model)
    ]


def _plugin_problems_of(setting: Setting, model: Models) -> list[Problem]:
    try:
        layout = lay_out(setting.scenario)
        check_plugins(layout)
        steps = [step.__name__ for step in route_of(layout).Steps]
    except ScenarioError as error:
        return [replace(problem, file=setting.words or problem.file) for problem in error.problems]
    text = f"only the full model knows steps of your own ({', '.join(steps)}); choose --model full"
    return (
        [Problem(f"--model {model}", text, "route", setting.scenario.route)]
        if steps and model != "full"
        else []
    )


@dataclass
class _Study:
    """A study that runs: replications of all settings, look by look, until they answer; then the
    full model's word.
    """

    scenario: Scenario
    varied: dict[str, list[Any]]
    settings: list[Setting]
    options: StudyOptions
    is_open: bool  # whether it chooses the numbers of carriers
    store: Store
    workers: Workers
    tell: Callable[[StudyResult], None]
    is_stopped: Callable[[], bool]

    def __post_init__(self) -> None:
        options, self.begun, self.told = self.options, time.time(), 0.0
        self.goal = options.goal or (
            "cost_per_bin" if all(one.has_prices for one in self.settings) else "bins_per_hour"
        )
        self.model: Model = "full" if options.model == "full" else "fast"
        self.runs = Replications(
            self.settings,
            self.goal,
            options.horizon,
            self.store,
            self.workers,
            self._hear,
            self.is_stopped,
        )
        several = {key for key, values in self.varied.items() if len(values) > 1}
        if self.is_open:
            several.add(CARRIERS)
        # The keys that vary and that nobody chooses: settings are compared where they are the same.
        self.given = [
            key
            for key, values in self.varied.items()
            if key in several and not is_choice(Scenario, key, values)
        ]
        self.has_choices = several > {*self.given} or not self.given
        self.most = most_carriers(self.scenario) if self.is_open else 0
        self.checks: dict[int, Check] = {}
        self.proven: dict[
            int, float | None
        ] = {}  # setting -> what is proven of its shortest harvest, s
        self.notes: list[str] = []
        self.stopped_by: StoppedBy = "budget"

    def run(self) -> StudyResult:
        """Do all that the budget allows, and return the answer."""
        confirms = self.options.model == "both" and self.options.horizon == "harvest"
        self.stopped_by = self._replicate_until(self._share(FAST_SHARE if confirms else 1.0))
        comparisons = self._compared()
        if confirms and comparisons and not self.runs.is_stopped():
            best = [comparison.best for comparison in comparisons]
            if len(best) == 1:
                best += comparisons[0].runner_up
            self.checks, self.notes = confirmed(
                self.runs, best, self.options.confidence, self._share(1.0)
            )
        if self.options.horizon == "harvest":
            self._prove([i for one in comparisons for i in (one.best, *one.leads)])
        return self._result()

    def _prove(self, settings: Sequence[int]) -> None:
        """Prove how short their harvests could be, of the first one even if the budget is used up;
        of none in which the seed changes the rows.
        """
        for i in settings:
            is_time = not self.proven or time.time() < self._share(1.0)
            if (
                is_time
                and not self.runs.is_stopped()
                and not self.settings[i].scenario.work_is_drawn
            ):
                self.proven[i] = proven_seconds(lay_out(self.settings[i].scenario))

    def _share(self, share: float) -> float:
        return self.begun + share * self.options.budget_seconds

    def _hear(self) -> None:
        """Hear that a run is over, and tell what is known so far."""
        if time.time() - self.told > TOLD:
            self.tell(self._result())
            self.told = time.time()

    # -- replications

    def _replicate_until(self, until: float) -> StoppedBy:
        """Do replications of all settings.

        One of each comes first: it shows what jams, and whether other numbers must be tried.
        """
        for look in (1, *LOOKS):
            if not self._replicate(look, until):
                return "stopped" if self.runs.is_stopped() else "budget"
            if not any(one.undecided or self._is_wide(one) for one in self._compared()):
                return "certain"
        return "seeds"

    def _replicate(self, count: int, until: float) -> bool:
        """Do so many replications of all settings that do not jam. Return whether all are done."""
        while True:
            is_whole = self.runs.do(self._in_order(), self.model, count, until)
            if not is_whole or not (self.is_open and self._add_numbers()):
                return is_whole

    @property
    def jammed(self) -> list[int]:
        return [
            i
            for i in range(len(self.settings))
            if any(record.ended == "jammed" for record in self.runs.known(i, self.model))
        ]

    def _alive(self) -> list[int]:
        jammed = self.jammed
        return [i for i in range(len(self.settings)) if i not in jammed]

    def _in_order(self) -> list[int]:
        """Return the settings that do not jam, those first that tell most of the whole range."""
        alive = set(self._alive())
        order = spread(self.varied, [setting.values for setting in self.settings])
        return [i for i in order if i in alive]

    def _add_numbers(self) -> bool:
        """Add numbers of carriers if the answer so far needs them. Return whether it does."""
        tried = self.varied[CARRIERS]
        answers = [self.settings[one.best].scenario.carrier_count for one in self._compared()]
        more = sorted(
            {number for answer in answers for number in more_numbers(tried, answer, self.most)}
        )
        if more:
            self.settings += settings_of(self.scenario, self.varied | {CARRIERS: more})[0]
        self.varied[CARRIERS] = sorted([*tried, *more])
        return bool(more)

    def _is_wide(self, found: Comparison) -> bool:
        """Whether the rate of the best setting is not known well enough.

        It needs the runs of the first look. If the setting is alone, its interval must be narrow.
        """
        if not self.settings[found.best].is_random:
            return False
        if found.count < LOOKS[0]:
            return True
        if len(found.leads) > 1:
            return False
        one = interval(
            self.runs.sample(found.best, self.model, found.count), self.options.confidence
        )
        return not 0.0 < one.high - one.mean <= self.options.within * one.mean

    # -- what they tell

    def _compared(self) -> list[Comparison]:
        """Return what the settings that do not jam say, on the seeds that all of them have.

        There is a comparison for each combination of what nobody chooses that has a run.
        """
        shown = [i for i in self._alive() if self.runs.known(i, self.model)]
        without_chance = [i for i in shown if not self.settings[i].is_random]
        count = min(
            (len(self.runs.known(i, self.model)) for i in shown if i not in without_chance),
            default=1,
        )
        groups: dict[tuple[int, ...], list[int]] = {}
        for i in shown:
            groups.setdefault(self._place(i, self.given), []).append(i)
        return [
            compare(
                {i: self.runs.sample(i, self.model, count) for i in group},
                robots={i: self._robots(i) for i in group},
                is_max=self.goal == "bins_per_hour",
                confidence=self.options.confidence,
                within=self.options.within,
                without_chance=without_chance,
                limits={i: self._limit(i, count) for i in group if self._has_limit(i)},
                intervals=len(shown) - len(groups),
            )
            for _, group in sorted(groups.items())
        ]

    def _has_limit(self, i: int) -> bool:
        """Whether no run of a setting can exceed its limit.

        It is the limit of a long run by built-in classes. One harvest begins with full batteries.
        """
        scenario = self.settings[i].scenario
        is_long = self.options.horizon == "long" or not scenario.has_batteries
        return is_long and not scenario.own_classes

    def _limit(self, i: int, count: int) -> float:
        """The best mean of the goal that a setting can have on the first seeds, without traffic."""
        records = self.runs.known(i, self.model)[:count]
        return fmean(self.runs.limit(i, record) for record in records)

    def _robots(self, i: int) -> int:
        """How many robots a setting has, of which few are good; 0 if their cost is in the goal."""
        scenario = self.settings[i].scenario
        return 0 if self.goal == "cost_per_bin" else scenario.pickers + scenario.carrier_count

    def _result(self) -> StudyResult:
        comparisons = self._compared()
        found = comparisons[0] if comparisons and not self.given else None
        alive = [i for comparison in comparisons for i in comparison.leads]
        shown = sorted([*alive, *self.jammed], key=self._place)
        missing = [i for i in range(len(self.settings)) if i not in shown]
        undecided = [i for comparison in comparisons for i in comparison.undecided]
        records = self.runs.records.values()
        result = StudyResult(
            answer="",
            orchard=orchard_words(self.scenario, self.varied),
            best=self.settings[found.best].values if found else None,
            table=[self._row(i, comparisons) for i in shown],
            goal=self.goal,
            horizon=self.options.horizon,
            confidence=self.options.confidence,
            within=self.options.within,
            scenario=self.scenario.model_dump(),
            varied={key: list(values) for key, values in self.varied.items()},
            wall_seconds=time.time() - self.begun,
            stopped_by=self.stopped_by,
            undecided=[self.settings[i].values for i in undecided],
            seconds_needed=self._seconds_needed(comparisons, missing),
            # A setting that has not run may be better than the last one that has.
            beyond={} if missing else self._beyond(comparisons),
            notes=[
                *self._about(shown, missing),
                *self._no_room(comparisons),
                *self._row_ends(found),
                *self._part_full(found),
                *self.notes,
                *self._damaged(),
            ],
            version=software(),
            violations=sorted(
                {line for record in records for line in record.violations.splitlines()}
            ),
            given=self.given,
            not_run=[self.settings[i].values for i in sorted(missing, key=self._place)],
        )
        return replace(result, answer=answer(result))

    def _place(self, i: int, keys: Sequence[str] | None = None) -> tuple[int, ...]:
        """Return where a setting stands in the table: in the order of the values of these keys.

        None: of all keys.
        """
        values = self.settings[i].values
        asked = self.varied if keys is None else keys
        return tuple(self.varied[key].index(values[key]) for key in asked)

    def _row(self, i: int, comparisons: Sequence[Comparison]) -> Row:
        records = self.runs.known(i, self.model)
        found = next((one for one in comparisons if i in one.leads), None)
        if found is None:
            return row_of(self.settings[i], records, self.options.confidence)
        if not self.has_choices:
            stands: Standing = "alone"
        else:
            stands = "best" if i == found.best else found.standing(i)
        row = row_of(self.settings[i], records[: found.count], self.options.confidence)
        return replace(
            row,
            standing=stands,
            lead=found.leads[i],
            behind=None if i == found.top else found.ahead[i],
            check=self.checks.get(i),
            proven_seconds=self.proven.get(i),
        )

    def _seconds_needed(
        self, comparisons: Sequence[Comparison], missing: Sequence[int]
    ) -> float | None:
        """Return how long a run of each missing setting takes, or what decides all; None:
        unknown.
        """
        if missing:
            return self.runs.seconds_for(missing, self.model, 1) if comparisons else None
        undecided = [one for one in comparisons if one.undecided]
        looks = [one.replications_needed() for one in undecided]
        needed = [look for look in looks if look is not None]
        if not looks or len(needed) < len(looks):
            return None
        more = max(needed) - undecided[0].count
        return self.runs.seconds_for(self._alive(), self.model, more)

    def _beyond(self, comparisons: Sequence[Comparison]) -> dict[str, Any]:
        """Return the next value of each key of which a best setting has the last one tried.

        A value that the scenario cannot have is left out, and one that nobody chooses.
        """
        beyond = dict[str, Any]()
        for comparison in comparisons if self.has_choices else ():
            best = self.settings[comparison.best].values
            for key, values in self.varied.items():
                following = None if key in self.given else number_beyond(values, best[key])
                if following is not None and self._is_possible(best | {key: following}):
                    beyond.setdefault(key, following)
        return beyond

    def _is_possible(self, values: Mapping[str, Any]) -> bool:
        """Whether the scenario can have these values. `values`: dotted path -> value."""
        _, problems = settings_of(self.scenario, {key: [value] for key, value in values.items()})
        return not problems

    # -- its notes

    def _about(self, shown: Sequence[int], missing: Sequence[int]) -> list[str]:
        notes = []
        if not any(setting.is_random for setting in self.settings):
            notes.append(
                "nothing in these settings is random, so one run of each stands for all seeds"
            )
        if missing:
            why = (
                "the study was stopped before"
                if self.stopped_by == "stopped"
                else "there was no time for"
            )
            notes.append(
                f"{why} a run of {counted('settings', len(missing))}, {self._words(missing)}: not"
                " in the table"
            )
        for i in self.jammed:
            faults = [
                *filter(None, (record.faults for record in self.runs.known(i, self.model))),
                "some robots wait for ever",
            ]
            notes.append(
                f"{self.settings[i].words or 'the scenario'} jams: {faults[0].splitlines()[0]}"
            )
        return [
            *notes,
            *self._unequal(shown),
            *self._faults(i for i in shown if i not in self.jammed),
        ]

    def _unequal(self, shown: Sequence[int]) -> list[str]:
        """That the long run, in which each picker has rows for ever, does not see unequal shares of
        the rows, if these vary.
        """
        is_seen = self.options.horizon == "harvest" or SHARES.isdisjoint(self.varied)
        if is_seen or not any(
            _is_unequal(lay_out(self.settings[i].scenario), self.options.within) for i in shown
        ):
            return []
        return [
            "some pickers get more rows than others, and only one harvest waits for the last one:"
            " --horizon harvest"
        ]

    def _no_room(self, comparisons: Sequence[Comparison]) -> list[str]:
        """That an answer is the last number for another reason than that more gain nothing."""
        best = [self.settings[one.best].scenario.carrier_count for one in comparisons]
        is_last = self.is_open and self.most in best
        return (
            [f"the orchard has room for {counted('carriers', self.most)}, no more"]
            if is_last
            else []
        )

    def _row_ends(self, found: Comparison | None) -> list[str]:
        """What the drives to the ends of rows cost with the best setting."""
        if found is None or self.settings[found.best].scenario.bin_metres is None:
            return []
        share = Bounds(lay_out(self.settings[found.best].scenario)).row_end_share
        return [
            f"drives to the ends of rows take {100 * share:.1f} % of a picker's time: exchanging"
            " bins inside rows could gain no more"
        ]

    def _part_full(self, found: Comparison | None) -> list[str]:
        """That the bins of one harvest have less fruit than as many full ones, with the best
        setting.
        """
        if self.given:
            return []
        scenario = self.settings[found.best].scenario if found is not None else self.scenario
        if self.options.horizon == "long" or scenario.bin_metres is None:
            return []
        layout = lay_out(scenario)
        fruit = full_bins(layout)
        if layout.bins <= (1.0 + self.options.within) * fruit:
            return []
        bins = (
            f"each picker's last bin may be part full: {layout.bins} bins have the fruit of"
            f" {fruit:.1f}"
        )
        more = 100.0 * (layout.bins / fruit - 1.0)
        return [f"{bins}, so a full one costs {more:.1f} % more; bins an hour are full ones"]

    def _faults(self, rows: Iterable[int]) -> list[str]:
        """Of each setting in which an own class failed, the first fault: its figures are those of
        another rule.
        """
        notes = []
        for i in rows:
            records = [*self.runs.known(i, "fast"), *self.runs.known(i, "full")]
            if faulty := [record for record in records if record.faults]:
                first = f"seed {faulty[0].seed}: {faulty[0].faults.splitlines()[0]}"
                notes.append(
                    f"{self.settings[i].words or 'the scenario'}: {len(faulty)} of {len(records)}"
                    f" runs had faults; {first}"
                )
        return notes

    def _damaged(self) -> list[str]:
        store = self.runs.store
        if not store.damaged:
            return []
        first = next(iter(store.damaged.values()))
        return [
            f"{store.path}: {len(store.damaged)} of the runs in it were damaged, as by {first}:"
            " they are done again"
        ]

    def _words(self, settings: Sequence[int], most: int = 5) -> str:
        return "; ".join(self.settings[i].words for i in settings[:most]) + (
            " and others" if len(settings) > most else ""
        )


def _is_unequal(layout: Layout, within: float) -> bool:
    """Whether a picker has more to pick than the mean, by what counts."""
    metres = [
        sum(layout.lane(row).length for row in block.rows) for block in layout.blocks.values()
    ]
    return max(metres) * len(metres) > (1.0 + within) * sum(metres)


def row_of(setting: Setting, records: Sequence[RunRecord], confidence: float) -> Row:
    """Return the line of a setting in the table, from its runs by one model, with the standing of
    one that jams.
    """
    jammed = sum(record.ended == "jammed" for record in records)
    harvested = [] if jammed else records  # the others would tell of lucky runs
    rates = [shown_rate(setting, record) for record in harvested]
    seconds = [record.sim_seconds for record in harvested if record.horizon == "harvest"]
    costs = [
        cost
        for record in harvested
        if (cost := setting.cost_per_bin(record.bins_per_hour)) is not None
    ]
    count = max(1, len(harvested))
    return Row(
        setting=setting.values,
        model=records[0].model,
        replications=len(records),
        jammed=jammed,
        bins_per_hour=interval(rates, confidence) if rates else None,
        harvest_seconds=interval(seconds, confidence) if seconds else None,
        cost_per_bin=interval(costs, confidence) if costs else None,
        picker_waiting_seconds=sum(record.picker_waiting_seconds for record in harvested) / count,
        carrier_utilisation=sum(record.carrier_utilisation for record in harvested) / count,
        bound_bins_per_hour=setting.limit.bins_per_hour,
        bottleneck=setting.limit.bottleneck,
        standing="jammed",
        lead=None,
    )
