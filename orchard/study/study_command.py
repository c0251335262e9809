"""The command `orchard study`: asks, shows what is known so far, and prints and writes the
answer.
"""

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, fields
from functools import partial
from importlib import import_module
from pathlib import Path

from rich.progress import TextColumn

from orchard.dispatch.policies import notes_on
from orchard.field.problems import Problem, ScenarioError
from orchard.field.scenario import Scenario
from orchard.report.summary import write_summary
from orchard.study.asking import problems_of_files, read_scenario
from orchard.study.checking import checked_settings, refused_and_left_out
from orchard.study.command_options import StudyArguments
from orchard.study.ending import STOPPED, tell_if_lost, unwritten
from orchard.study.farm_command import run_farm
from orchard.study.farm_file import is_farm
from orchard.study.finishing import OF_FLEETS, finish_problems, finish_study
from orchard.study.options import StudyOptions
from orchard.study.result import StudyResult
from orchard.study.runs import RunFailed
from orchard.study.sensitivity.command import run_sensitivity
from orchard.study.settings import CARRIERS, Varied, varied_of
from orchard.study.store import StoreError, StoreFailed
from orchard.study.study import study
from orchard.study.table import as_table, payments_table, save_csv
from orchard.study.workers import WorkersError
from orchard.terminal.exits import FAILED, FINISHED, exit_on_errors
from orchard.terminal.output import (
    bar,
    console,
    own_classes_run,
    print_error,
    print_line,
)
from orchard.terminal.signals import stoppable

# Options that have another name in StudyOptions.
NAMES = {"budget": "budget_seconds", "out": "store"}
Save = Callable[[StudyResult, Path], None]
# A context that prints these errors, and exits with the code FAILED.
failures = partial(exit_on_errors, WorkersError, RunFailed, StoreFailed, code=FAILED)


def run_study(chosen: StudyArguments) -> int:
    """Do a study, print and write its answer.

    Returns the exit code: 1 if an invariant, a run of any setting, or a file fails.
    """
    with own_classes_run(), exit_on_errors(ScenarioError, StoreError, OSError), failures():
        if chosen.sensitivity:
            with stoppable() as is_stopped:
                return run_sensitivity(chosen, _options(chosen), is_stopped)
        if is_farm(chosen.scenario):
            with stoppable() as is_stopped:
                return run_farm(chosen, _options(chosen), is_stopped)
        scenario, varied = _question(chosen)
        for note in notes_on(varied.get("dispatch", [scenario.dispatch])):
            print_error(note)
        with stoppable() as is_stopped, _progress(chosen) as tell:
            options = _options(chosen)
            if chosen.deadline is None:
                result = study(scenario, varied, options, tell, is_stopped)
            else:
                result = finish_study(
                    scenario, varied, chosen.deadline, options, tell=tell, is_stopped=is_stopped
                )
    _print(result, chosen.progress == "json")
    if not result.table and result.stopped_by == "budget":
        print_error("the budget is too short for one run: --budget")
        return FAILED
    for violation in result.violations:
        print_error(violation)
    are_written = not unwritten(_files(chosen), result)
    is_told = tell_if_lost()
    if result.violations or result.has_failures or not (are_written and is_told):
        return FAILED
    return FINISHED


def _question(chosen: StudyArguments) -> tuple[Scenario, Varied]:
    """Return the scenario and what varies. Raises ScenarioError with all that is wrong."""
    scenario, faults = read_scenario(chosen.scenario)
    options = _options(chosen)
    words = chosen.vary or [CARRIERS]
    if chosen.deadline is None:
        varied, of_words = varied_of(words, (CARRIERS,))
        settings, of_study = checked_settings(scenario, varied, options)
        of_settings, _ = refused_and_left_out(settings, of_study)
    else:
        varied, of_words = varied_of(words, OF_FLEETS)
        of_settings = finish_problems(scenario, varied, chosen.deadline, options)
    problems = [*chosen.problems(), *of_words, *problems_of_files(chosen, options)]
    for problem in of_settings:
        if not _may_follow(problem, faults):
            problems.append(problem)
    if problems or faults:
        raise ScenarioError([*problems, *faults])
    return scenario, varied


def _may_follow(problem: Problem, faults: Sequence[Problem]) -> bool:
    """Whether a problem of a setting may follow from a fault in the scenario's file, so that the
    fault alone is reported.

    It may if it names the same value, a part of it, or a section that has it.
    """
    if problem.file.startswith("--vary"):
        return False
    named = [path for path in problem.path.split(", ") if path]
    for fault in faults:
        for wrong in fault.path.split(", "):
            if any(_is_part(path, wrong) or _is_part(wrong, path) for path in named):
                return True
    return False


def _is_part(path: str, whole: str) -> bool:
    """Whether a dotted path is `whole` or lies below it. An empty `whole` is the whole file."""
    return not whole or f"{path}.".startswith(f"{whole}.")


def _options(chosen: StudyArguments) -> StudyOptions:
    """Return how the study is done. An option whose value is wrong has its default."""
    names = {field.name for field in fields(StudyOptions)}
    values = {}
    for argument, value in vars(chosen).items():
        name = NAMES.get(argument, argument)
        if name in names and not isinstance(value, Problem):
            values[name] = value
    # The default depends on another option.
    if values.get("horizon") is None:
        values["horizon"] = "long"
        if chosen.deadline is not None:
            values["horizon"] = "harvest"
    return StudyOptions(**values)


def _files(chosen: StudyArguments) -> dict[Path, Save]:
    """Return the files that are wanted, each with the function that writes it."""
    wanted: dict[Path | None, Save] = {
        chosen.summary: _save_summary,
        chosen.csv: save_csv,
        chosen.picture: partial(_save_by, "picture"),
        chosen.report: partial(_save_by, "report"),
    }
    return {path: save for path, save in wanted.items() if path is not None}


def _save_summary(result: StudyResult, path: Path) -> None:
    """Write a result as JSON. Raises OSError."""
    write_summary(path, asdict(result))


def _save_by(module: str, result: StudyResult, path: Path) -> None:
    """Write a result by the function `save` of a module of this package.

    The module is imported only now: it loads matplotlib, which takes half a second.
    """
    import_module(f"orchard.study.{module}").save(result, path)


def _print(result: StudyResult, as_json: bool) -> None:
    """Print the answer, its tables and its notes; or all of it as one line of JSON."""
    if as_json:
        _tell_json(result)
        return
    console.print(result.answer, markup=False, soft_wrap=not console.is_terminal)
    if result.table:
        console.print(as_table(result))
    if result.best_row is not None and result.best_row.paid:
        console.print(payments_table(result.best_row))
    for note in result.notes:
        print_line(f"- {note}")
    if result.stopped_by == "stopped":
        print_error(STOPPED)


def _tell_json(result: StudyResult) -> None:
    """Print a result as a line of JSON."""
    console.print(json.dumps({"study": asdict(result)}), markup=False, soft_wrap=True)


@contextmanager
def _progress(chosen: StudyArguments) -> Iterator[Callable[[StudyResult], None]]:
    """Yield a function that shows a partial result: in a bar, or as a line of JSON."""
    if chosen.progress == "json":
        yield _tell_json
        return
    with bar(TextColumn("{task.description}", markup=False)) as shown:
        task = shown.add_task("starts its workers", total=chosen.budget)

        def tell(partial: StudyResult) -> None:
            shown.update(
                task,
                completed=partial.wall_seconds,
                description=f"{len(partial.table)} settings; {partial.answer}",
            )

        yield tell
