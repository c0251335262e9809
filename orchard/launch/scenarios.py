"""The scenario of a run, with the values that a user has typed as options."""

from collections.abc import Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from orchard.field.scenario import Scenario, with_changes, with_effect
from orchard.field.shipped import load_or_shipped
from orchard.terminal.exits import as_typed
from orchard.terminal.typed import named


def scenario_of(path: Path | None, changes: Mapping[str, Any]) -> Scenario:
    """Return the scenario of a file, or the default one, with what a user has typed as options.

    `changes`: name -> value; None: not given. Raises ScenarioError.
    """
    given = {name: value for name, value in changes.items() if value is not None}
    loaded = load_or_shipped(path)
    with _typed_as_options(given):
        return with_effect(with_changes(loaded, **given), "options")


def changed(scenario: Scenario, given: Mapping[str, Any]) -> Scenario:
    """Return a scenario with the values of options. Raises ScenarioError in their words."""
    with _typed_as_options(given):
        return with_changes(scenario, **given)


def _typed_as_options(given: Mapping[str, Any]) -> AbstractContextManager[None]:
    """Return a context in which problems name the options of these values."""

    def as_options(paths: str) -> str:
        """Return the keys of a problem, "rows, pickers", with options in place of those typed."""
        return ", ".join(named([path]) if path in given else path for path in paths.split(", "))

    return as_typed(as_options)
