"""`orchard study` of a farm: what is asked, what is shown, and what is written."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path

from rich.progress import TextColumn

from orchard.field.problems import Problem, ScenarioError
from orchard.report.summary import write_summary
from orchard.study.asking import problems_of_files
from orchard.study.command_options import StudyArguments
from orchard.study.ending import STOPPED, tell_if_lost, unwritten
from orchard.study.farm import FarmResult, farm_study
from orchard.study.farm_file import Farm, read_farm
from orchard.study.farm_words import answer, as_table
from orchard.study.options import StudyOptions
from orchard.study.result import StudyResult
from orchard.study.settings import CARRIERS, Varied, varied_of
from orchard.terminal.exits import FAILED, FINISHED
from orchard.terminal.output import bar, console, print_error, print_line

# Option that a farm cannot have -> why.
_NOT_OF_A_FARM = {
    "csv": "has no table of a farm; --summary writes all its figures",
    "picture": "draws one orchard, and a farm's blocks are no one picture; draw each block",
    "report": "tells of one orchard; write one of each block, or --summary of the farm",
    "finish_within": "is of one orchard; the table has the time of the farm",
    "finish_by": "is of one orchard; the table has the time of the farm",
}
_GOALS = ("harvest_seconds", "bins_per_hour")


def farm_question(chosen: StudyArguments, options: StudyOptions) -> tuple[Farm, Varied]:
    """Return the farm and what varies. Raises ScenarioError with all that is wrong."""
    assert chosen.scenario is not None
    varied, problems = varied_of(chosen.vary or [CARRIERS])
    for name, why in _NOT_OF_A_FARM.items():
        if getattr(chosen, name) is not None:
            problems.append(Problem(f"--{name.replace('_', '-')}", why))
    if chosen.horizon == "long":
        text = "a farm is harvested once; leave out --horizon"
        problems.append(Problem("--horizon long", text))
    if isinstance(chosen.goal, str) and chosen.goal not in _GOALS:
        text = "a farm is asked for its time; leave out --goal"
        problems.append(Problem(f"--goal {chosen.goal}", text))
    problems += [*chosen.problems(), *problems_of_files(chosen, options)]
    try:
        farm = read_farm(chosen.scenario, list(varied))
    except ScenarioError as error:
        raise ScenarioError([*problems, *error.problems]) from None
    if problems:
        raise ScenarioError(problems)
    return farm, varied


def run_farm(
    chosen: StudyArguments,
    options: StudyOptions,
    is_stopped: Callable[[], bool],
) -> int:
    """Study a farm, print and write its answer. Return the exit code."""
    farm, varied = farm_question(chosen, options)
    with _progress(chosen, len(farm.blocks)) as tell:
        result = farm_study(farm, varied, options, tell, is_stopped)
    result = replace(result, answer=answer(result))
    if chosen.progress == "json":
        console.print(json.dumps({"farm": asdict(result)}), markup=False, soft_wrap=True)
    else:
        console.print(result.answer, markup=False, soft_wrap=not console.is_terminal)
        if result.table:
            console.print(as_table(result))
        for note in result.notes:
            print_line(f"- {note}")
    if result.stopped_by == "stopped":
        print_error(STOPPED)
    files = {}
    if chosen.summary is not None:
        files[chosen.summary] = _save_summary
    are_written = not unwritten(files, result)
    is_told = tell_if_lost()
    for violation in result.violations:
        print_error(violation)
    if not result.table and not result.failed and result.stopped_by == "budget":
        print_error("the budget is too short for one run in each block: --budget")
    is_sound = result.table and not result.violations and not result.failed
    if is_sound and are_written and is_told:
        return FINISHED
    return FAILED


def _save_summary(result: FarmResult, path: Path) -> None:
    """Write a result as JSON. Raises OSError."""
    write_summary(path, asdict(result))


@contextmanager
def _progress(chosen: StudyArguments, blocks: int) -> Iterator[Callable[[str, StudyResult], None]]:
    """Show which block is studied."""
    if chosen.progress == "json":
        yield _tell_json
        return
    with bar(TextColumn("{task.description}", markup=False)) as shown:
        task = shown.add_task("starts its workers", total=chosen.budget / blocks)

        def tell(name: str, partial: StudyResult) -> None:
            words = f"{name}: {len(partial.table)} settings"
            shown.update(task, completed=partial.wall_seconds, description=words)

        yield tell


def _tell_json(name: str, partial: StudyResult) -> None:
    """Print what is known of a block as a line of JSON."""
    line = {"block": name, "study": asdict(partial)}
    console.print(json.dumps(line), markup=False, soft_wrap=True)
