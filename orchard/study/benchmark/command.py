"""The command `orchard benchmark`: how near a dispatch policy comes to what is possible, beside the
built-in ones.
"""

from collections.abc import Sequence
from dataclasses import asdict
from statistics import fmean

from rich.table import Table
from typer import BadParameter

from orchard.discrete.harvest import get_ready
from orchard.field.problems import ScenarioError
from orchard.field.scenario import Scenario
from orchard.report.summary import SUMMARY, why_unwritten
from orchard.study.benchmark.scores import Benchmark, BenchmarkResult, orchards
from orchard.study.command_options import BenchmarkOptions
from orchard.study.options import StudyOptions
from orchard.study.store import Store, StoreError
from orchard.study.study_command import STOPPED, failures, tell_if_lost
from orchard.study.workers import processes
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

MEANING = "What is proven of the shortest harvest, as a share of the time that it took, %."
CHECKED = "The harvests with {policy}, s; of three seeds the mean."


def run_benchmark(chosen: BenchmarkOptions) -> int:
    """Do a benchmark, print and write what came out.

    Return the exit code: 1 if harvests fail, a file cannot be written, or it was stopped.
    """
    with (
        own_classes_run(),
        exit_on_errors(ScenarioError, StoreError, OSError),
        failures(),
    ):
        known = _known(chosen.orchard or [])
        if chosen.summary is not None:
            if same := [*one_file([StudyOptions(store=chosen.out).store_file, chosen.summary])]:
                raise ScenarioError(same)
            check_writable(chosen.summary, kind=SUMMARY)
        result = _result(chosen, known)
        if result is None:
            print_error(STOPPED)
            return FAILED
        _print(result)
    troubles = [*result.notes, *filter(None, [why_unwritten(chosen.summary, asdict(result))])]
    for trouble in troubles:
        print_error(trouble)
    is_told = tell_if_lost()
    return FAILED if troubles or not is_told else FINISHED


def _known(names: Sequence[str]) -> dict[str, Scenario]:
    """The orchards with these names, or all."""
    known = orchards()
    if unknown := [name for name in names if name not in known]:
        raise BadParameter(
            f"{unknown[0]}: no such orchard; there are {', '.join(known)}", param_hint="--orchard"
        )
    return {name: one for name, one in known.items() if not names or name in names}


def _result(chosen: BenchmarkOptions, known: dict[str, Scenario]) -> BenchmarkResult | None:
    get_ready(known.values())
    with (
        Store(StudyOptions(store=chosen.out).store_file, chosen.anew) as store,
        processes(chosen.workers) as workers,
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
            )
        return asked.run()


def _print(result: BenchmarkResult) -> None:
    best, score = next(iter(result.scores)), result.scores[result.policy]
    others = (
        "the best of all here"
        if best == result.policy
        else f"the best is {best} with {_percent(result.scores[best])} %"
    )
    print_line(f"{result.policy} has {_percent(score)} % of what is proven possible; {others}.")
    console.print(_scores(result))
    for line in result.too_slow:
        print_line(f"- score 0: {line}")
    jams = [
        (one.orchard, count)
        for one in result.of(result.policy)
        if (count := one.seconds.count(None))
    ]
    if jams and not result.too_slow:
        counts = ", ".join(f"{count} of {name}" for name, count in jams)
        print_line(
            "- never finished, as robots waited for each other, or for a carrier that was not"
            f" sent: {counts}"
        )
    if any(one.checked for one in result.of(result.policy)):
        console.print(_differences(result))


def _scores(result: BenchmarkResult) -> Table:
    names = [policy.rpartition(".")[2].replace("-", "\n") for policy in result.scores]
    shown = table(MEANING, "orchard", "proven,\ns", *names)
    found = {(one.orchard, one.policy): one for one in result.harvests}
    for one in result.of(result.policy):
        scores = [_percent(found[one.orchard, policy].score) for policy in result.scores]
        shown.add_row(one.orchard, f"{fmean(one.proven):.1f}", *scores)
    shown.add_section()
    shown.add_row("score", "", *map(_percent, result.scores.values()), style="bold")
    return shown


def _percent(share: float) -> str:
    return f"{100.0 * share:.1f}"


def _differences(result: BenchmarkResult) -> Table:
    """The fast model beside the simulator."""
    shown = table(
        CHECKED.format(policy=result.policy), "orchard", "fast model", "simulator", "difference, %"
    )
    for one in result.of(result.policy):
        difference = "" if one.difference is None else f"{100.0 * one.difference:+.1f}"
        shown.add_row(one.orchard, _mean(one.seconds), _mean(one.checked), difference)
    return shown


def _mean(seconds: Sequence[float | None]) -> str:
    known = [one for one in seconds if one is not None]
    return f"{fmean(known):.1f}" if len(known) == len(seconds) else "never finished"
