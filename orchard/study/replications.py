"""The replications of a study's settings: which runs are planned, and what they gave. The store is asked first, then the workers."""

import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial

from orchard.study.result import Goal, Model
from orchard.study.runs import Horizon, PlannedRun, RunRecord, do, software
from orchard.study.settings import Setting
from orchard.study.store import Store
from orchard.study.workers import Workers, WorkersError


class Replications:
    """The runs of all settings, which are numbers from 0. Replication n has the same seed in all of them."""

    def __init__(
        self,
        settings: Sequence[Setting],
        goal: Goal,
        horizon: Horizon,
        store: Store,
        workers: Workers,
        heard: Callable[[], None],
        is_stopped: Callable[[], bool],
    ) -> None:
        """`heard` is called after each run."""
        self.settings, self.goal, self.horizon = settings, goal, horizon
        self.store, self.workers, self.heard, self.is_stopped = store, workers, heard, is_stopped
        self.records: dict[str, RunRecord] = {}
        self._planned: dict[tuple[int, Model], list[PlannedRun]] = {}  # setting and model -> its runs by seed

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
        found = []
        for run in self._planned.get((i, model), []):
            if run.key not in self.records:
                break
            found.append(self.records[run.key])
        return found

    def harvested(self, i: int, model: Model) -> list[RunRecord]:
        """Return those that did not jam."""
        return [record for record in self.known(i, model) if record.ended != "jammed"]

    def value(self, i: int, record: RunRecord) -> float:
        """Return what a run says of the goal."""
        if self.goal == "harvest_seconds":
            return record.sim_seconds
        if self.goal == "bins_per_hour":
            return record.bins_per_hour
        cost = self.settings[i].cost_per_bin(record.bins_per_hour)
        assert cost is not None
        return cost

    def sample(self, i: int, model: Model, count: int) -> list[float]:
        """Return the values of the goal by seed. The one run of a setting without chance stands for all seeds."""
        values = [self.value(i, record) for record in self.known(i, model)[:count] if record.ended != "jammed"]
        return values if self.settings[i].is_random else values[:1] * count

    def mean(self, i: int, model: Model, value: Callable[[RunRecord], float]) -> float:
        """Return the mean of a value over the runs that did not jam."""
        values = [value(record) for record in self.harvested(i, model)]
        return sum(values) / len(values)
