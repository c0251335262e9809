"""`orchard study` of a farm: what is asked, what is shown, and what is written."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace

from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.progress import TextColumn
from rich.table import Table

from orchard.field.problems import Problem, ScenarioError
from orchard.report.summary import write_summary
from orchard.study.command_options import StudyArguments
from orchard.study.farm import FarmResult, FarmRow, farm_study
from orchard.study.farm_file import Farm, read_farm
from orchard.study.options import StudyOptions
from orchard.study.result import StudyResult
from orchard.study.settings import CARRIERS, Varied, varied_of
from orchard.study.table import MARKS, STYLES
from orchard.study.words import counted, interval_words, key_words, setting_words, value_words
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


def farm_question(chosen: StudyArguments) -> tuple[Farm, Varied]:
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
    problems += chosen.problems()
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
    farm, varied = farm_question(chosen)
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
    if chosen.summary is not None:
        write_summary(chosen.summary, asdict(result))
    for violation in result.violations:
        print_error(violation)
    if not result.table:
        print_error("the budget is too short for one run in each block: --budget")
        return FAILED
    if result.violations:
        return FAILED
    return FINISHED


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


def answer(result: FarmResult) -> str:
    """Return the answer in words: the best setting, its time and its rate."""
    best = result.best_row
    count = len(result.blocks)
    if not result.table:
        return "No setting has been run in every block yet."
    if best is None:
        return f"Each setting jams in one of the {count} blocks."
    names = ", ".join(result.blocks)
    words = (
        f"{setting_words(best.setting)}: {_hours(best)} h for {count} blocks ({names}) with"
        f" {counted('transfers', count - 1)} of {result.transfer_minutes:g} min,"
        f" {interval_words(best.bins_per_hour)} bins an hour"
    )
    within = f"{100.0 * result.within:g} %"
    unknown = result.settings_that_are("unknown")
    if unknown:
        others = "; ".join(map(setting_words, unknown))
        words += f"; more runs may tell whether within {within} of the shortest are: {others}"
    elif result.settings_that_are("equal") and best.setting.keys() == {CARRIERS}:
        words += f"; more carriers gain less than {within}"
    return f"{words}."


def _hours(row: FarmRow) -> str:
    """Return the time of the farm in hours."""
    seconds = row.seconds
    assert seconds is not None
    hours = replace(
        seconds,
        mean=seconds.mean / 3600.0,
        low=seconds.low / 3600.0,
        high=seconds.high / 3600.0,
    )
    return interval_words(hours)


def as_table(result: FarmResult) -> Table:
    """Return the table of a farm for a terminal."""
    most = max(max(row.replications.values()) for row in result.table)
    caption = (
        f"* the answer; = within {100.0 * result.within:g} % of the shortest; ? the runs do not"
        f" tell. Harvests in s, up to {most} runs in each block; ± interval of"
        f" {100.0 * result.confidence:g} % confidence."
    )
    table = Table(
        box=SIMPLE_HEAD, padding=0, show_edge=False, caption=caption, caption_justify="left"
    )
    keys = list(result.varied)
    for head in [*map(key_words, keys), *result.blocks, "farm, s", "bins/h"]:
        table.add_column(escape(head), overflow="fold")
    for row in result.table:
        cells = [value_words(row.setting[key], key) for key in keys]
        if cells:
            cells[0] = f"{cells[0]} {MARKS[row.standing]}".rstrip()
        for seconds in (*row.blocks.values(), row.seconds):
            cells.append(interval_words(seconds, sign=" ±") or "jammed")
        cells.append(interval_words(row.bins_per_hour, sign=" ±") or "-")
        table.add_row(*map(escape, cells), style=STYLES.get(row.standing, ""))
    return table
