"""A benchmark of dispatch policies: how near are their harvests of fixed orchards to the shortest
ones that are possible?

The score of a harvest is what is proven of the shortest one, as a share of the time that it took:
no policy has more than 1. A harvest that is never finished has 0, and so has one for which a policy
of the user's own took too long to decide. A policy's score is the mean over the orchards, and that
of an orchard the mean over its seeds.

A policy of the user's own is asked in a process of its own, which gets only what robots report. The
built-in ones run as in a study: they know no more.
"""

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf, sqrt
from statistics import fmean, variance

from orchard.field.layout import lay_out
from orchard.field.scenario import DISPATCH_POLICIES, with_changes
from orchard.study.benchmark.asked import Limits
from orchard.study.benchmark.instances import Instance
from orchard.study.benchmark.own_harvests import OwnHarvest, OwnHarvests, OwnResult, check_policy
from orchard.study.benchmark.play import built_in_harvest
from orchard.study.benchmark.submission import Submission, splits_of, submission_of
from orchard.study.replications import Replications
from orchard.study.result import Model
from orchard.study.runs import RunFailed, software
from orchard.study.settings import Setting
from orchard.study.store import Store
from orchard.study.workers import Workers

ROUNDING = 1e-6  # s
USUAL_LIMITS = Limits()


class ShorterThanProven(RunFailed):
    """Raised for a harvest that cannot be: the bound, the model or the recording is wrong."""


@dataclass(frozen=True, kw_only=True)
class Harvests:
    """The harvests of one orchard with one policy. Each list has a value for each seed.

    An orchard in which nothing is random has one seed.
    """

    orchard: str
    policy: str
    #: The time below which it is proven that no harvest can be, s.
    proven: list[float]
    #: The length by the fast model, s; None: the harvest was never finished.
    seconds: list[float | None]
    #: The same by the simulator; [] if it did none.
    checked: list[float | None]

    def __post_init__(self) -> None:
        for proven, seconds in zip(self.proven, self.seconds, strict=True):
            if seconds is not None and seconds < proven - ROUNDING:
                raise ShorterThanProven(
                    f"{self.orchard}: a harvest with {self.policy} took {seconds:.1f} s, and it is"
                    f" proven that none takes less than {proven:.1f} s; no score is given: please"
                    " report it, with the policy"
                )

    @property
    def score(self) -> float:
        """The mean of `shares`, 0 to 1."""
        return fmean(self.shares)

    @property
    def shares(self) -> list[float]:
        """The score of each harvest: the proven time over its length; 0 if never finished."""
        shares = []
        for proven, seconds in zip(self.proven, self.seconds, strict=True):
            if seconds:
                shares.append(proven / seconds)
            else:
                shares.append(0.0)
        return shares

    @property
    def difference(self) -> float | None:
        """By how much the fast model's harvests are longer than the simulator's, as a share of
        these; None if that is not known.
        """
        fast = list(filter(None, self.seconds))
        full = list(filter(None, self.checked))
        if not len(fast) == len(full) == len(self.proven):
            return None
        return sum(fast) / sum(full) - 1.0


@dataclass(frozen=True, kw_only=True)
class BenchmarkResult:
    """All harvests. `orchard benchmark --summary` writes them as JSON, with these names."""

    #: The policy that the user has asked about.
    policy: str
    #: Policy -> its score, 0 to 1, the best first.
    scores: dict[str, float]
    harvests: list[Harvests]
    #: Faults of own classes in the simulator, and invariants that did not hold, a line each.
    notes: list[str]
    # A line for each harvest for which the policy took too long.
    too_slow: list[str] = field(default_factory=list)
    # The splits of the orchards. `train` and `test` are public, so a policy may know them.
    splits: list[str] = field(default_factory=list)
    version: str

    def of(self, policy: str) -> list[Harvests]:
        """Return the harvests with a policy, by orchard."""
        return [harvests for harvests in self.harvests if harvests.policy == policy]

    def with_submission(self, submission: Submission) -> "BenchmarkResult":
        """Return this result with the policy of a submission beside the others.

        The submission must have been replayed, have all harvests of these orchards, and be of a
        policy that is not here yet.
        """
        by_orchard = defaultdict(list)
        for harvest in sorted(submission.harvests, key=lambda harvest: harvest.seed):
            by_orchard[harvest.instance].append(harvest.seconds)
        added = []
        for asked in self.of(self.policy):
            added.append(
                Harvests(
                    orchard=asked.orchard,
                    policy=submission.policy,
                    proven=asked.proven,
                    seconds=by_orchard[asked.orchard],
                    checked=[],
                )
            )
        scores = self.scores | {submission.policy: submission.score}
        best_first = sorted(scores.items(), key=lambda item: -item[1])
        return replace(self, scores=dict(best_first), harvests=self.harvests + added)

    def standard_error(self, policy: str) -> float:
        """Return the standard error of the difference between the scores of a policy and of the one
        that was asked about, as a share.

        Both have the same seeds. So the differences are paired by seed. The score is the mean over
        orchards, so its variance is the sum of theirs over the square of their number.
        """
        variances = []
        for harvests, asked in zip(self.of(policy), self.of(self.policy), strict=True):
            variances.append(_variance_of_difference(harvests, asked))
        return sqrt(sum(variances)) / len(variances)


def _variance_of_difference(harvests: Harvests, others: Harvests) -> float:
    """Return the variance of the mean difference of the scores of two policies in an orchard."""
    pairs = zip(harvests.shares, others.shares, strict=True)
    differences = [share - other for share, other in pairs]
    if len(differences) == 1:
        # Nothing is random there.
        return 0.0
    return variance(differences) / len(differences)


class Benchmark:
    """A benchmark that runs: the harvests of one policy and of all built-in ones by the fast model,
    and the bounds.
    """

    def __init__(
        self,
        policy: str,
        known: Mapping[str, Instance],
        store: Store,
        workers: Workers,
        *,
        is_checked: bool = False,
        tell: Callable[[float], None] = lambda share: None,
        is_stopped: Callable[[], bool] = lambda: False,
        limits: Limits = USUAL_LIMITS,
    ) -> None:
        """`known`: orchards by name. `is_checked`: the simulator does these harvests too.

        `tell` gets the share of runs that are done. `limits`: of a policy of the user's own. Raises
        ScenarioError for a policy that cannot be used.
        """
        self.policy = policy
        self.instances = known
        self.known = {name: instance.whole_scenario for name, instance in known.items()}
        self.workers = workers
        self.tell = tell
        self.is_stopped = is_stopped
        self.is_own = policy not in DISPATCH_POLICIES
        policies = dict.fromkeys([policy, *DISPATCH_POLICIES])
        # A setting is an orchard with a policy; `cells` has both names of each. Settings are
        # numbers from 0.
        self.cells = []
        self.settings = []
        for of_cell in policies:
            for name, scenario in self.known.items():
                self.cells.append((name, of_cell))
                self.settings.append(Setting({}, with_changes(scenario, dispatch=of_cell)))
        # The settings of `policy` come first.
        self.own = range(len(known))
        if self.is_own:
            check_policy(policy, next(iter(self.known.values())), limits)
        self.own_harvests = OwnHarvests(policy, limits, workers.count)
        self.own_results = dict[str, list[OwnResult]]()
        self.checked: Sequence[int] = ()
        if is_checked:
            self.checked = self.own
        self.wanted = self._count_runs()
        self.runs = Replications(
            settings=self.settings,
            goal="harvest_seconds",
            horizon="harvest",
            store=store,
            workers=workers,
            heard=self._hear,
            is_stopped=is_stopped,
        )

    def _seeds(self, number: int) -> int:
        """Return how many seeds a setting has: one if nothing is random in its orchard."""
        orchard, _ = self.cells[number]
        return len(self.instances[orchard].draws)

    def _count_runs(self) -> int:
        """Return the number of all runs, without those of a policy of the user's own."""
        return sum(map(self._seeds, [*self.built_in, *self.checked]))

    def _by_seeds(self) -> dict[int, list[int]]:
        """Return the settings with built-in policies by their number of seeds."""
        settings = dict[int, list[int]]()
        for number in self.built_in:
            settings.setdefault(self._seeds(number), []).append(number)
        return settings

    @property
    def built_in(self) -> range:
        """The settings with built-in policies."""
        first = 0
        if self.is_own:
            first = len(self.known)
        return range(first, len(self.settings))

    def run(self) -> BenchmarkResult | None:
        """Do the harvests that are not in the store, and return the result; None if stopped.

        Harvests with a policy of the user's own are not kept in the store. Raises WorkersError,
        RunFailed or StoreFailed.
        """
        if self.is_own and not self._ask_own():
            return None
        for count, settings in self._by_seeds().items():
            if not self.runs.do(settings, "fast", count, until=inf):
                return None
        if not self._check():
            return None
        return self._result()

    def _ask_own(self) -> bool:
        """Do the harvests with a policy of the user's own. Return whether all are done."""
        harvests = list[OwnHarvest]()
        for number, (orchard, scenario) in enumerate(self.known.items()):
            for more in range(self._seeds(number)):
                seeded = with_changes(scenario, seed=scenario.seed + more)
                harvests.append(OwnHarvest(orchard, seeded))
        results = self.own_harvests.do(harvests, self.is_stopped)
        if results is None:
            return False
        for harvest, result in zip(harvests, results, strict=True):
            self.own_results.setdefault(harvest.orchard, []).append(result)
        return True

    def submission(self) -> Submission:
        """Return the submission of the policy, once all harvests are done."""
        played = {}
        version = software()
        if self.is_own:
            version = self.own_harvests.version
            for name, results in self.own_results.items():
                played[name] = [result.played for result in results]
        else:
            for name, instance in self.instances.items():
                layouts = [lay_out(instance.of_seed(draw.seed)) for draw in instance.draws]
                played[name] = [built_in_harvest(layout, self.policy) for layout in layouts]
        return submission_of(self.policy, version, self.instances, played)

    def _check(self) -> bool:
        """Do the harvests by the simulator, if wanted. Return whether all are done."""
        return all(
            self.runs.do([number], "full", self._seeds(number), until=inf)
            for number in self.checked
        )

    def _hear(self) -> None:
        """Tell which share of the runs is done.

        A run of the simulator counts as much as one of the fast model, and takes far longer. So
        with a check the last part of the bar takes most of the time.
        """
        self.tell(len(self.runs.records) / self.wanted)

    def _result(self) -> BenchmarkResult:
        """Return all harvests and scores, once all runs are done."""
        all_harvests = []
        of_policies: dict[str, list[float]] = {}
        for i, (orchard, policy) in enumerate(self.cells):
            harvests = self._harvests(i, orchard, policy)
            all_harvests.append(harvests)
            of_policies.setdefault(policy, []).append(harvests.score)
        scores = {policy: fmean(of_policy) for policy, of_policy in of_policies.items()}
        best_first = sorted(scores, key=lambda policy: -scores[policy])
        return BenchmarkResult(
            policy=self.policy,
            scores={policy: scores[policy] for policy in best_first},
            harvests=all_harvests,
            notes=self._notes(),
            too_slow=self._too_slow(),
            splits=splits_of(self.instances),
            version=software(),
        )

    def _harvests(self, i: int, orchard: str, policy: str) -> Harvests:
        """Return the harvests of a setting, which is that of an orchard and a policy."""
        checked: list[float | None] = []
        if i in self.checked:
            checked = self._seconds(i, "full")
        return Harvests(
            orchard=orchard,
            policy=policy,
            proven=[draw.proven_seconds for draw in self.instances[orchard].draws],
            seconds=self._seconds(i, "fast"),
            checked=checked,
        )

    def _too_slow(self) -> list[str]:
        """Return a line for each harvest for which a policy of one's own took too long."""
        lines = []
        for orchard, results in self.own_results.items():
            for seed, result in enumerate(results, start=self.known[orchard].seed):
                if result.too_slow:
                    lines.append(f"{orchard}, seed {seed}: {result.too_slow}")
        return lines

    def _seconds(self, i: int, model: Model) -> list[float | None]:
        """Return how long the harvests of a setting are, by seed; None: never finished."""
        orchard, policy = self.cells[i]
        if model == "fast" and self.is_own and policy == self.policy:
            return [result.played.seconds for result in self.own_results[orchard]]
        seconds: list[float | None] = []
        for record in self.runs.known(i, model):
            if record.is_jammed:
                seconds.append(None)
            else:
                seconds.append(record.sim_seconds)
        return seconds

    def _notes(self) -> list[str]:
        """Return what was wrong in harvests in the simulator, a line each."""
        notes = []
        for i in self.checked:
            orchard, _ = self.cells[i]
            for record in self.runs.known(i, "full"):
                lines = [*record.violations.split("\n"), *record.faults.split("\n")]
                for line in filter(None, lines):
                    notes.append(f"{orchard}, seed {record.seed}: {line}")
        return notes
