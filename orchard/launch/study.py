"""The command `orchard study`: asks, shows what is known so far, and prints and writes the answer."""

import json
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from types import FrameType
from typing import Any

import typer
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from orchard.field.problems import ScenarioError
from orchard.field.scenario import Scenario
from orchard.launch.options import StudyArguments
from orchard.launch.runs import check_writable
from orchard.launch.terminal import FAILED, FINISHED, console, exit_on_errors, print_error, print_line
from orchard.study.result import StudyResult
from orchard.study.runs import RunFailed
from orchard.study.settings import varied_of
from orchard.study.store import StoreError
from orchard.study.study import StudyOptions, checked_settings, study
from orchard.study.table import as_table, save_csv
from orchard.study.workers import WorkersError

STOPPED = "stopped; the runs so far are kept, and the same command goes on from there"


def run_study(scenario: Scenario, chosen: StudyArguments) -> int:
    """Do a study, and print and write its answer. Return the exit code: 1 if an invariant is violated, or a run or a file fails."""
    files = _files(chosen)
    with exit_on_errors(ScenarioError, StoreError, OSError):
        varied, problems = varied_of(chosen.vary or [])
        if problems:
            raise ScenarioError([*problems, *checked_settings(scenario, varied, _options(chosen))[1]])
        for path in files:
            check_writable(path)
        try:
            with _stoppable() as is_stopped, _progress(chosen) as tell:
                result = study(scenario, varied, _options(chosen), tell, is_stopped)
        except (WorkersError, RunFailed) as error:
            print_error(error)
            return FAILED
    _print(result, chosen.progress == "json")
    if not result.table and result.stopped_by == "budget":
        print_error("the budget is too short for one run: --budget")
        return FAILED
    return FAILED if [*map(print_error, result.violations), *_unwritten(files, result)] else FINISHED


def _options(chosen: StudyArguments) -> StudyOptions:
    return StudyOptions(
        horizon=chosen.horizon,
        goal=chosen.goal,
        confidence=chosen.confidence,
        within=chosen.within,
        budget_seconds=chosen.budget,
        model=chosen.model,
        workers=chosen.workers,
        scheduler=chosen.scheduler,
        store=chosen.out,
        anew=chosen.anew,
    )


def _files(chosen: StudyArguments) -> dict[Path, Callable[[StudyResult, Path], None]]:
    """The files that the user wants, and what writes each."""
    wanted = {chosen.summary: _save_summary, chosen.csv: save_csv, chosen.picture: _save_picture, chosen.report: _save_report}
    return {path: save for path, save in wanted.items() if path is not None}


def _save_summary(result: StudyResult, path: Path) -> None:
    path.write_text(json.dumps(asdict(result), indent=2) + "\n")


def _save_picture(result: StudyResult, path: Path) -> None:
    from orchard.study.picture import save  # not at the top: matplotlib takes half a second to load

    save(result, path)


def _save_report(result: StudyResult, path: Path) -> None:
    from orchard.study.report import save

    save(result, path)


def _unwritten(files: dict[Path, Callable[[StudyResult, Path], None]], result: StudyResult) -> Iterator[Path]:
    """Write the files. Yield those that cannot be written, after a line on stderr."""
    for path, save in files.items():
        try:
            save(result, path)
        except OSError as error:
            print_error(f"{path}: not written: {error.strerror or error}")
            yield path


def _print(result: StudyResult, as_json: bool) -> None:
    if as_json:
        return _tell_json(result)
    console.print(as_table(result))
    print_line(result.answer)
    for note in result.notes:
        print_line(f"- {note}")
    if result.stopped_by == "stopped":
        print_error(STOPPED)


def _tell_json(result: StudyResult) -> None:
    console.print(json.dumps({"study": asdict(result)}), markup=False, soft_wrap=True)


@contextmanager
def _progress(chosen: StudyArguments) -> Iterator[Callable[[StudyResult], None]]:
    """Yield what hears of partial results: a bar of the budget and the present best on a terminal, JSON lines for programs."""
    if chosen.progress == "json":
        yield _tell_json
        return
    columns = BarColumn(bar_width=20), TimeElapsedColumn(), TextColumn("{task.description}", markup=False)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as shown:
        task = shown.add_task("starts its workers", total=chosen.budget)

        def tell(partial: StudyResult) -> None:
            shown.update(task, completed=partial.wall_seconds, description=f"{len(partial.table)} settings; {partial.answer}")

        yield tell


@contextmanager
def _stoppable() -> Iterator[Callable[[], bool]]:
    """In this context the first SIGINT or SIGTERM asks to stop, and the second one ends the program. Yield what tells whether to stop."""
    asked: list[int] = []

    def ask(number: int, frame: FrameType | None) -> Any:
        if asked:
            raise typer.Exit(FAILED)
        asked.append(number)

    old = {number: signal.signal(number, ask) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: bool(asked)
    finally:
        for number, handler in old.items():
            signal.signal(number, handler)
