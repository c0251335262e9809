"""A benchmark of dispatch policies: how near are their harvests of twenty fixed orchards to the
shortest ones that are possible?

The score of a harvest is what is proven of the shortest one, as a share of the time that it took:
no policy has more than 1. A harvest that is never finished has 0. A policy's score is the mean over
the orchards, and that of an orchard the mean over its seeds.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from importlib.resources import files
from math import inf
from statistics import fmean

import orchard.optimum.schedule  # noqa: F401  # the workers need its extra: without it, this is told before they start
from orchard.behaviour.catalogue import check_plugins
from orchard.field.layout import lay_out
from orchard.field.scenario import DISPATCH_POLICIES, Scenario, check, with_changes
from orchard.field.yaml_file import values_of
from orchard.study.replications import Replications
from orchard.study.result import Model
from orchard.study.runs import software
from orchard.study.settings import Setting
from orchard.study.store import Store
from orchard.study.workers import Workers

ORCHARDS = "benchmark.yaml"
SEEDS = 3  # of each orchard in which something is random


def orchards() -> dict[str, Scenario]:
    """Return the orchards by name, in their order."""
    text = files("orchard.study.benchmark").joinpath(ORCHARDS).read_text("utf-8")
    values, _, _ = values_of(text, ORCHARDS)
    return {
        name: check(values["all"] | one, f"{ORCHARDS}: {name}")
        for name, one in values["orchards"].items()
    }


@dataclass(frozen=True, kw_only=True)
class Harvests:
    """The harvests of one orchard with one policy, by seed.

    An orchard in which nothing is random has one.
    """

    orchard: str
    policy: str
    proven: list[float]  # s; no harvest is shorter
    seconds: list[float | None]  # by the fast model; None: it was never finished
    checked: list[float | None]  # by the simulator, if it was asked

    @property
    def score(self) -> float:
        """The share that the proven time is of a harvest's, 0 to 1, mean."""
        return fmean(
            proven / seconds if seconds else 0.0
            for proven, seconds in zip(self.proven, self.seconds, strict=True)
        )

    @property
    def difference(self) -> float | None:
        """By how much the fast model's harvests are longer than the simulator's, as a share of
        these; None if that is not known.
        """
        fast, full = (
            [seconds for seconds in found if seconds] for found in (self.seconds, self.checked)
        )
        return sum(fast) / sum(full) - 1.0 if len(fast) == len(full) == len(self.proven) else None


@dataclass(frozen=True, kw_only=True)
class BenchmarkResult:
    """All harvests. `orchard benchmark --summary` writes them as JSON, with these names."""

    policy: str  # that was asked about
    scores: dict[str, float]  # policy -> its score, 0 to 1, the best first
    harvests: list[Harvests]
    notes: list[str]  # in the simulator: faults of own classes, and invariants that did not hold
    version: str

    def of(self, policy: str) -> list[Harvests]:
        return [one for one in self.harvests if one.policy == policy]


class Benchmark:
    """A benchmark that runs: the harvests of one policy and of all built-in ones by the fast model,
    and the bounds.
    """

    def __init__(
        self,
        policy: str,
        known: Mapping[str, Scenario],
        store: Store,
        workers: Workers,
        is_checked: bool = False,
        tell: Callable[[float], None] = lambda share: None,
        is_stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        """`known`: orchards by name. `is_checked`: the simulator does these harvests too.

        `tell` hears which share of all is done. Raises ScenarioError for a policy that cannot be
        used.
        """
        self.policy = policy
        self.known = known
        self.workers = workers
        self.tell = tell
        self.is_stopped = is_stopped
        policies = dict.fromkeys([policy, *DISPATCH_POLICIES])
        self.cells = [(name, of_cell) for of_cell in policies for name in known]
        self.settings = [
            Setting({}, with_changes(known[name], dispatch=of_cell)) for name, of_cell in self.cells
        ]
        # The settings of `policy` come first.
        self.own = range(len(known))
        for number in self.own:
            check_plugins(lay_out(self.settings[number].scenario))
        self.checked = self.own if is_checked else ()
        # Name of an orchard -> the setting that gives its bound: it is the same with each policy.
        self.bounds = {
            name: self.cells.index((name, scenario.dispatch)) for name, scenario in known.items()
        }
        # Where work is drawn, each seed has a bound of its own.
        self.drawn = [
            self.bounds[name] for name, scenario in known.items() if scenario.work_is_drawn
        ]
        self.wanted = self._count_runs()
        self.runs = Replications(
            self.settings, "harvest_seconds", "harvest", store, workers, self._hear, is_stopped
        )

    def _count_runs(self) -> int:
        """Return how many runs and bounds there are in all."""
        counts = [SEEDS if setting.is_random else 1 for setting in self.settings]
        bounds = len(self.known) + (SEEDS - 1) * len(self.drawn)
        return bounds + sum(counts) + sum(counts[number] for number in self.checked)

    def run(self) -> BenchmarkResult | None:
        """Do what the store does not know, and return all; None if it was stopped.

        Raises WorkersError, RunFailed or StoreFailed.
        """
        do = partial(self.runs.do, until=inf)
        is_known = do(range(len(self.settings)), "fast", SEEDS) and do(
            self.bounds.values(), "proven", 1
        )
        is_whole = is_known and do(self.drawn, "proven", SEEDS) and do(self.checked, "full", SEEDS)
        return self._result() if is_whole else None

    def _hear(self) -> None:
        """Tell how far it is.

        A run of the simulator counts as one of the fast model, so a check takes most of the time at
        the end.
        """
        self.tell(len(self.runs.records) / self.wanted)

    def _result(self) -> BenchmarkResult:
        harvests = [
            self._harvests(i, orchard, policy) for i, (orchard, policy) in enumerate(self.cells)
        ]
        of_policies = {
            one.policy: [other.score for other in harvests if other.policy == one.policy]
            for one in harvests
        }
        scores = sorted(
            ((policy, fmean(scores)) for policy, scores in of_policies.items()),
            key=lambda item: -item[1],
        )
        return BenchmarkResult(
            policy=self.policy,
            scores=dict(scores),
            harvests=harvests,
            notes=self._notes(),
            version=software(),
        )

    def _harvests(self, i: int, orchard: str, policy: str) -> Harvests:
        seconds, checked = (
            self._seconds(i, "fast"),
            self._seconds(i, "full") if i in self.checked else [],
        )
        proven = [record.sim_seconds for record in self.runs.known(self.bounds[orchard], "proven")]
        return Harvests(
            orchard=orchard,
            policy=policy,
            proven=(proven * len(seconds))[: len(seconds)],
            seconds=seconds,
            checked=checked,
        )

    def _seconds(self, i: int, model: Model) -> list[float | None]:
        return [
            None if record.ended == "jammed" else record.sim_seconds
            for record in self.runs.known(i, model)
        ]

    def _notes(self) -> list[str]:
        found = {self.cells[i][0]: self.runs.known(i, "full") for i in self.checked}
        return [
            f"{orchard}, seed {one.seed}: {line}"
            for orchard, records in found.items()
            for one in records
            for line in f"{one.violations}\n{one.faults}".split("\n")
            if line
        ]
