"""A study: which of many settings of a scenario is best, by how much, and with what confidence."""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean
from typing import Any

from orchard.agents.catalogue import check_plugins
from orchard.agents.routes import route_of
from orchard.field.layout import lay_out
from orchard.field.problems import Problem, ScenarioError
from orchard.field.scenario import Scenario
from orchard.folders import runs_folder
from orchard.report.bounds import Bounds, lost_seconds
from orchard.study.racing import LOOKS, Race, interval
from orchard.study.replications import Confirmation, Replications
from orchard.study.result import Check, Comparison, Goal, Horizon, Model, Models, Row, StoppedBy, StudyResult
from orchard.study.runs import RunRecord, software
from orchard.study.settings import Setting, settings_of
from orchard.study.store import Store
from orchard.study.words import orchard_words, sentence
from orchard.study.workers import Workers, processes, scheduled

TOLD = 0.5  # s between two partial results
RACE_SHARE = 0.5  # of the budget, which the fast model may use if the full one is to confirm
LOSSES_SHARE = 0.9  # of the budget, after which no more losses are split: the answer is to be there in time
STORE = "studies.db"


@dataclass(frozen=True, kw_only=True)
class StudyOptions:
    """How a study is done. The command `orchard study` has an option for each field."""

    horizon: Horizon = "harvest"
    goal: Goal = "bins_per_hour"
    confidence: float = 0.95
    within: float = 0.01  # half the width of an interval, as a share of its mean, that is narrow enough
    budget_seconds: float = 60.0
    model: Models = "both"
    workers: int | None = None  # processes here; None: one per core
    scheduler: str | None = None  # address of a dask.distributed scheduler, which gets the runs instead
    store: Path | None = None  # None: studies.db in the folder of runs
    anew: bool = False  # forget what a store of another version holds

    @property
    def store_file(self) -> Path:
        return self.store or runs_folder() / STORE


def study(
    scenario: Scenario,
    varied: Mapping[str, Sequence[Any]],
    options: StudyOptions,
    tell: Callable[[StudyResult], None] = lambda partial: None,
    is_stopped: Callable[[], bool] = lambda: False,
) -> StudyResult:
    """Compare all settings of a scenario, and return the answer.

    `varied`: dotted path of the scenario -> its values; each combination is a setting. `tell` hears what is known so far. When `is_stopped`
    says True, the study returns what it knows. The same study gives the same table, whatever the workers do and the store knows already;
    only what the budget allows depends on the machine.

    Raises ScenarioError or StoreError for what a user can correct; WorkersError, RunFailed or StoreFailed if runs cannot be done or kept.
    """
    settings, problems = checked_settings(scenario, varied, options)
    if problems:
        raise ScenarioError(problems)
    started = scheduled(options.scheduler) if options.scheduler else processes(options.workers)
    with Store(options.store_file, options.anew) as store, started as workers:
        return _Study(scenario, varied, settings, options, store, workers, tell, is_stopped).run()


def checked_settings(scenario: Scenario, varied: Mapping[str, Sequence[Any]], options: StudyOptions) -> tuple[list[Setting], list[Problem]]:
    """Return the settings of a study, and all that is wrong with them, with what options ask, and with own classes."""
    settings, problems = settings_of(scenario, varied)
    asked = settings or [Setting({}, scenario)]
    return settings, [*problems, *_option_problems(asked, options), *_plugin_problems(asked, options.model)]


def _option_problems(settings: Sequence[Setting], options: StudyOptions) -> list[Problem]:
    model, is_long, is_fast = f"--model {options.model}", options.horizon == "long", options.model != "full"
    own = sorted({name for one in settings for name in (*one.scenario.agents, *one.scenario.agents_without_body)})
    prices = "needs a price: picker_per_hour, carrier_per_hour, overhead_per_hour or per_bin"
    agents = f"only the full model knows agents of your own ({', '.join(own)}); choose --model full"
    sensors = "only the full model knows errors of sensors; choose --model full"
    no_end = "a long run has no end; choose --horizon harvest, or another goal"
    no_long_run = "only the fast model can tell the long run; leave out --model full"
    found = {
        Problem("--goal cost_per_bin", prices, "prices"): options.goal == "cost_per_bin" and not all(one.has_prices for one in settings),
        Problem("--goal harvest_seconds", no_end): is_long and options.goal == "harvest_seconds",
        Problem("--horizon long", no_long_run): is_long and not is_fast,
        Problem(model, agents, "agents"): is_fast and bool(own),
        Problem(model, sensors, "sensors"): is_fast and not all(one.scenario.sensors.are_exact for one in settings),
    }
    return [problem for problem, is_there in found.items() if is_there]


def _plugin_problems(settings: Sequence[Setting], model: Models) -> list[Problem]:
    with_own = {tuple(classes.items()): setting for setting in settings if (classes := setting.scenario.own_classes)}
    return [problem for setting in with_own.values() for problem in _plugin_problems_of(setting, model)]


def _plugin_problems_of(setting: Setting, model: Models) -> list[Problem]:
    try:
        layout = lay_out(setting.scenario)
        check_plugins(layout)
        steps = [step.__name__ for step in route_of(layout).Steps]
    except ScenarioError as error:
        return [replace(problem, file=setting.words or problem.file) for problem in error.problems]
    text = f"only the full model knows steps of your own ({', '.join(steps)}); choose --model full"
    return [Problem(f"--model {model}", text, "route", setting.scenario.route)] if steps and model != "full" else []


@dataclass
class _Study:
    """A study that runs: a race of the settings, then the full model's word, then what was lost to what."""

    scenario: Scenario
    varied: Mapping[str, Sequence[Any]]
    settings: list[Setting]
    options: StudyOptions
    store: Store
    workers: Workers
    tell: Callable[[StudyResult], None]
    is_stopped: Callable[[], bool]

    def __post_init__(self) -> None:
        options, self.begun, self.told = self.options, time.time(), 0.0
        self.model: Model = "full" if options.model == "full" else "fast"
        self.runs = Replications(self.settings, options.goal, options.horizon, self.store, self.workers, self._hear, self.is_stopped)
        without_chance = frozenset(i for i, setting in enumerate(self.settings) if not setting.is_random)
        self.race = Race(len(self.settings), options.goal == "bins_per_hour", options.confidence, options.within, without_chance)
        self.confirmation = Confirmation(self.race, self.runs)
        self.lost: dict[int, dict[str, float]] = {}
        self.notes: list[str] = []

    def run(self) -> StudyResult:
        """Do all that the budget allows, and return the answer."""
        confirms = self.options.model == "both" and self.options.horizon == "harvest"
        self._race(self._share(RACE_SHARE if confirms else 1.0))
        if confirms:
            self.confirmation.run(self._share(1.0))
        elif self.options.model == "both":
            self.notes.append("the simulator has no long run: the fast model alone answers")
        if self.options.horizon == "harvest" and not self.runs.is_stopped():
            self._split_losses(self._share(LOSSES_SHARE))
        return self._result()

    def _share(self, share: float) -> float:
        return self.begun + share * self.options.budget_seconds

    def _hear(self) -> None:
        """Hear that a run is over, and tell what is known so far."""
        if time.time() - self.told > TOLD:
            self.tell(self._result())
            self.told = time.time()

    # -- the race

    def _race(self, until: float) -> None:
        """Do replications of all settings that are left, look by look. One of each comes first: what jams gets no more."""
        for look in (1, *LOOKS):
            more = [i for i in self.race.left if self.settings[i].is_random]
            fits = look <= LOOKS[0] or self.runs.fits(more, self.model, look, until)
            is_whole = fits and self._replicate(look, until)
            if self.race.why is None and not is_whole:
                return self._end_race()
            if look >= LOOKS[0]:
                self.race.look(self._samples(look), look == LOOKS[-1])
            if self.race.why is not None:
                break

    def _replicate(self, count: int, until: float) -> bool:
        """Do so many replications of all settings that are left, until none of these jams. Return whether all are done."""
        while True:
            left = list(self.race.left)
            is_whole = self.runs.do(left, self.model, count, until)
            self.race.jam([i for i in left if any(record.ended == "jammed" for record in self.runs.known(i, self.model))])
            if not is_whole or all(i in left for i in self.race.left):
                return is_whole

    def _end_race(self) -> None:
        """End the race because of the budget or the user, after a last look at the seeds that all have."""
        why: StoppedBy = "stopped" if self.runs.is_stopped() else "budget"
        missing = [i for i in self.race.left if not self.runs.known(i, self.model)]
        self.race.left = [i for i in self.race.left if i not in missing]
        if missing:
            count = f"{len(missing)} setting{'s' if len(missing) > 1 else ''}"
            self.notes.append(f"the budget did not allow a run of {count}, {self._words(missing)}: not in the table")
        random = [i for i in self.race.left if self.settings[i].is_random]
        common = min((len(self.runs.known(i, self.model)) for i in random), default=LOOKS[0])
        if self.race.left:
            self.race.look(self._samples(common))
        if random and common < LOOKS[0]:
            made = f"{common} replication{'s' if common > 1 else ''}"
            self.notes.append(f"the budget allowed {made} of each setting; {LOOKS[0]} are the least for a sound answer")
        self.race.why = why

    def _samples(self, count: int) -> dict[int, list[float]]:
        return {i: self.runs.sample(i, self.model, count) for i in self.race.left}

    # -- what was lost

    def _split_losses(self, until: float) -> None:
        known = [i for i in range(len(self.settings)) if self.runs.harvested(i, self.model)]
        first = [i for i in (self.race.best, *self.race.left) if i in known]
        harvests = {i: self._harvests(i) for i in dict.fromkeys([*first, *known])}
        items = [(i, *harvest) for i, some in harvests.items() for harvest in some]
        parts: dict[int, list[dict[str, float]]] = {i: [] for i in harvests}
        for item, lost in self.runs.workers.do(_losses, items, lambda: self.runs.goes_on(until)):
            parts[item[0]].append(lost)
        whole = {i: each for i, each in parts.items() if len(each) == len(harvests[i])}
        self.lost = {i: {part: round(fmean(one[part] for one in each), 1) for part in each[0]} for i, each in whole.items()}
        if left := len(harvests) - len(self.lost):
            self.notes.append(f"the budget did not allow to split what was lost in {left} of {len(harvests)} settings")

    def _harvests(self, i: int) -> list[tuple[Scenario, float]]:
        """The harvests whose lengths, s, are split: their mean, or some with the rows that their seeds draw."""
        scenario = self.settings[i].scenario
        if not scenario.picking.is_drawn:
            return [(scenario, self.runs.mean(i, self.model, lambda record: record.sim_seconds))]
        records = self.runs.harvested(i, self.model)[: LOOKS[0]]
        return [(scenario.model_copy(update={"seed": record.seed}), record.sim_seconds) for record in records]

    # -- the result

    def _result(self) -> StudyResult:
        rows = {i: row for i in range(len(self.settings)) if (row := self._row(i)) is not None}
        best = self.race.best if self.race.best is not None else self._present_best(rows)
        compared = [i for i in rows if i != best and i not in self.race.jammed] if self.race.best is not None else []
        verdicts = {i: self._verdict(i) for i in compared}
        records = self.runs.records.values()
        result = StudyResult(
            answer="",
            orchard=orchard_words(self.scenario, self.varied),
            best=None if best is None else self.settings[best].values,
            indistinguishable=[self.settings[i].values for i in self.race.left if i != best and self.race.why is not None],
            table=list(rows.values()),
            comparisons=list(verdicts.values()),
            goal=self.options.goal,
            horizon=self.options.horizon,
            confidence=self.options.confidence,
            scenario=self.scenario.model_dump(),
            varied={key: list(values) for key, values in self.varied.items()},
            wall_seconds=time.time() - self.begun,
            stopped_by=self.race.why or "budget",
            notes=[*self._about(rows, verdicts), *self._row_ends(best), *self.notes, *self.confirmation.notes, *self._damaged()],
            version=software(),
            violations=sorted({line for record in records for line in record.violations.splitlines()}),
        )
        return replace(result, answer=sentence(result))

    def _row(self, i: int) -> Row | None:
        """The line of a setting in the table; None without a run. The intervals of those that are left hold together."""
        records, confidence = self.runs.known(i, self.model), self.race.each if i in self.race.left else self.options.confidence
        return row_of(self.settings[i], records, confidence, self.lost.get(i, {}), self.confirmation.checks.get(i))

    def _present_best(self, rows: Mapping[int, Row]) -> int | None:
        means = {i: one.mean for i, row in rows.items() if not row.jammed and (one := getattr(row, self.options.goal)) is not None}
        return (max if self.race.is_max else min)(means, key=lambda i: means[i]) if means else None

    def _verdict(self, i: int) -> Comparison:
        two = [j for j in (i, self.race.best) if j is not None]
        count = max(len(self.runs.known(j, self.model)) for j in two)
        found = self.race.verdict(i, {j: self.runs.sample(j, self.model, count) for j in two})
        return Comparison(setting=self.settings[i].values, **vars(found))

    # -- its notes

    def _about(self, rows: Mapping[int, Row], verdicts: Mapping[int, Comparison]) -> list[str]:
        notes = []
        if not any(setting.is_random for setting in self.settings):
            notes.append("nothing in these settings is random, so one run of each stands for all seeds")
        same = [i for i, row in rows.items() if (one := row.bins_per_hour) is not None and one.low == one.high]
        if alike := [i for i in same if self.settings[i].is_random]:
            notes.append(f"all runs gave the same, so there is no interval, though seeds may differ: {self._words(alike)}")
        if self.race.best is not None and (ends := self._ends(self.settings[self.race.best])):
            notes.append(f"the best has {ends}: the end of what was tried")
        if hardly := self._hardly_worse(rows, verdicts):
            notes.append(f"worse for certain, but by less than {100 * self.options.within:g} %: {self._words(hardly)}")
        for i, row in rows.items():
            if row.jammed:
                notes.append(f"{self.settings[i].words or 'the scenario'}: {row.jammed} of {row.replications} runs jammed")
        return [*notes, *self._faults(rows)]

    def _row_ends(self, best: int | None) -> list[str]:
        """What the drives to the ends of rows cost with the best setting."""
        if best is None or self.settings[best].scenario.metres_per_bin is None:
            return []
        share = Bounds(lay_out(self.settings[best].scenario)).row_end_share
        return [f"drives to the ends of rows take {100 * share:.1f} % of a picker's time: exchanging bins inside rows could gain no more"]

    def _faults(self, rows: Iterable[int]) -> list[str]:
        """Of each setting in which an own class failed, the first fault: its figures are those of another rule."""
        notes = []
        for i in rows:
            records = [*self.runs.known(i, "fast"), *self.runs.known(i, "full")]
            if faulty := [record for record in records if record.faults]:
                first = f"seed {faulty[0].seed}: {faulty[0].faults.splitlines()[0]}"
                notes.append(f"{self.settings[i].words or 'the scenario'}: {len(faulty)} of {len(records)} runs had faults; {first}")
        return notes

    def _damaged(self) -> list[str]:
        store = self.runs.store
        if not store.damaged:
            return []
        first = next(iter(store.damaged.values()))
        return [f"{store.path}: {len(store.damaged)} of the runs in it were damaged, as by {first}: they are done again"]

    def _ends(self, best: Setting) -> str:
        """The numbers of a setting beyond which nothing was tried: "carriers=20"."""
        tried = {key: [value for value in values if isinstance(value, int | float)] for key, values in self.varied.items()}
        ends = [key for key, values in tried.items() if len(values) > 2 and best.values[key] in (min(values), max(values))]
        return ", ".join(f"{key}={best.values[key]}" for key in ends)

    def _hardly_worse(self, rows: Mapping[int, Row], verdicts: Mapping[int, Comparison]) -> list[int]:
        """The settings that are worse for certain, but hardly so: certain is not important."""
        if self.race.best is None or (best := getattr(rows[self.race.best], self.options.goal)) is None:
            return []
        most = self.options.within * abs(best.mean)
        return [i for i, verdict in verdicts.items() if verdict.is_told_apart and abs(verdict.difference.mean) < most]

    def _words(self, settings: Sequence[int], most: int = 5) -> str:
        return "; ".join(self.settings[i].words for i in settings[:most]) + (" and others" if len(settings) > most else "")


def row_of(setting: Setting, records: Sequence[RunRecord], confidence: float, lost: dict[str, float], check: Check | None) -> Row | None:
    """Return the line of a setting in the table, from its runs by one model; None if it has none."""
    if not records:
        return None
    harvested = [record for record in records if record.ended != "jammed"]
    rates = [record.bins_per_hour for record in harvested]
    seconds = [record.sim_seconds for record in harvested if record.horizon == "harvest"]
    costs = [cost for rate in rates if (cost := setting.cost_per_bin(rate)) is not None]
    count = max(1, len(harvested))
    return Row(
        setting=setting.values,
        model=records[0].model,
        replications=len(records),
        jammed=len(records) - len(harvested),
        bins_per_hour=interval(rates, confidence) if rates else None,
        harvest_seconds=interval(seconds, confidence) if seconds else None,
        cost_per_bin=interval(costs, confidence) if costs else None,
        picker_waiting_seconds=sum(record.picker_waiting_seconds for record in harvested) / count,
        carrier_utilisation=sum(record.carrier_utilisation for record in harvested) / count,
        bound_bins_per_hour=sum(record.bound_bins_per_hour for record in records) / len(records),
        bottleneck=records[0].bottleneck,
        lost_seconds=lost,
        check=check,
    )


def _losses(item: tuple[int, Scenario, float]) -> dict[str, float]:
    _, scenario, seconds = item
    return lost_seconds(lay_out(scenario), seconds)
