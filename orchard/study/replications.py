"""The replications of a study's settings: which runs are needed, and their results.

A result is in the store already, or a worker does the run. Settings are numbered from 0, and `i` is
such a number. Replication n of a setting has the scenario's seed plus n, so that all settings have
the same seeds.
"""

import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from statistics import fmean

from orchard.report.limits import rate_in_mean_rows
from orchard.study.comparing import interval
from orchard.study.result import Check, Goal, Horizon, Interval, Model
from orchard.study.runs import PlannedRun, RunFailed, RunRecord, outcome_of, software
from orchard.study.settings import Setting
from orchard.study.store import Store
from orchard.study.workers import WorkerDied, Workers, WorkersError


def raise_it(failure: RunFailed) -> None:
    """Let the first run that fails end all."""
    raise failure


def go_on(failure: RunFailed) -> None:
    """Let the other runs go on after one that failed: its setting is left out."""


@dataclass
class Replications:
    """The runs of all settings."""

    settings: Sequence[Setting]
    goal: Goal
    horizon: Horizon
    store: Store
    workers: Workers
    #: Is called after each run.
    heard: Callable[[], None]
    #: Whether the user has stopped the study.
    is_stopped: Callable[[], bool]
    #: Gets the error of each run that fails. If it returns, the other runs go on.
    failed: Callable[[RunFailed], None] = raise_it
    #: By the key of the run.
    records: dict[str, RunRecord] = field(default_factory=dict)
    #: The errors of runs that failed, by their keys. The store does not keep them: own code may
    #: have needed what is there the next time.
    failures: dict[str, RunFailed] = field(default_factory=dict)
    #: By model, how long this study waited for its runs, s: workers start, and work side by side.
    worked_seconds: dict[Model, float] = field(default_factory=lambda: defaultdict(float))
    #: By model, the runs that workers did in this time.
    runs_done: Counter[Model] = field(default_factory=Counter)
    #: Setting and model -> its runs by seed.
    _planned: dict[tuple[int, Model], list[PlannedRun]] = field(default_factory=dict)

    # -- doing runs

    def do(self, settings: Iterable[int], model: Model, count: int, until: float) -> bool:
        """Have `count` replications of each of these settings done, the first seeds first.

        Those that are in the store are not done again. A setting without chance needs only one.
        `until`: the end of the budget, as time.time(). Return whether all are done, or have failed.
        Raises WorkersError if they cannot be done, and what `failed` raises.
        """
        runs = self._plan(settings, model, count)
        self.records |= self.store.known(key for key in runs if key not in self.records)
        remaining = [run for key, run in runs.items() if not self._is_over(key)]
        remaining.sort(key=lambda run: run.scenario.seed)
        while remaining:
            try:
                self._do_runs(remaining, model, until)
                break
            except WorkerDied as death:
                self._fail(death.item, RunFailed(f"{death.item.name}: {death}"))
            remaining = [run for run in remaining if not self._is_over(run.key)]
        return all(map(self._is_over, runs))

    def _do_runs(self, runs: Sequence[PlannedRun], model: Model, until: float) -> None:
        """Have these runs done. Raises WorkersError, and what `failed` raises."""
        begun = time.time()
        work = partial(outcome_of, until=until)
        for run, outcome in self.workers.do(work, runs, lambda: self.goes_on(until)):
            if isinstance(outcome, RunFailed):
                self._fail(run, outcome)
            elif outcome is not None:
                self.runs_done[model] += 1
                self._keep(outcome)
            # None: the run was given up at the end of the budget.
            now = time.time()
            self.worked_seconds[model] += now - begun
            begun = now

    def _fail(self, run: PlannedRun, failure: RunFailed) -> None:
        """Note that a run has failed. Raises what `failed` raises."""
        self.failures[run.key] = failure
        self.failed(failure)

    def _is_over(self, key: str) -> bool:
        """Whether a run is done, or has failed. `key`: of the run."""
        return key in self.records or key in self.failures

    def _plan(self, settings: Iterable[int], model: Model, count: int) -> dict[str, PlannedRun]:
        """Return `count` runs of each of these settings: key of the run -> run."""
        runs: dict[str, PlannedRun] = {}
        for i in settings:
            setting = self.settings[i]
            planned = self._planned.setdefault((i, model), [])
            wanted = setting.seeds_that_differ(count)
            first_seed = setting.scenario.seed
            for seed in range(first_seed + len(planned), first_seed + wanted):
                planned.append(PlannedRun.of(setting.scenario, seed, model, self.horizon))
            for run in planned[:wanted]:
                runs[run.key] = run
        return runs

    def _keep(self, record: RunRecord) -> None:
        """Keep a run that a worker has done, and call `heard`.

        Raises WorkersError if the worker has another version of this software.
        """
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
        """Return about how long `more` further replications of each of these settings take, s.

        There are two estimates of a run, and the larger one counts: how long runs took by
        themselves, divided among the workers; and how long this study waited for each run, which
        includes the start of workers and a busy machine.
        """
        took = [record.wall_seconds for record in self.records.values() if record.model == model]
        seconds_of_run = 0.0
        if took:
            seconds_of_run = fmean(took) / self.workers.count
        if self.runs_done[model]:
            worked = self.worked_seconds[model] / self.runs_done[model]
            seconds_of_run = max(seconds_of_run, worked)
        return more * len(settings) * seconds_of_run

    # -- results

    def known(self, i: int, model: Model) -> list[RunRecord]:
        """Return the records of a setting, by seed, up to the first one that is missing."""
        records = []
        for run in self._planned.get((i, model), []):
            record = self.records.get(run.key)
            if record is None:
                break
            records.append(record)
        return records

    def has_jammed(self, i: int, model: Model) -> bool:
        """Whether a run of a setting jammed."""
        return any(record.is_jammed for record in self.known(i, model))

    def failure(self, i: int, model: Model) -> RunFailed | None:
        """Return the error of the first run of a setting that failed; None if none did."""
        for run in self._planned.get((i, model), []):
            if run.key in self.failures:
                return self.failures[run.key]
        return None

    def failing(self, model: Model) -> dict[int, RunFailed]:
        """Return the settings of which a run failed, each with the error of its first one.

        It goes through all settings, so take it once for all that you ask of it.
        """
        failing = {}
        for i in range(len(self.settings)):
            failure = self.failure(i, model)
            if failure is not None:
                failing[i] = failure
        return failing

    def raise_if_all_failed(self, model: Model) -> None:
        """Raise RunFailed, with the error of the first setting, if each setting has one."""
        failing = self.failing(model)
        if failing and len(failing) == len(self.settings):
            raise failing[0]

    @property
    def violations(self) -> list[str]:
        """The violations of invariants in all runs, each once, in the order of their words."""
        violations = set[str]()
        for record in self.records.values():
            violations.update(record.violations.splitlines())
        return sorted(violations)

    def value(self, i: int, record: RunRecord) -> float:
        """Return the value of the goal in a run."""
        if self.goal == "cost_per_bin":
            rate = record.bins_per_hour
            return self.settings[i].cost_per_bin(rate, record.counted_bins) or 0.0
        if self.goal == "harvest_seconds":
            return record.sim_seconds
        return shown_rate(self.settings[i], record)

    def limit(self, i: int, record: RunRecord) -> float:
        """Return the best value of the goal that the limit without traffic allows in a run."""
        rate = record.bound_bins_per_hour
        if self.goal == "cost_per_bin":
            return self.settings[i].cost_per_bin(rate, record.counted_bins) or 0.0
        if self.goal == "harvest_seconds":
            return 3600.0 * record.bins / rate
        return self.settings[i].limit.bins_per_hour

    def sample(self, i: int, model: Model, count: int) -> list[float]:
        """Return the values of the goal in the first `count` replications, by seed."""
        return [self.value(i, record) for record in self.first_records(i, model, count)]

    def first_records(self, i: int, model: Model, count: int) -> list[RunRecord]:
        """Return the records of the first `count` replications.

        The one run of a setting without chance stands for all seeds.
        """
        records = self.known(i, model)
        if self.settings[i].is_random:
            return records[:count]
        return records[:1] * count


def shown_rate(setting: Setting, record: RunRecord) -> float:
    """Return the bins an hour of a run as a study shows them, beside the limit of its setting.

    They are full bins, in rows that take their mean times.
    """
    rate = rate_in_mean_rows(record.bins_per_hour, record.bound_bins_per_hour, setting.limit)
    if record.horizon == "harvest":
        rate *= setting.full_share
    return rate


# Replications by the full model of each setting that is checked, and the number below which a note
# warns that they are too few.
CHECKS = 5
LEAST_CHECKS = 3


def confirmed(
    replications: Replications, settings: Sequence[int], confidence: float, until: float
) -> tuple[dict[int, Check], list[str]]:
    """Have the full model do harvests of some settings, with the seeds of the fast model.

    Return the check of each setting that got a run before `until`, and notes for the reader. A
    setting of which a run failed has no check: `Replications.failing` has its error.
    """
    replications.do(settings, "full", CHECKS, until)
    failing = replications.failing("full")
    checks = {}
    notes = []
    for i in settings:
        if i in failing:
            continue
        if replications.known(i, "full"):
            checks[i] = _check(replications, i, confidence)
        notes += _notes(replications.settings[i], checks.get(i))
    return checks, notes


def _check(replications: Replications, i: int, confidence: float) -> Check:
    """Return the check of a setting, from its runs by both models. It has one by the full model."""
    setting = replications.settings[i]
    full = replications.known(i, "full")
    fast = replications.known(i, "fast")
    if not setting.is_random:
        # Its one run stands for all seeds.
        fast = fast * len(full)
    # As the table shows them; and as they were, of the seeds that both models have.
    rates = []
    full_rates = []
    fast_rates = []
    for number, record in enumerate(full):
        if record.is_jammed:
            continue
        rates.append(shown_rate(setting, record))
        if number < len(fast):
            full_rates.append(record.bins_per_hour)
            fast_rates.append(fast[number].bins_per_hour)
    rate = Interval(mean=0.0, low=0.0, high=0.0)
    if rates:
        rate = interval(rates, confidence)
    difference = 0.0
    if fast_rates:
        difference = sum(full_rates) / sum(fast_rates) - 1.0
    return Check(
        bins_per_hour=rate,
        difference=difference,
        replications=len(full),
        jammed=len(full) - len(rates),
    )


def _notes(setting: Setting, check: Check | None) -> list[str]:
    """Return what a reader must know of the check of a setting; `check`: None if there is none."""
    words = setting.words or "the scenario"
    wanted = setting.seeds_that_differ(CHECKS)
    if check is None:
        return [
            f"the budget did not allow a run of {words} by the simulator: the fast model alone"
            " answers"
        ]
    notes = []
    if check.replications < wanted:
        note = (
            f"the budget allowed {check.replications} of {wanted} runs of {words} by the simulator"
        )
        if check.replications < min(LEAST_CHECKS, wanted):
            note += f"; {LEAST_CHECKS} are the least for a sound check"
        notes.append(note)
    if check.jammed:
        notes.append(
            f"{words}: {check.jammed} of {check.replications} runs jammed in the simulator, and"
            " none in the fast model"
        )
    return notes
