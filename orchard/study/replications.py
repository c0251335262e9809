"""The replications of a study's settings: which runs are planned, and what the store or the workers
gave.
"""

import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import takewhile
from statistics import fmean

from orchard.report.limits import rate_in_mean_rows
from orchard.study.comparing import interval
from orchard.study.result import Check, Goal, Horizon, Interval, Model
from orchard.study.runs import PlannedRun, RunRecord, do, software
from orchard.study.settings import Setting
from orchard.study.store import Store
from orchard.study.workers import Workers, WorkersError


@dataclass
class Replications:
    """The runs of all settings, which are numbers from 0.

    Replication n has the same seed in all of them.
    """

    settings: Sequence[Setting]
    goal: Goal
    horizon: Horizon
    store: Store
    workers: Workers
    heard: Callable[[], None]  # called after each run
    is_stopped: Callable[[], bool]
    records: dict[str, RunRecord] = field(default_factory=dict)
    # By model, the time in which workers did runs, s, with their start and all that they wait for.
    worked_seconds: dict[Model, float] = field(default_factory=lambda: defaultdict(float))
    # By model, the runs that they did in this time.
    runs_done: Counter[Model] = field(default_factory=Counter)
    _planned: dict[tuple[int, Model], list[PlannedRun]] = field(
        default_factory=dict
    )  # setting and model -> its runs by seed

    # -- doing runs

    def do(self, settings: Iterable[int], model: Model, count: int, until: float) -> bool:
        """Have so many replications of each of these settings done, with those that it has, seed by
        seed. Return whether all of them are.

        A setting without chance has one. Raises WorkersError or RunFailed if they cannot be done.
        """
        runs = self._plan(settings, model, count)
        self.records |= self.store.known(key for key in runs if key not in self.records)
        left = sorted(
            (run for key, run in runs.items() if key not in self.records),
            key=lambda run: run.scenario.seed,
        )
        begun = time.time()
        for _, record in self.workers.do(
            partial(do, until=until), left, lambda: self.goes_on(until)
        ):
            if record is not None:
                self.runs_done[model] += 1
                self._keep(record)
            now = time.time()
            self.worked_seconds[model] += now - begun
            begun = now
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
            raise WorkersError(
                f"a worker has version {record.version}, and this is {software()}: install the same"
                " there"
            )
        self.records[record.key] = record
        self.store.keep(record)
        self.heard()

    def goes_on(self, until: float) -> bool:
        """Whether there is time left, and the study is not stopped."""
        return time.time() < until and not self.is_stopped()

    def seconds_for(self, settings: Sequence[int], model: Model, more: float) -> float:
        """Return about how long so many more replications of each of these settings take.

        The runs of this study tell it: workers must start, and wait for a busy machine. A store
        knows only how long runs took by themselves. The larger figure is nearer to what is to come.
        """
        took = [record.wall_seconds for record in self.records.values() if record.model == model]
        a_run = fmean(took) / self.workers.count if took else 0.0
        if self.runs_done[model]:
            a_run = max(a_run, self.worked_seconds[model] / self.runs_done[model])
        return more * len(settings) * a_run

    # -- what they gave

    def known(self, i: int, model: Model) -> list[RunRecord]:
        """Return the records of a setting, by seed, up to the first one that is missing."""
        keys = (run.key for run in self._planned.get((i, model), []))
        return [self.records[key] for key in takewhile(self.records.__contains__, keys)]

    def value(self, i: int, record: RunRecord) -> float:
        """Return what a run says of the goal."""
        if self.goal == "cost_per_bin":
            rate = record.bins_per_hour
            return self.settings[i].cost_per_bin(rate, record.counted_bins) or 0.0
        if self.goal == "harvest_seconds":
            return record.sim_seconds
        return shown_rate(self.settings[i], record)

    def limit(self, i: int, record: RunRecord) -> float:
        """Return the best value of the goal that the limit without traffic allows a run."""
        rate = record.bound_bins_per_hour
        if self.goal == "cost_per_bin":
            return self.settings[i].cost_per_bin(rate, record.counted_bins) or 0.0
        if self.goal == "harvest_seconds":
            return 3600.0 * record.bins / rate
        return self.settings[i].limit.bins_per_hour

    def sample(self, i: int, model: Model, count: int) -> list[float]:
        """Return the values of the goal by seed.

        The one run of a setting without chance stands for all seeds.
        """
        values = [self.value(i, record) for record in self.known(i, model)[:count]]
        return values if self.settings[i].is_random else values[:1] * count


def shown_rate(setting: Setting, record: RunRecord) -> float:
    """Return the bins an hour of a run as a study shows them, beside the limit of its setting.

    They are full bins, in rows that take their mean times.
    """
    rate = rate_in_mean_rows(record.bins_per_hour, record.bound_bins_per_hour, setting.limit)
    if record.horizon == "harvest":
        rate *= setting.full_share
    return rate


CHECKS = 5  # replications by the full model of each of the best two
LEAST_CHECKS = 3  # fewer are told


def confirmed(
    replications: Replications, two: Sequence[int], confidence: float, until: float
) -> tuple[dict[int, Check], list[str]]:
    """Have the full model harvest two settings, on the seeds of the fast model, as far as the time
    allows. Return the checks, and notes.
    """
    replications.do(two, "full", CHECKS, until)
    checks = {i: _check(replications, i, confidence) for i in two if replications.known(i, "full")}
    return checks, [note for i in two for note in _notes(replications.settings[i], checks.get(i))]


def _check(replications: Replications, i: int, confidence: float) -> Check:
    full, fast = replications.known(i, "full"), replications.known(i, "fast")
    setting = replications.settings[i]
    rates = [shown_rate(setting, record) for record in full if record.ended != "jammed"]
    beside = fast if setting.is_random else fast * len(full)
    pairs = [
        (one, other) for one, other in zip(full, beside, strict=False) if one.ended != "jammed"
    ]
    found = interval(rates, confidence) if rates else Interval(mean=0.0, low=0.0, high=0.0)
    difference = (
        sum(one.bins_per_hour for one, _ in pairs) / sum(other.bins_per_hour for _, other in pairs)
        - 1.0
        if pairs
        else 0.0
    )
    return Check(
        bins_per_hour=found,
        difference=difference,
        replications=len(full),
        jammed=len(full) - len(rates),
    )


def _notes(setting: Setting, check: Check | None) -> list[str]:
    words, wanted = setting.words or "the scenario", CHECKS if setting.is_random else 1
    if check is None:
        return [
            f"the budget did not allow a run of {words} by the simulator: the fast model alone"
            " answers"
        ]
    notes = []
    if check.replications < wanted:
        least = (
            f"; {LEAST_CHECKS} are the least for a sound check"
            if check.replications < min(LEAST_CHECKS, wanted)
            else ""
        )
        notes.append(
            f"the budget allowed {check.replications} of {wanted} runs of {words} by the"
            f" simulator{least}"
        )
    if check.jammed:
        notes.append(
            f"{words}: {check.jammed} of {check.replications} runs jammed in the simulator, and"
            " none in the fast model"
        )
    return notes
