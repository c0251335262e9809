"""What each kind of study asks of its command line: a scenario, and files that can be written."""

from collections.abc import Iterator
from pathlib import Path

from orchard.field.problems import Problem, ScenarioError
from orchard.field.scenario import Scenario
from orchard.field.shipped import load_or_shipped
from orchard.study.command_options import StudyArguments
from orchard.study.options import StudyOptions
from orchard.study.store import fault_of
from orchard.terminal.files import check_writable, one_file


def read_scenario(path: Path | None) -> tuple[Scenario, list[Problem]]:
    """Return the scenario of a file, and what is wrong with it.

    Values that are wrong have their defaults, so that the rest can still be checked.
    """
    try:
        return load_or_shipped(path), []
    except ScenarioError as error:
        return error.rest or Scenario(), error.problems


def problems_of_files(chosen: StudyArguments, options: StudyOptions) -> list[Problem]:
    """Return what is wrong with the files that are to be written, the store among them."""
    store = options.store_file
    paths = [path for path, _ in chosen.files]
    problems = [*_unwritable(chosen), *one_file([*paths, store])]
    if store.exists():
        fault = fault_of(store, options.anew)
        if fault:
            problems.append(Problem(str(store), fault))
    return problems


def _unwritable(chosen: StudyArguments) -> Iterator[Problem]:
    """Yield what is wrong with files that are to be written."""
    for path, kind in chosen.files:
        try:
            check_writable(path, chosen.scenario, kind)
        except OSError as error:
            # Its text is "FILE: why".
            name, _, why = str(error).partition(": ")
            yield Problem(name, why)
