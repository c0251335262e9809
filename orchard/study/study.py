"""A study: which of many settings of a scenario is best, by how much, and with what confidence."""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

from orchard.agents.catalogue import check_plugins
from orchard.field.layout import lay_out
from orchard.field.problems import Problem, ScenarioError
from orchard.field.scenario import Scenario
from orchard.folders import runs_folder
from orchard.report.losses import lost_seconds
from orchard.study.answer import sentence
from orchard.study.racing import LOOKS, Race, StoppedBy
from orchard.study.result import Check, Comparison, Goal, Interval, Model, Row, StudyResult
from orchard.study.runs import Horizon, Record, Run, do, own_classes, software
from orchard.study.settings import Setting, settings_of
from orchard.study.statistics import interval
from orchard.study.store import Store
from orchard.study.workers import Processes, Scheduler, Workers

Models = Literal["fast", "full", "both"]

TOLD = 0.5  # s between two partial results
RACE_SHARE = 0.5  # of the budget, which the fast model may use if the full one is to confirm
LOSSES_SHARE = 0.9  # of the budget, after which no more losses are split: the answer is to be there in time
CHECKS = 5  # replications by the full model of each of the best two
LEAST_CHECKS = 3  # fewer are told
STORE = "studies.db"


@dataclass(frozen=True, kw_only=True)
class StudyOptions:
    """How a study is done. The command `orchard study` has an option for each field."""

    horizon: Horizon = "harvest"
    goal: Goal = "bins_per_hour"
    confidence: float = 0.95
    within: float = 0.01  # half the width of an interval, as a share of its mean, at which a setting needs no more replications
    budget_seconds: float = 60.0
    model: Models = "both"
    workers: int | None = None  # processes here; None: one per core
    scheduler: str | None = None  # address of a dask.distributed scheduler, which gets the runs instead
    store: Path | None = None  # None: studies.db in the folder of runs
    anew: bool = False  # forget what a store of another version holds


def study(
    scenario: Scenario,
    varied: Mapping[str, Sequence[Any]],
    options: StudyOptions,
    tell: Callable[[StudyResult], None] = lambda partial: None,
    is_stopped: Callable[[], bool] = lambda: False,
) -> StudyResult:
    """Compare all settings of a scenario, and return the answer.

    `varied`: dotted path of the scenario -> its values; each combination is a setting. `tell` hears what is known so far, at most
    twice a second. `is_stopped` is asked several times a second; when it says True, the study returns what it knows.

    The same study gives the same table, whatever the workers, their number and their order, and whatever the store knows already; only
    what the budget allows depends on the machine.

    Raises ScenarioError or StoreError for what a user can correct; WorkersError or RunFailed if the runs cannot be done.
    """
    settings = settings_of(scenario, varied)
    check_options(settings, options)
    with Store(options.store or runs_folder() / STORE, options.anew) as store, _workers(options) as workers:
        return _Study(scenario, varied, settings, options, store, workers, tell, is_stopped).run()


def _workers(options: StudyOptions) -> Workers:
    return Scheduler(options.scheduler) if options.scheduler else Processes(options.workers)


def check_options(settings: Sequence[Setting], options: StudyOptions) -> None:
    """Check what the options ask of the settings. Raises ScenarioError with all problems."""
    problems = []
    if options.goal == "cost_per_bin" and not all(setting.has_prices for setting in settings):
        problems.append(
            Problem("--goal cost_per_bin", "needs a price: picker_per_hour, carrier_per_hour, overhead_per_hour or per_bin", "prices")
        )
    if options.horizon == "long" and options.goal == "harvest_seconds":
        problems.append(Problem("--goal harvest_seconds", "a long run has no end; choose --horizon harvest, or another goal"))
    if options.horizon == "long" and options.model == "full":
        problems.append(Problem("--horizon long", "only the fast model can tell the long run; leave out --model full"))
    if options.model != "full" and (own := sorted({name for one in settings for name in _own_agents(one.scenario)})):
        text = f"only the full model knows agents of your own ({', '.join(own)}); choose --model full"
        problems.append(Problem(f"--model {options.model}", text, "agents"))
    if problems:
        raise ScenarioError(problems)
    for classes, setting in {own_classes(setting.scenario): setting for setting in settings}.items():
        if classes:
            check_plugins(lay_out(setting.scenario))


def _own_agents(scenario: Scenario) -> list[str]:
    return [*scenario.agents, *scenario.agents_without_body]


class _Study:
    """A study that runs: the records that are known, and the race that they decide."""

    def __init__(
        self,
        scenario: Scenario,
        varied: Mapping[str, Sequence[Any]],
        settings: list[Setting],
        options: StudyOptions,
        store: Store,
        workers: Workers,
        tell: Callable[[StudyResult], None],
        is_stopped: Callable[[], bool],
    ) -> None:
        self.scenario, self.varied, self.settings, self.options = scenario, varied, settings, options
        self.store, self.workers, self.tell, self.is_stopped = store, workers, tell, is_stopped
        self.model: Model = "full" if options.model == "full" else "fast"
        self.race = Race(len(settings), options.goal == "bins_per_hour", options.confidence, options.within)
        self.records: dict[str, Record] = {}
        self.planned: dict[tuple[int, Model], list[str]] = {}  # setting and model -> keys of its runs by seed
        self.lost: dict[int, dict[str, float]] = {}
        self.checks: dict[int, Check] = {}
        self.notes: list[str] = []
        self.begun, self.told = time.time(), 0.0

    @property
    def end(self) -> float:
        """When the budget is used."""
        return self.begun + self.options.budget_seconds

    def run(self) -> StudyResult:
        confirms = self.options.model == "both" and self.options.horizon == "harvest"
        self._race(self.begun + self.options.budget_seconds * (RACE_SHARE if confirms else 1.0))
        if confirms:
            self._confirm()
        elif self.options.model == "both":
            self.notes.append("the simulator has no long run: the fast model alone answers")
        self._split_losses()
        return self._result()

    # -- runs

    def _do(self, settings: Iterable[int], model: Model, first: int, last: int, until: float) -> bool:
        """Have the replications from `first` up to, not with, `last` of these settings done. Return whether all of them are."""
        runs: dict[str, Run] = {}
        for seed in range(first, last):
            for i in settings:
                keys = self.planned.setdefault((i, model), [])
                if seed == len(keys) and (seed == 0 or self.settings[i].is_random):
                    run = Run.of(self.settings[i].scenario, self.scenario.seed + seed, model, self.options.horizon)
                    runs[run.key] = run
                    keys.append(run.key)
        self.records |= self.store.known(runs)
        left = [run for key, run in runs.items() if key not in self.records]
        for _, record in self.workers.do(partial(do, until=until), left, lambda: self._goes_on(until)):
            if record is not None:
                self._keep(record)
        return all(key in self.records for key in runs)

    def _keep(self, record: Record) -> None:
        if record.version != software():
            raise ScenarioError(
                [Problem(f"--scheduler {self.options.scheduler}", f"a worker there has version {record.version}, and this is {software()}")]
            )
        self.records[record.key] = record
        self.store.keep(record)
        if time.time() - self.told > TOLD:
            self.tell(self._result())
            self.told = time.time()

    def _goes_on(self, until: float) -> bool:
        return time.time() < until and not self.is_stopped()

    def _fits(self, count: int, model: Model, until: float) -> bool:
        """Whether so many more runs would end in time, as far as the runs so far tell."""
        took = [record.wall_seconds for record in self.records.values() if record.model == model]
        rounds = -(-count // self.workers.count)
        return self._goes_on(until) and (not took or time.time() + rounds * sum(took) / len(took) <= until)

    def _known(self, i: int, model: Model) -> list[Record]:
        """The records of a setting, by seed, up to the first one that is missing."""
        found = []
        for key in self.planned.get((i, model), []):
            if key not in self.records:
                break
            found.append(self.records[key])
        return found

    # -- the race

    def _race(self, until: float) -> None:
        """Do replications of all settings that are left, look by look, until the race or the time is over.

        One of each comes first: a setting that jams gets no more.
        """
        done = 0
        for look in (1, *LOOKS):
            left = list(self.race.left)
            more = [i for i in left if done == 0 or self.settings[i].is_random]
            if done >= LOOKS[0] and not self._fits(len(more) * (look - done), self.model, until):
                return self._end_race()
            is_whole = self._do(more, self.model, done, look, until)
            self.race.jam([i for i in left if any(record.ended == "jammed" for record in self._known(i, self.model))])
            if self.race.why is None and not is_whole:
                return self._end_race()
            if look >= LOOKS[0]:
                self.race.look(self._samples(look), look == LOOKS[-1])
            if self.race.why is not None:
                return None
            done = look
        return None

    def _end_race(self) -> None:
        """End the race because of the budget or the user, after a last look at the seeds that all settings have that are left."""
        why: StoppedBy = "stopped" if self.is_stopped() else "budget"
        missing = [i for i in self.race.left if not self._known(i, self.model)]
        self.race.left = [i for i in self.race.left if i not in missing]
        if missing:
            self.notes.append(
                f"the budget did not allow a run of {len(missing)} settings, {self._words(missing)}: they are not in the table"
            )
        random = [i for i in self.race.left if self.settings[i].is_random]
        common = min((len(self._known(i, self.model)) for i in random), default=LOOKS[0])
        if self.race.left:
            self.race.look(self._samples(common))
        if random and common < LOOKS[0]:
            self.notes.append(f"the budget allowed {common} replications of each setting; {LOOKS[0]} are the least for a sound answer")
        self.race.why = why

    def _samples(self, count: int) -> dict[int, list[float]]:
        """The values of the goal of each setting that is left, by seed. One run of a setting without chance stands for all seeds."""
        return {i: self._sample(i, count) for i in self.race.left}

    def _sample(self, i: int, count: int) -> list[float]:
        values = [self._value(i, record) for record in self._known(i, self.model)[:count] if record.ended != "jammed"]
        return values if self.settings[i].is_random else values[:1] * count

    def _value(self, i: int, record: Record) -> float:
        """What a run says of the goal."""
        if self.options.goal == "harvest_seconds":
            return record.sim_seconds
        if self.options.goal == "bins_per_hour":
            return record.bins_per_hour
        cost = self.settings[i].cost_per_bin(record.bins_per_hour)
        assert cost is not None
        return cost

    # -- the full model's word

    def _confirm(self) -> None:
        """Have the full model harvest the best two, on the seeds of the fast model."""
        if self.race.best is None or self.is_stopped():
            return
        two = [self.race.best, *self._runner_up()]
        wanted = CHECKS if any(self.settings[i].is_random for i in two) else 1
        step = max(1, self.workers.count // len(two))
        for seed in range(0, wanted, step):
            if seed and not self._fits(len(two) * min(step, wanted - seed), "full", self.end):
                break
            if not self._do(two, "full", seed, min(wanted, seed + step), self.end):
                break
        for i in two:
            self._check(i)
        self._compare_models(two, wanted)

    def _runner_up(self) -> list[int]:
        """The setting that is best after the best one: of those that cannot be told apart the cheapest if there are prices."""
        race, best = self.race, self.race.best
        left = [i for i in race.left if i != best]
        others = left or [i for i in race.out if i not in race.jammed]
        if left and self.settings[0].has_prices:
            return [min(left, key=lambda i: self._mean(i, lambda record: self.settings[i].cost_per_bin(record.bins_per_hour) or 0.0))]
        return sorted(others, key=lambda i: self._mean(i, partial(self._value, i)) * (-1.0 if race.is_max else 1.0))[:1]

    def _mean(self, i: int, value: Callable[[Record], float]) -> float:
        values = [value(record) for record in self._known(i, self.model) if record.ended != "jammed"]
        return sum(values) / len(values)

    def _check(self, i: int) -> None:
        full, fast = self._known(i, "full"), self._known(i, "fast")
        if not full:
            return
        rates = [record.bins_per_hour for record in full if record.ended != "jammed"]
        pairs = [
            (a, b) for a, b in zip(full, fast if self.settings[i].is_random else fast * len(full), strict=False) if a.ended != "jammed"
        ]
        found = interval(rates, self.options.confidence) if rates else Interval(mean=0.0, low=0.0, high=0.0)
        difference = 1.0 - sum(b.bins_per_hour for _, b in pairs) / sum(a.bins_per_hour for a, _ in pairs) if pairs else 0.0
        self.checks[i] = Check(bins_per_hour=found, difference=difference, replications=len(full), jammed=len(full) - len(rates))

    def _compare_models(self, two: Sequence[int], wanted: int) -> None:
        """Note what the full model says against the fast one, and what the budget did not allow."""
        for i in two:
            words, check = self.settings[i].words or "the scenario", self.checks.get(i)
            if check is None:
                self.notes.append(f"the budget did not allow a run of {words} by the simulator: the fast model alone answers")
                continue
            if check.replications < wanted:
                least = f"; {LEAST_CHECKS} are the least for a sound check" if check.replications < min(LEAST_CHECKS, wanted) else ""
                self.notes.append(f"the budget allowed {check.replications} of {wanted} runs of {words} by the simulator{least}")
            if check.jammed:
                self.notes.append(
                    f"{words}: {check.jammed} of {check.replications} runs jammed in the simulator, and none in the fast model"
                )
            if check.jammed < check.replications:
                less = "less" if check.difference < 0 else "more"
                rate = f"{check.bins_per_hour.mean:.1f} bins/h"
                self.notes.append(f"{words}: the simulator has {rate}, {100 * abs(check.difference):.1f} % {less} than the fast model")
        if len(two) == 2:
            self._compare_order(*two)

    def _compare_order(self, best: int, second: int) -> None:
        """Note if the full model prefers the second setting."""
        pairs = [
            (self._value(best, one), self._value(second, other))
            for one, other in zip(self._known(best, "full"), self._known(second, "full"), strict=False)
            if "jammed" not in (one.ended, other.ended)
        ]
        means = [sum(values) / len(values) for values in zip(*pairs, strict=True)]
        if means and (means[1] > means[0] if self.race.is_max else means[1] < means[0]):
            words = f"{self.settings[second].words} ({means[1]:.4g}) to {self.settings[best].words} ({means[0]:.4g})"
            self.notes.append(f"the simulator prefers {words}: the models disagree about the order of the best two")

    # -- the result

    def _split_losses(self) -> None:
        """Split what the harvests of each setting lost, the best settings first, as far as the budget allows."""
        if self.options.horizon == "long" or self.is_stopped():
            return
        until = self.begun + LOSSES_SHARE * self.options.budget_seconds
        known = [i for i in range(len(self.settings)) if any(record.ended != "jammed" for record in self._known(i, self.model))]
        first = [i for i in (self.race.best, *self.race.left) if i in known]
        items = [
            (i, self.settings[i].scenario, self._mean(i, lambda record: record.sim_seconds))
            for i in dict.fromkeys([*first, *known])
            if i is not None
        ]
        self.lost = {item[0]: parts for item, parts in self.workers.do(_losses, items, lambda: self._goes_on(until))}
        if len(self.lost) < len(items):
            self.notes.append(f"the budget did not allow to split what was lost in {len(items) - len(self.lost)} of {len(items)} settings")

    def _words(self, settings: Sequence[int], most: int = 5) -> str:
        return "; ".join(self.settings[i].words for i in settings[:most]) + (" and others" if len(settings) > most else "")

    def _result(self) -> StudyResult:
        """Return what is known now."""
        rows = {i: row for i in range(len(self.settings)) if (row := self._row(i)) is not None}
        best = self.race.best if self.race.best is not None else self._present_best(rows)
        is_over = self.race.why is not None
        compared = [i for i in rows if i != best and i not in self.race.jammed] if self.race.best is not None else []
        verdicts = {i: self._verdict(i) for i in compared}
        jammed = [
            f"{self.settings[i].words or 'the scenario'}: {row.jammed} of {row.replications} runs jammed"
            for i, row in rows.items()
            if row.jammed
        ]
        result = StudyResult(
            answer="",
            best=None if best is None else self.settings[best].values,
            indistinguishable=[self.settings[i].values for i in self.race.left if i != best and is_over],
            table=list(rows.values()),
            comparisons=[verdicts[i] for i in compared],
            goal=self.options.goal,
            horizon=self.options.horizon,
            confidence=self.options.confidence,
            scenario=self.scenario.model_dump(),
            varied={key: list(values) for key, values in self.varied.items()},
            wall_seconds=time.time() - self.begun,
            stopped_by=self.race.why or "budget",
            notes=[*self._about_chance(), *self._about_little(verdicts, rows), *jammed, *self.notes],
            version=software(),
            violations=sorted({f"{line}" for record in self.records.values() for line in record.violations.splitlines()}),
        )
        return replace(result, answer=sentence(result))

    def _about_chance(self) -> list[str]:
        if any(setting.is_random for setting in self.settings):
            return []
        return ["nothing in these settings is random, so one run of each stands for all seeds"]

    def _about_little(self, verdicts: Mapping[int, Comparison], rows: Mapping[int, Row]) -> list[str]:
        """Which settings are worse for certain, but hardly so: certain is not important."""
        if self.race.best is None or (best := getattr(rows[self.race.best], self.options.goal)) is None:
            return []
        most = self.options.within * abs(best.mean)
        hardly = [i for i, verdict in verdicts.items() if verdict.is_told_apart and abs(verdict.difference.mean) < most]
        return [f"worse for certain, but by less than {100 * self.options.within:g} %: {self._words(hardly)}"] if hardly else []

    def _present_best(self, rows: Mapping[int, Row]) -> int | None:
        """The setting with the best mean so far, before the first look."""
        means = {i: one.mean for i, row in rows.items() if not row.jammed and (one := getattr(row, self.options.goal)) is not None}
        return (max if self.race.is_max else min)(means, key=lambda i: means[i]) if means else None

    def _verdict(self, i: int) -> Comparison:
        best = self.race.best
        assert best is not None
        count = max(len(self._known(j, self.model)) for j in (i, best))
        found = self.race.verdict(i, {j: self._sample(j, count) for j in (i, best)})
        setting = self.settings[i].values
        return Comparison(setting=setting, difference=found.difference, p_value=found.p_value, is_told_apart=found.is_told_apart)

    def _row(self, i: int) -> Row | None:
        """The line of a setting in the table; None if it has no run yet."""
        records = self._known(i, self.model)
        if not records:
            return None
        harvested, setting, confidence = (
            [record for record in records if record.ended != "jammed"],
            self.settings[i],
            self.options.confidence,
        )
        rates = [record.bins_per_hour for record in harvested]
        costs = [cost for rate in rates if (cost := setting.cost_per_bin(rate)) is not None]
        seconds = [record.sim_seconds for record in harvested]
        count = max(1, len(harvested))
        return Row(
            setting=setting.values,
            model=self.model,
            replications=len(records),
            jammed=len(records) - len(harvested),
            bins_per_hour=interval(rates, confidence) if rates else None,
            harvest_seconds=interval(seconds, confidence) if seconds and self.options.horizon == "harvest" else None,
            cost_per_bin=interval(costs, confidence) if costs else None,
            picker_waiting_seconds=sum(record.picker_waiting_seconds for record in harvested) / count,
            carrier_utilisation=sum(record.carrier_utilisation for record in harvested) / count,
            bound_bins_per_hour=sum(record.bound_bins_per_hour for record in records) / len(records),
            bottleneck=records[0].bottleneck,
            lost_seconds=self.lost.get(i, {}),
            check=self.checks.get(i),
        )


def _losses(item: tuple[int, Scenario, float]) -> dict[str, float]:
    """In a worker: split the length of a setting's harvests."""
    _, scenario, seconds = item
    return lost_seconds(lay_out(scenario), seconds)
