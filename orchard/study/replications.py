"""The replications of a study's settings: which runs are planned, and what they gave. The store is asked first, then the workers."""

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import takewhile
from statistics import fmean

from orchard.study.result import Goal, Model
from orchard.study.runs import Horizon, PlannedRun, RunRecord, do, software
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
        """Return so many runs of each of these settings, by key."""
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
