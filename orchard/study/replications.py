"""The replications of a study's settings: which runs are planned, and what the store or the workers gave."""

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import takewhile
from statistics import fmean

from orchard.study.racing import Race, interval
from orchard.study.result import Check, Goal, Horizon, Interval, Model
from orchard.study.runs import PlannedRun, RunRecord, do, software
from orchard.study.settings import Setting
from orchard.study.store import Store
from orchard.study.workers import Workers, WorkersError


@dataclass
class Replications:
    """The runs of all settings, which are numbers from 0. Replication n has the same seed in all of them."""

    settings: Sequence[Setting]
    goal: Goal
    horizon: Horizon
    store: Store
    workers: Workers
    heard: Callable[[], None]  # called after each run
    is_stopped: Callable[[], bool]
    records: dict[str, RunRecord] = field(default_factory=dict)
    _planned: dict[tuple[int, Model], list[PlannedRun]] = field(default_factory=dict)  # setting and model -> its runs by seed

    # -- doing runs

    def do(self, settings: Iterable[int], model: Model, count: int, until: float) -> bool:
        """Have so many replications of each of these settings done, with those that it has. Return whether all of them are.

        A setting without chance has one. Raises WorkersError or RunFailed if they cannot be done."""
        runs = self._plan(settings, model, count)
        self.records |= self.store.known(key for key in runs if key not in self.records)
        left = [run for key, run in runs.items() if key not in self.records]
        for _, record in self.workers.do(partial(do, until=until), left, lambda: self.goes_on(until)):
            if record is not None:
                self._keep(record)
        return all(key in self.records for key in runs)

    def _plan(self, settings: Iterable[int], model: Model, count: int) -> dict[str, PlannedRun]:
        runs: list[PlannedRun] = []
        for i in settings:
            scenario, planned = self.settings[i].scenario, self._planned.setdefault((i, model), [])
            wanted = count if self.settings[i].is_random else 1
            seeds = range(scenario.seed + len(planned), scenario.seed + wanted)
            planned += [PlannedRun.of(scenario, seed, model, self.horizon) for seed in seeds]
            runs += planned[:wanted]
        return {run.key: run for run in runs}

    def _keep(self, record: RunRecord) -> None:
        if record.version != software():
            raise WorkersError(f"a worker has version {record.version}, and this is {software()}: install the same there")
        self.records[record.key] = record
        self.store.keep(record)
        self.heard()

    def goes_on(self, until: float) -> bool:
        """Whether there is time left, and the study is not stopped."""
        return time.time() < until and not self.is_stopped()

    def fits(self, settings: Iterable[int], model: Model, count: int, until: float) -> bool:
        """Whether so many replications of these settings would be done in time, as far as the runs so far tell."""
        took = [record.wall_seconds for record in self.records.values() if record.model == model]
        runs = self._plan(settings, model, count)
        left = len(runs.keys() - self.records.keys() - self.store.known(runs).keys())
        rounds = -(-left // self.workers.count)
        return self.goes_on(until) and (not took or time.time() + rounds * sum(took) / len(took) <= until)

    # -- what they gave

    def known(self, i: int, model: Model) -> list[RunRecord]:
        """Return the records of a setting, by seed, up to the first one that is missing."""
        keys = (run.key for run in self._planned.get((i, model), []))
        return [self.records[key] for key in takewhile(self.records.__contains__, keys)]

    def harvested(self, i: int, model: Model) -> list[RunRecord]:
        """Return those that did not jam."""
        return [record for record in self.known(i, model) if record.ended != "jammed"]

    def value(self, i: int, record: RunRecord) -> float:
        """Return what a run says of the goal."""
        if self.goal == "cost_per_bin":
            return self.settings[i].cost_per_bin(record.bins_per_hour) or 0.0
        return record.sim_seconds if self.goal == "harvest_seconds" else record.bins_per_hour

    def sample(self, i: int, model: Model, count: int) -> list[float]:
        """Return the values of the goal by seed. The one run of a setting without chance stands for all seeds."""
        values = [self.value(i, record) for record in self.known(i, model)[:count] if record.ended != "jammed"]
        return values if self.settings[i].is_random else values[:1] * count

    def mean(self, i: int, model: Model, value: Callable[[RunRecord], float]) -> float:
        """Return the mean of a value over the runs that did not jam."""
        return fmean(map(value, self.harvested(i, model)))


CHECKS = 5  # replications by the full model of each of the best two
LEAST_CHECKS = 3  # fewer are told


class Confirmation:
    """The full model harvests the best two settings, on the seeds of the fast model: `checks` and `notes` tell."""

    def __init__(self, race: Race, replications: Replications) -> None:
        self.race, self.replications, self.settings = race, replications, replications.settings
        self.checks: dict[int, Check] = {}
        self.notes: list[str] = []

    def run(self, until: float) -> None:
        """Have the full model harvest, as far as the time allows."""
        if self.race.best is None or self.replications.is_stopped():
            return
        two = [self.race.best, *self._runner_up()]
        wanted = CHECKS if any(self.settings[i].is_random for i in two) else 1
        step = max(1, self.replications.workers.count // len(two))
        for count in (*range(step, wanted, step), wanted):
            if count > step and not self.replications.fits(two, "full", count, until):
                break
            if not self.replications.do(two, "full", count, until):
                break
        for i in two:
            if self.replications.known(i, "full"):
                self.checks[i] = self._check(i)
            self.notes += self._notes(i, wanted)

    def _runner_up(self) -> list[int]:
        """The second best setting; the cheapest, if there are prices, of those that cannot be told apart from the best."""
        race, mean = self.race, self.replications.mean
        left = [i for i in race.left if i != race.best]
        others = left or [i for i in race.out if i not in race.jammed]
        if left and self.settings[0].has_prices:
            return [min(left, key=lambda i: mean(i, "fast", lambda record: self.settings[i].cost_per_bin(record.bins_per_hour) or 0.0))]
        sign = -1.0 if race.is_max else 1.0
        return sorted(others, key=lambda i: sign * mean(i, "fast", partial(self.replications.value, i)))[:1]

    def _check(self, i: int) -> Check:
        full, fast = self.replications.known(i, "full"), self.replications.known(i, "fast")
        rates = [record.bins_per_hour for record in full if record.ended != "jammed"]
        beside = fast if self.settings[i].is_random else fast * len(full)
        pairs = [(one, other) for one, other in zip(full, beside, strict=False) if one.ended != "jammed"]
        found = interval(rates, self.race.confidence) if rates else Interval(mean=0.0, low=0.0, high=0.0)
        difference = 1.0 - sum(other.bins_per_hour for _, other in pairs) / sum(one.bins_per_hour for one, _ in pairs) if pairs else 0.0
        return Check(bins_per_hour=found, difference=difference, replications=len(full), jammed=len(full) - len(rates))

    def _notes(self, i: int, wanted: int) -> list[str]:
        words, check, notes = self.settings[i].words or "the scenario", self.checks.get(i), []
        if check is None:
            return [f"the budget did not allow a run of {words} by the simulator: the fast model alone answers"]
        if check.replications < wanted:
            least = f"; {LEAST_CHECKS} are the least for a sound check" if check.replications < min(LEAST_CHECKS, wanted) else ""
            notes.append(f"the budget allowed {check.replications} of {wanted} runs of {words} by the simulator{least}")
        if check.jammed:
            notes.append(f"{words}: {check.jammed} of {check.replications} runs jammed in the simulator, and none in the fast model")
        return notes
