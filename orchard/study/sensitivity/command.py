"""`orchard study --sensitivity`: what is asked, what is shown, and what is written."""

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from functools import partial
from importlib import import_module
from pathlib import Path

from rich.progress import TextColumn

from orchard.field.problems import Problem, ScenarioError
from orchard.field.scenario import Scenario
from orchard.report.summary import write_summary
from orchard.study.asking import problems_of_files, read_scenario
from orchard.study.command_options import StudyArguments
from orchard.study.ending import STOPPED, tell_if_lost, unwritten
from orchard.study.farm_file import is_farm
from orchard.study.options import StudyOptions
from orchard.study.sensitivity.factors import Factor, factors_of
from orchard.study.sensitivity.result import SensitivityResult
from orchard.study.sensitivity.study import sensitivity, sensitivity_problems
from orchard.study.sensitivity.words import as_table
from orchard.terminal.exits import FAILED, FINISHED
from orchard.terminal.output import bar, console, print_error, print_line

Save = Callable[[SensitivityResult, Path], None]
_NO_DEADLINE = (
    "looks for a fleet, and a sensitivity moves what is given; what the time hangs on: --horizon"
    " harvest --goal harvest_seconds"
)
# Option that a sensitivity cannot have -> why.
_NOT_OF_A_SENSITIVITY = {
    "finish_within": _NO_DEADLINE,
    "finish_by": _NO_DEADLINE,
}


def run_sensitivity(
    chosen: StudyArguments, options: StudyOptions, is_stopped: Callable[[], bool]
) -> int:
    """Do a sensitivity study, print and write its result.

    Return the exit code: 1 if there are too few runs for an answer, or it cannot be written.
    """
    scenario, factors = _question(chosen, options)
    with _progress(chosen) as tell:
        result = sensitivity(scenario, factors, options, tell, is_stopped)
    _print(result, chosen.progress == "json")
    are_written = not unwritten(_files(chosen, result), result)
    is_told = tell_if_lost()
    if result.effects and are_written and is_told:
        return FINISHED
    return FAILED


def _question(chosen: StudyArguments, options: StudyOptions) -> tuple[Scenario, Sequence[Factor]]:
    """Return the scenario and the values to move. Raises ScenarioError with all that is wrong."""
    problems = chosen.problems()
    for name, why in _NOT_OF_A_SENSITIVITY.items():
        if getattr(chosen, name) is not None:
            problems.append(Problem(f"--{name.replace('_', '-')}", why))
    if is_farm(chosen.scenario):
        text = "is of one orchard; ask it of each block"
        raise ScenarioError([*problems, Problem("--sensitivity", text)])
    scenario, faults = read_scenario(chosen.scenario)
    factors, of_factors = factors_of(scenario, chosen.vary or [])
    problems += [*of_factors, *problems_of_files(chosen, options)]
    if not of_factors and not faults:
        problems += sensitivity_problems(scenario, factors, options)
    if problems or faults:
        raise ScenarioError([*problems, *faults])
    return scenario, factors


@contextmanager
def _progress(chosen: StudyArguments) -> Iterator[Callable[[float], None]]:
    """Show which share of the runs is done."""
    if chosen.progress == "json":
        yield _tell_json
        return
    with bar(TextColumn("{task.description}", markup=False)) as shown:
        task = shown.add_task("starts its workers", total=1.0)

        def tell(share: float) -> None:
            words = f"{100.0 * share:.0f} % of the runs"
            shown.update(task, completed=share, description=words)

        yield tell


def _tell_json(share: float) -> None:
    """Print which share of the runs is done as a line of JSON."""
    console.print(json.dumps({"runs_done": share}), markup=False, soft_wrap=True)


def _print(result: SensitivityResult, as_json: bool) -> None:
    """Print the answer, the table and the notes."""
    if as_json:
        line = json.dumps({"sensitivity": asdict(result)})
        console.print(line, markup=False, soft_wrap=True)
    else:
        console.print(result.answer, markup=False, soft_wrap=not console.is_terminal)
        if result.effects:
            console.print(as_table(result))
        for note in result.notes:
            print_line(f"- {note}")
    if result.stopped_by == "stopped":
        print_error(STOPPED)
    elif not result.effects and result.stopped_by == "budget":
        print_error("the budget is too short: --budget")


def _files(chosen: StudyArguments, result: SensitivityResult) -> dict[Path, Save]:
    """Return the files that are wanted, each with the function that writes it.

    Without effects only the summary is written.
    """
    wanted: dict[Path | None, Save] = {chosen.summary: _save_summary}
    if result.effects:
        wanted |= {
            chosen.picture: partial(_save_by, "picture", "save"),
            chosen.csv: partial(_save_by, "files", "save_csv"),
            chosen.report: partial(_save_by, "files", "save_report"),
        }
    return {path: save for path, save in wanted.items() if path is not None}


def _save_summary(result: SensitivityResult, path: Path) -> None:
    """Write a result as JSON. Raises OSError."""
    write_summary(path, asdict(result))


def _save_by(module: str, name: str, result: SensitivityResult, path: Path) -> None:
    """Write a result by a function of a module of this package.

    The module is imported only now: it loads matplotlib, which takes half a second.
    """
    save: Save = getattr(import_module(f"orchard.study.sensitivity.{module}"), name)
    save(result, path)
