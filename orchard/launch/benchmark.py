"""The command `orchard benchmark`: how near a dispatch policy comes to what is possible, beside the built-in ones."""

from collections.abc import Sequence
from dataclasses import asdict, replace
from statistics import fmean

from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.progress import BarColumn, Progress, TimeElapsedColumn
from rich.table import Table
from typer import BadParameter

from orchard.field.problems import ScenarioError
from orchard.field.scenario import Scenario
from orchard.launch.runs import check_writable
from orchard.launch.study import STOPPED, failures, stoppable
from orchard.launch.study_options import BenchmarkOptions
from orchard.launch.terminal import FAILED, FINISHED, console, exit_on_errors, own_classes_run, print_error, print_line
from orchard.report.summary import write_summary
from orchard.study.benchmark import Benchmark, BenchmarkResult, orchards
from orchard.study.store import Store, StoreError
from orchard.study.study import StudyOptions
from orchard.study.workers import processes

MEANING = "What is proven of the shortest harvest, as a share of the time that it took, %."
CHECKED = "The harvests with {policy}, s; of three seeds the mean."


def run_benchmark(chosen: BenchmarkOptions) -> int:
    """Do a benchmark, print and write what came out. Return the exit code: 1 if harvests fail, or it was stopped."""
    with own_classes_run(), exit_on_errors(ScenarioError, StoreError, OSError), failures():
        known = _known(chosen.orchard or [])
        if chosen.summary is not None:
            check_writable(chosen.summary)
        result = _result(chosen, known)
        if result is None:
            print_error(STOPPED)
            return FAILED
        _print(result)
        if chosen.summary is not None:
            write_summary(chosen.summary, asdict(result))
    return FAILED if [*map(print_error, result.notes)] else FINISHED


def _known(names: Sequence[str]) -> dict[str, Scenario]:
    """The orchards with these names, or all."""
    known = orchards()
    if unknown := [name for name in names if name not in known]:
        raise BadParameter(f"{unknown[0]}: no such orchard; there are {', '.join(known)}", param_hint="--orchard")
    return {name: one for name, one in known.items() if not names or name in names}


def _result(chosen: BenchmarkOptions, known: dict[str, Scenario]) -> BenchmarkResult | None:
    columns = BarColumn(bar_width=20), TimeElapsedColumn()
    with (
        Store(StudyOptions(store=chosen.out).store_file, chosen.anew) as store,
        processes(chosen.workers) as workers,
        stoppable() as is_stopped,
        Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as shown,
    ):
        task = shown.add_task("", total=1.0)
        try:
            asked = Benchmark(
                chosen.policy, known, store, workers, chosen.check, lambda share: shown.update(task, completed=share), is_stopped
            )
        except ScenarioError as error:  # of the policy, which is named as it was typed
            raise ScenarioError([replace(problem, file="command line", path="POLICY") for problem in error.problems]) from None
        return asked.run()


def _print(result: BenchmarkResult) -> None:
    best, score = next(iter(result.scores)), result.scores[result.policy]
    others = "the best of all here" if best == result.policy else f"the best is {best} with {_percent(result.scores[best])} %"
    print_line(f"{result.policy} has {_percent(score)} % of what is proven possible; {others}.")
    console.print(_scores(result))
    if jams := [(one.orchard, count) for one in result.of(result.policy) if (count := one.seconds.count(None))]:
        counts = ", ".join(f"{count} of {name}" for name, count in jams)
        print_line(f"- never finished, as robots waited for each other, or for a carrier that was not sent: {counts}")
    if any(one.checked for one in result.of(result.policy)):
        console.print(_differences(result))


def _table(caption: str, *heads: str) -> Table:
    table = Table(box=SIMPLE_HEAD, padding=0, show_edge=False, caption=caption, caption_justify="left")
    for head in heads:
        table.add_column(escape(head), justify="left" if head == "orchard" else "right", no_wrap=head == "orchard", overflow="fold")
    return table


def _scores(result: BenchmarkResult) -> Table:
    names = [policy.rpartition(".")[2].replace("-", "\n") for policy in result.scores]
    table = _table(MEANING, "orchard", "proven,\ns", *names)
    found = {(one.orchard, one.policy): one for one in result.harvests}
    for one in result.of(result.policy):
        scores = [_percent(found[one.orchard, policy].score) for policy in result.scores]
        table.add_row(one.orchard, f"{fmean(one.proven):.1f}", *scores)
    table.add_section()
    table.add_row("score", "", *map(_percent, result.scores.values()), style="bold")
    return table


def _percent(share: float) -> str:
    return f"{100.0 * share:.1f}"


def _differences(result: BenchmarkResult) -> Table:
    """The fast model beside the simulator."""
    table = _table(CHECKED.format(policy=result.policy), "orchard", "fast model", "simulator", "difference, %")
    for one in result.of(result.policy):
        difference = "" if one.difference is None else f"{100.0 * one.difference:+.1f}"
        table.add_row(one.orchard, _mean(one.seconds), _mean(one.checked), difference)
    return table


def _mean(seconds: Sequence[float | None]) -> str:
    known = [one for one in seconds if one is not None]
    return f"{fmean(known):.1f}" if len(known) == len(seconds) else "never finished"
