"""A submission: a file with the scores of a policy and all its orders, so that anybody can replay
the harvests and verify the scores without the policy.
"""

import hashlib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from statistics import fmean

import msgspec

from orchard.behaviour.dispatcher import checked
from orchard.dispatch.policy import Assignment, BinReport, CarrierReport
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.study.benchmark.instances import SET, Instance, RecordedOrder, recorded
from orchard.study.benchmark.play import Played, play
from orchard.study.runs import software

# s. Times are rounded to a tick, 0.1 s, and differ as floats by less than this.
ROUNDING = 1e-6
# Scores are shares, 0 to 1: this is a millionth of a percent point.
SCORE_ROUNDING = 1e-8


class SubmittedHarvest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A harvest of a submission."""

    instance: str
    seed: int
    #: Its length; None: it was never finished, or a decision took too long.
    seconds: float | None
    proven_seconds: float
    is_early: bool
    orders: list[RecordedOrder]

    @property
    def score(self) -> float:
        """The proven time as a share of the harvest's; 0 if it was never finished."""
        if not self.seconds:
            return 0.0
        return self.proven_seconds / self.seconds


class Submission(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a policy scored, and how."""

    set: str
    #: The splits of its orchards. `train` and `test` are public, so a policy may know them.
    splits: list[str]
    policy: str
    policy_version: str
    software: str
    #: 0 to 1.
    score: float
    #: Instance -> its score, 0 to 1.
    scores: dict[str, float]
    harvests: list[SubmittedHarvest]
    #: The hash of all other fields, which shows a change by mistake.
    sha256: str = ""

    @property
    def digest(self) -> str:
        """The hash of all fields but `sha256`."""
        bare = msgspec.structs.replace(self, sha256="")
        return hashlib.sha256(msgspec.json.encode(bare, order="sorted")).hexdigest()


def submission_of(
    policy: str, version: str, known: Mapping[str, Instance], played: Mapping[str, Sequence[Played]]
) -> Submission:
    """Return a submission. `played`: instance -> its harvests, in the order of its seeds."""
    harvests = list[SubmittedHarvest]()
    for name, instance in known.items():
        for draw, harvest in zip(instance.draws, played[name], strict=True):
            seconds = harvest.seconds
            if seconds is not None:
                seconds = round(seconds, 1)
            harvests.append(
                SubmittedHarvest(
                    instance=name,
                    seed=draw.seed,
                    seconds=seconds,
                    proven_seconds=draw.proven_seconds,
                    is_early=harvest.is_early,
                    orders=recorded(harvest.decisions),
                )
            )
    scores = scores_of(harvests)
    submission = Submission(
        set=SET,
        splits=splits_of(known),
        policy=policy,
        policy_version=version,
        software=software(),
        score=fmean(scores.values()),
        scores=scores,
        harvests=harvests,
    )
    return msgspec.structs.replace(submission, sha256=submission.digest)


def splits_of(known: Mapping[str, Instance]) -> list[str]:
    """Return the splits to which instances belong."""
    return sorted({instance.split for instance in known.values()})


def scores_of(harvests: Iterable[SubmittedHarvest]) -> dict[str, float]:
    """Return the score of each instance: the mean over its seeds."""
    scores = dict[str, list[float]]()
    for harvest in harvests:
        scores.setdefault(harvest.instance, []).append(harvest.score)
    return {instance: fmean(values) for instance, values in scores.items()}


def read_submission(path: Path) -> Submission:
    """Return the submission in a file. Raises OSError, or ValueError for what is no submission."""
    try:
        return msgspec.json.decode(path.read_bytes(), type=Submission)
    except msgspec.MsgspecError as error:
        raise ValueError(f"{path}: is no submission to the benchmark: {error}") from None


def problems_of(submission: Submission, known: Mapping[str, Instance]) -> list[str]:
    """Replay the schedules of a submission, and return what is wrong with it, a line each.

    `known`: the instances of which it must have all harvests.
    """
    if submission.set != SET:
        return [f"it is of the set {submission.set}; expected {SET}"]
    problems = []
    if submission.splits != splits_of(known):
        problems.append(
            f"it is of the splits {submission.splits}; expected {splits_of(known)}: give --split,"
            " --orchard or --secret as it had them"
        )
    if submission.digest != submission.sha256:
        problems.append("its hash is not that of its content: it was changed after it was written")
    unwanted = _wrong_harvests(submission, known)
    if unwanted:
        # Nothing is replayed then: a file may have any number of harvests that nobody wants.
        return problems + unwanted
    for harvest in submission.harvests:
        problems += _wrong(harvest, known[harvest.instance])
    return problems + _wrong_scores(submission)


def _wrong_harvests(submission: Submission, known: Mapping[str, Instance]) -> list[str]:
    """Return which harvests are missing, are there twice, or are of an unknown seed."""
    wanted = set[tuple[str, int]]()
    for name, instance in known.items():
        wanted |= {(name, draw.seed) for draw in instance.draws}
    counts = Counter((harvest.instance, harvest.seed) for harvest in submission.harvests)
    problems = []
    for name, seed in sorted(wanted - counts.keys()):
        problems.append(f"{name}, seed {seed}: this harvest is missing")
    for (name, seed), count in sorted(counts.items()):
        if (name, seed) not in wanted:
            problems.append(f"{name}, seed {seed}: no such instance and seed in this split")
        elif count > 1:
            problems.append(f"{name}, seed {seed}: it is there {count} times")
    return problems


def _wrong_scores(submission: Submission) -> list[str]:
    """Return which scores do not follow from the harvests."""
    problems = []
    scores = scores_of(submission.harvests)
    for instance in sorted({*scores} | {*submission.scores}):
        submitted = submission.scores.get(instance)
        computed = scores.get(instance)
        if submitted is None:
            problems.append(f"the score of {instance} is missing")
        elif computed is None or abs(computed - submitted) > SCORE_ROUNDING:
            problems.append(f"the score of {instance} is not that of its harvests")
    score = 0.0
    if scores:
        score = fmean(scores.values())
    if abs(score - submission.score) > SCORE_ROUNDING:
        problems.append(
            f"its score is {100.0 * submission.score:.3f} %; its harvests give"
            f" {100.0 * score:.3f} %"
        )
    return problems


def _wrong(harvest: SubmittedHarvest, instance: Instance) -> list[str]:
    """Replay a harvest, and return what is wrong with it."""
    where = f"{instance.name}, seed {harvest.seed}"
    (proven,) = [draw.proven_seconds for draw in instance.draws if draw.seed == harvest.seed]
    if proven != harvest.proven_seconds:
        return [f"{where}: its bound is {harvest.proven_seconds:g} s; expected {proven:g} s"]
    try:
        seconds = replayed(instance.of_seed(harvest.seed), harvest.is_early, harvest.orders)
    except ValueError as error:
        return [f"{where}: {error}"]
    if harvest.seconds is None:
        if seconds is None:
            return []
        return [f"{where}: it says that it is never finished; its orders take {seconds:.1f} s"]
    if seconds is None:
        return [f"{where}: its orders never finish the harvest"]
    if abs(round(seconds, 1) - harvest.seconds) > ROUNDING:
        return [f"{where}: it says {harvest.seconds:.1f} s; its orders take {seconds:.1f} s"]
    if seconds < proven - ROUNDING:
        return [f"{where}: {seconds:.1f} s are less than the proven {proven:.1f} s"]
    return []


def replayed(scenario: Scenario, is_early: bool, orders: Sequence[RecordedOrder]) -> float | None:
    """Return how long a harvest with recorded orders takes, s; None if it is never finished.

    Raises ValueError for an order that cannot be.
    """
    # Tick -> its orders that have not been carried out yet.
    remaining = dict[int, list[RecordedOrder]]()
    for order in orders:
        remaining.setdefault(order.tick, []).append(order)

    def decide(
        now: int, bins: Sequence[BinReport], carriers: Sequence[CarrierReport]
    ) -> list[Assignment]:
        decided = remaining.pop(now, [])
        try:
            sent = checked(
                [Assignment(order.bin, order.carrier) for order in decided],
                list(bins),
                list(carriers),
            )
            _check_pickers(decided, bins)
        except ValueError as error:
            raise ValueError(f"tick {now}: {error}") from None
        return sent

    seconds = play(lay_out(scenario), is_early, decide).seconds
    if remaining:
        raise ValueError(f"tick {min(remaining)}: nothing is decided then, and it has an order")
    return seconds


def _check_pickers(orders: Sequence[RecordedOrder], bins: Sequence[BinReport]) -> None:
    """Check that each order names the picker of its bin. Raises ValueError."""
    pickers = dict[str, str]()
    for report in bins:
        pickers[report.name] = report.picker
    for order in orders:
        picker = pickers[order.bin]
        if picker != order.picker:
            raise ValueError(f"{order.bin} is that of {picker}, not {order.picker}")
