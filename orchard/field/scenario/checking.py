"""Makes a scenario from values, or raises an error with all of their problems at once."""

from collections.abc import Mapping
from copy import deepcopy
from typing import Any

from pydantic import BaseModel, ValidationError

from orchard.field.problems import (
    Lines,
    Problem,
    ScenarioError,
    errors_of,
    key_text,
    problems_of,
    show,
)
from orchard.field.scenario.rules import SURVEYED, Scenario

# Maps of which the keys are names that a user gives, and not fields of a section.
NAMED_BY_USERS = ("picker_rates", "picker_absences", "agents", "agents_without_body")


def check(
    values: Any,
    source: str = "scenario",
    lines: Lines | None = None,
    known: list[Problem] | None = None,
) -> Scenario:
    """Return the scenario with these values: a map, as in the YAML file.

    `source`: names the values in problems, as a file's name does. `lines`: the line of each key, if
    they come from a file. `known`: problems that were found before. Raises a `ScenarioError` with
    all problems, including the known ones.

    >>> check({"rows": 8, "people": {"workers": 2}}).people.workers
    2
    >>> check({"rowz": 8}, "my.yaml")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    orchard.field.problems.ScenarioError: my.yaml: rowz = 8: unknown key; did you mean rows? ...
    """
    problems = list(known or [])
    if not isinstance(values, Mapping | BaseModel):
        text = f"must be a map of keys and values, and not {show(values)}"
        raise ScenarioError([*problems, Problem(source, text)])
    errors, scenario = _errors(_plain(values))
    problems += problems_of(errors, Scenario, source, lines or {})
    if problems:
        raise ScenarioError(problems, scenario)
    return scenario


def _plain(values: Any, levels: int = 3) -> Any:
    """Return sections and maps as dicts with printable text as keys, down to some levels.

    `levels`: how many maps lie within each other. A scenario has at most three.
    """
    if isinstance(values, BaseModel):
        values = values.model_dump()
    if levels == 0 or not isinstance(values, Mapping):
        return values
    return {key_text(key): _plain(value, levels - 1) for key, value in values.items()}


def _errors(values: dict[str, Any]) -> tuple[list[dict[str, Any]], Scenario]:
    """Return all errors of `errors_of`, and the scenario without the fields of these errors.

    Pydantic ends at the first broken rule about several fields, and checks no rule if a field is
    invalid. So the fields of all errors are set to their defaults, which break no rule, and all is
    checked again, until every rule has been checked.
    """
    errors: list[dict[str, Any]] = []
    # Paths of the fields that have been set to their defaults.
    wrong: set[tuple[str, ...]] = set()
    while True:
        try:
            return errors, Scenario.model_validate(values)
        except ValidationError as failure:
            current = errors_of(failure)
        # An error about a field that was wrong before follows from its default, and is not told.
        errors += [error for error in current if wrong.isdisjoint(error["fields"])]
        newly_wrong: set[tuple[str, ...]] = set()
        for error in current:
            for field in error["fields"]:
                newly_wrong.update(_with_defaults(field))
        wrong |= newly_wrong
        values = _without(values, newly_wrong)


def _with_defaults(field: tuple[str, ...]) -> list[tuple[str, ...]]:
    """Return the paths of all that is set to its default because a field is wrong.

    That is the field, or the whole map or list in which it lies where its parts have no default.
    A survey must fit the fields that it decides, so it goes with them.
    """
    if field[0] == "picker_absences":
        return [("picker_absences",)]
    if field[0] == "survey":
        return [("survey",)]
    if field[:2] == ("shift", "breaks"):
        return [("shift", "breaks")]
    if field[0] in SURVEYED:
        return [field, ("survey",)]
    return [field]


def _without(
    values: dict[str, Any], paths: set[tuple[str, ...]], at: tuple[str, ...] = ()
) -> dict[str, Any]:
    """Return the values without those at some paths. `at`: the path of the values themselves."""
    kept = {}
    for key, value in values.items():
        path = (*at, key)
        if path in paths:
            continue
        if isinstance(value, dict):
            kept[key] = _without(value, paths, path)
        else:
            kept[key] = value
    return kept


def with_changes(scenario: Scenario, /, **changes: Any) -> Scenario:
    """Return a scenario with some values changed, checked again.

    Raises `ScenarioError`. Name a nested value by its dotted path, or give a map of changes to a
    section. An empty map empties `picker_rates` and the other maps of names that a user gives.

    >>> with_changes(Scenario(), rows=8, people={"workers": 0}).people.workers
    0
    >>> with_changes(Scenario(), **{"people.workers": 0}).people.visitors
    3
    """
    values = scenario.model_dump()
    for path, value in changes.items():
        # {"people.workers": 0} becomes {"people": {"workers": 0}}.
        change = value
        for key in reversed(path.split(".")):
            change = {key: change}
        _merge(values, change)
    return check(values, "changes")


def _merge(values: dict[str, Any], changes: dict[str, Any]) -> None:
    """Put changes into values, also into the maps inside them. `values` is changed."""
    for key, change in changes.items():
        is_map = isinstance(change, dict) and isinstance(values.get(key), dict)
        empties_map = not change and key in NAMED_BY_USERS
        if is_map and not empties_map:
            _merge(values[key], change)
        else:
            # A copy, because later changes are put into it.
            values[key] = deepcopy(change)
