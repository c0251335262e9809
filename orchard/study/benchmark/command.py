"""The command `orchard benchmark`: how near a dispatch policy comes to what is possible, beside the
built-in ones.
"""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from statistics import fmean
from tempfile import TemporaryDirectory

import msgspec
from rich.table import Table
from typer import BadParameter

from orchard.discrete.harvest import get_ready
from orchard.dispatch.policies import POLICIES
from orchard.field.problems import ScenarioError, printable
from orchard.field.scenario import NEAREST, ROLLING
from orchard.report.summary import SUMMARY, write_if_wanted
from orchard.study.benchmark.asked import Limits
from orchard.study.benchmark.bounds import hidden_instances, secret_of
from orchard.study.benchmark.confined import can_hide
from orchard.study.benchmark.families import FAMILIES, commitment, name_of
from orchard.study.benchmark.hidden_draws import hidden_scenarios
from orchard.study.benchmark.instances import Instance, instances
from orchard.study.benchmark.scores import Benchmark, BenchmarkResult
from orchard.study.benchmark.submission import Submission, problems_of, read_submission
from orchard.study.command_options import BenchmarkOptions
from orchard.study.ending import STOPPED, tell_if_lost
from orchard.study.kinds_of_files import SUBMISSION
from orchard.study.options import StudyOptions
from orchard.study.runs import software
from orchard.study.store import Store, StoreError
from orchard.study.study_command import failures
from orchard.study.workers import Workers, processes
from orchard.terminal.exits import FAILED, FINISHED, as_typed, exit_on_errors
from orchard.terminal.files import check_writable, one_file
from orchard.terminal.output import (
    bar,
    console,
    own_classes_run,
    print_error,
    print_line,
    table,
)
from orchard.terminal.signals import stoppable

MEANING = (
    "What is proven of the shortest harvest, as a share of the time that it took, %. Differences to"
    " {policy} are paired, by seeds."
)
OWN_STOPPED = "stopped; harvests of a policy of your own are not kept"
# `splits` of a submission whose orchards a secret has drawn.
HIDDEN = ["hidden"]
POSSIBLE = (
    "That shows that these schedules are possible, not who found them, or with what knowledge."
)
PUBLIC = (
    "These orchards are public, with all that their seeds draw, and a policy may know them: only a"
    " hidden split (--secret) shows what it does where it does not."
)
# How many problems of a submission are printed, and how many characters of each.
MOST_PROBLEMS = 50
LONGEST_PROBLEM = 500
CHECKED = "The harvests with {policy}, s; of several seeds the mean."


def run_benchmark(chosen: BenchmarkOptions) -> int:
    """Do a benchmark, print and write what came out; or verify a submission.

    Return the exit code: 1 if harvests fail, a file cannot be written, it was stopped, or a
    submission is wrong.
    """
    with (
        own_classes_run(),
        exit_on_errors(ScenarioError, StoreError, OSError, SubmissionError),
        failures(),
    ):
        _check_options(chosen)
        with _wanted_store(chosen) as store_file, processes(chosen.workers) as workers:
            known = _known(chosen, workers)
            if chosen.verify is not None:
                return _verify(chosen.verify, known)
            other = None
            if chosen.beside is not None:
                # Harvests with a user's policy take minutes. What is wrong with the other file is
                # reported before them.
                other = _beside(chosen.beside, chosen.policy, known)
                if other is None:
                    return FAILED
            done = _done(chosen, known, store_file, workers)
        if done is None and chosen.policy in POLICIES:
            print_error(STOPPED)
            return FAILED
        if done is None:
            print_error(OWN_STOPPED)
            return FAILED
        result, submission = done
        if other is not None:
            result = result.with_submission(other)
        _print(result)
    troubles = [*result.notes, *filter(None, [write_if_wanted(chosen.summary, asdict(result))])]
    if submission is not None:
        content = msgspec.to_builtins(submission)
        troubles += filter(None, [write_if_wanted(chosen.submission, content)])
    for trouble in troubles:
        print_error(trouble)
    is_told = tell_if_lost()
    if troubles or not is_told:
        return FAILED
    return FINISHED


class SubmissionError(ValueError):
    """Raised for a submission or a secret that cannot be used: the text names the file."""


def _check_options(chosen: BenchmarkOptions) -> None:
    """Refuse options that contradict each other. Raises BadParameter or ScenarioError."""
    if chosen.verify is not None:
        _check_alone(chosen)
    if chosen.submission is not None and chosen.check:
        text = "a policy is trusted in the simulator; leave out --check"
        raise BadParameter(text, param_hint="--submission")
    if chosen.submission is not None and chosen.policy == NEAREST:
        text = f"with {NEAREST} bins call carriers themselves: there are no decisions to record"
        raise BadParameter(text, param_hint="--submission")
    if chosen.secret is not None and chosen.split is not None:
        text = "the secret draws a split of its own; leave out --split"
        raise BadParameter(text, param_hint="--secret")
    outputs = [path for path in (chosen.summary, chosen.submission) if path is not None]
    if outputs:
        store_file = StudyOptions(store=chosen.out).store_file
        problems = list(one_file([store_file, *outputs]))
        if problems:
            raise ScenarioError(problems)
    if chosen.summary is not None:
        check_writable(chosen.summary, kind=SUMMARY)
    if chosen.submission is not None:
        check_writable(chosen.submission, kind=SUBMISSION)


def _check_alone(chosen: BenchmarkOptions) -> None:
    """Refuse options that have no effect beside --verify. Raises BadParameter."""
    # Option -> whether it was given.
    in_vain = {
        "POLICY": chosen.policy != ROLLING,
        "--check": chosen.check,
        "--summary": chosen.summary is not None,
        "--submission": chosen.submission is not None,
        "--beside": chosen.beside is not None,
    }
    for name, is_given in in_vain.items():
        if is_given:
            text = f"it replays the decisions of its file; {name} has no effect: leave it out"
            raise BadParameter(text, param_hint="--verify")


@contextmanager
def _wanted_store(chosen: BenchmarkOptions) -> Iterator[Path]:
    """Yield the file of the store. For a secret it is deleted afterwards: it would tell the
    orchards.
    """
    if chosen.secret is None:
        yield StudyOptions(store=chosen.out).store_file
        return
    with TemporaryDirectory() as folder:
        yield Path(folder) / "studies.db"


def _known(chosen: BenchmarkOptions, workers: Workers) -> dict[str, Instance]:
    """Return the instances that are wanted. Raises BadParameter or SubmissionError."""
    if chosen.secret is None:
        known = instances()
        if chosen.split is not None:
            known = {name: known[name] for name in known if known[name].split == chosen.split}
        wanted = _wanted_names(chosen, known)
        return {name: instance for name, instance in known.items() if name in wanted}
    try:
        secret = secret_of(chosen.secret)
    except ValueError as error:
        raise SubmissionError(str(error)) from None
    wanted = _wanted_names(chosen, [name_of(family, "hidden") for family in FAMILIES])
    print_line(f"The SHA-256 of this secret is {commitment(secret)}.")
    return hidden_instances(hidden_scenarios(secret, wanted, print_line), workers)


def _wanted_names(chosen: BenchmarkOptions, known: Iterable[str]) -> list[str]:
    """Return the names of the orchards that are wanted. Raises BadParameter."""
    every = [*known]
    names = chosen.orchard or every
    for name in names:
        if name not in every:
            text = f"{name}: no such orchard; there are {', '.join(every)}"
            raise BadParameter(text, param_hint="--orchard")
    return names


def _replayed(path: Path, known: dict[str, Instance]) -> Submission | None:
    """Replay a submission, and return it. If something is wrong with it, print that and return
    None.

    Raises SubmissionError for a file that is no submission.
    """
    try:
        submission = read_submission(path)
    except ValueError as error:
        raise SubmissionError(str(error)) from None
    problems = problems_of(submission, known)
    for problem in problems[:MOST_PROBLEMS]:
        print_error(f"{path}: {printable(problem, LONGEST_PROBLEM)}")
    if len(problems) > MOST_PROBLEMS:
        print_error(f"{path}: and {len(problems) - MOST_PROBLEMS} more")
    if problems:
        return None
    return submission


def _beside(path: Path, policy: str, known: dict[str, Instance]) -> Submission | None:
    """Replay a submission whose policy is to stand beside others in the table, and return it.

    `policy`: the one that is benchmarked. If something is wrong with the submission, print that and
    return None. Raises SubmissionError if its policy is in the table anyway.
    """
    submission = _replayed(path, known)
    if submission is not None and submission.policy in (policy, *POLICIES):
        name = printable(submission.policy)
        raise SubmissionError(f"{path}: its policy {name} is in the table already")
    return submission


def _verify(path: Path, known: dict[str, Instance]) -> int:
    """Replay a submission, and print whether it is right. Return the exit code."""
    submission = _replayed(path, known)
    if submission is None:
        return FAILED
    print_line(
        f"{path}: {printable(submission.policy)} has {_percent(submission.score)} % in"
        f" {len(known)} orchards: {len(submission.harvests)} harvests were replayed, and each takes"
        " as long as it says, or is never finished if it says so."
    )
    if submission.software != software():
        print_line(f"It was made by {printable(submission.software)}, and this is {software()}.")
    if [*known] != [*instances()] and submission.splits != HIDDEN:
        print_line(f"Those are {len(known)} of the {len(instances())} public orchards.")
    print_line(POSSIBLE if submission.splits == HIDDEN else f"{POSSIBLE} {PUBLIC}")
    return FINISHED


def _done(
    chosen: BenchmarkOptions, known: dict[str, Instance], store_file: Path, workers: Workers
) -> tuple[BenchmarkResult, Submission | None] | None:
    """Do the harvests. Return the result, and the submission if one is wanted; None if stopped."""
    get_ready(instance.whole_scenario for instance in known.values())
    with (
        Store(store_file, chosen.anew) as store,
        stoppable() as is_stopped,
        bar() as shown,
    ):
        task = shown.add_task("", total=1.0)

        def show(share: float) -> None:
            shown.update(task, completed=share)

        with as_typed(lambda path: "POLICY"):
            asked = Benchmark(
                chosen.policy,
                known,
                store,
                workers,
                is_checked=chosen.check,
                tell=show,
                is_stopped=is_stopped,
                limits=_limits(chosen.secret),
            )
        result = asked.run()
        if result is None:
            return None
        submission = None
        if chosen.submission is not None:
            submission = asked.submission()
        return result, submission


def _limits(secret: Path | None) -> Limits:
    """Return the limits of a policy: it may not read the file of the secret.

    A secret that came through a pipe is no file, and can be read only once.
    """
    if secret is None or not secret.is_file():
        return Limits()
    if not can_hide():
        print_error(
            f"{secret}: this system cannot hide it from the policy, which may read it and know all"
            " orchards of the split; give it over a pipe from elsewhere, or run in a container"
        )
    return Limits(hidden=(str(secret.resolve()),))


def _print(result: BenchmarkResult) -> None:
    """Print the score, the table of all scores, and what is to be known of the harvests."""
    score = _percent(result.scores[result.policy])
    # `scores` begins with the best one.
    best = next(iter(result.scores))
    others = "the best of all here"
    if best != result.policy:
        others = f"the best is {printable(best)} with {_percent(result.scores[best])} %"
    print_line(f"{result.policy} has {score} % of what is proven possible; {others}.")
    console.print(_scores(result))
    if result.policy not in POLICIES and result.splits != HIDDEN:
        print_line(PUBLIC)
    for line in result.too_slow:
        print_line(f"- score 0: {line}")
    jams = []
    for harvests in result.of(result.policy):
        count = harvests.seconds.count(None)
        if count:
            jams.append(f"{count} of {harvests.orchard}")
    if jams and not result.too_slow:
        print_line(
            "- never finished, as robots waited for each other, or for a carrier that was not"
            f" sent: {', '.join(jams)}"
        )
    if any(harvests.checked for harvests in result.of(result.policy)):
        console.print(_differences(result))


def _scores(result: BenchmarkResult) -> Table:
    """Return the table of all scores: a column for each policy, a row for each orchard."""
    asked = result.scores[result.policy]
    names = []
    differences = []
    errors = []
    for policy, score in result.scores.items():
        names.append(printable(policy.rpartition(".")[2]).replace("-", "\n"))
        differences.append(f"{100.0 * (score - asked):+.1f}")
        errors.append(f"{100.0 * result.standard_error(policy):.2f}")
    shown = table(MEANING.format(policy=result.policy), "orchard", "proven,\ns", *names)
    by_cell = {(harvests.orchard, harvests.policy): harvests for harvests in result.harvests}
    for harvests in result.of(result.policy):
        orchard = harvests.orchard
        scores = [_percent(by_cell[orchard, policy].score) for policy in result.scores]
        shown.add_row(orchard, f"{fmean(harvests.proven):.1f}", *scores)
    shown.add_section()
    shown.add_row("score", "", *map(_percent, result.scores.values()), style="bold")
    shown.add_row("difference", "", *differences)
    shown.add_row("standard error", "", *errors)
    return shown


def _percent(share: float) -> str:
    return f"{100.0 * share:.1f}"


def _differences(result: BenchmarkResult) -> Table:
    """Return the table of the fast model beside the simulator."""
    shown = table(
        CHECKED.format(policy=result.policy), "orchard", "fast model", "simulator", "difference, %"
    )
    for harvests in result.of(result.policy):
        percent = ""
        if harvests.difference is not None:
            percent = f"{100.0 * harvests.difference:+.1f}"
        fast = _mean(harvests.seconds)
        full = _mean(harvests.checked)
        shown.add_row(harvests.orchard, fast, full, percent)
    return shown


def _mean(seconds: Sequence[float | None]) -> str:
    """Return the mean time of harvests, if all of them were finished."""
    known = [taken for taken in seconds if taken is not None]
    if len(known) < len(seconds):
        return "never finished"
    return f"{fmean(known):.1f}"
