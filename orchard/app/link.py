"""A link that holds a scenario: its query, and what of a query is understood."""

from collections.abc import Iterable
from difflib import get_close_matches
from typing import Any
from urllib.parse import urlencode

from orchard.app.draft import Draft
from orchard.app.entries import entries, flat
from orchard.field.problems import printable
from orchard.field.scenario import Scenario

ON_OFF = {"true": True, "false": False}
# Names of a link that are reported one by one.
MOST_UNKNOWN = 5
# Characters of a name in a report.
LONGEST_NAME = 60


def query_of(scenario: Scenario) -> str:
    """Return the query of a link to a scenario, with the values that differ from the default.

    Own classes and a survey are left out.
    """
    default = flat(Scenario())
    changed: dict[str, str] = {}
    for path, value in flat(scenario).items():
        if value != default[path] and path not in scenario.own_classes:
            changed[path] = entries()[path].as_typed(value)
    return urlencode(changed)


def draft_of(query: Iterable[tuple[str, str]]) -> tuple[Draft | None, list[str]]:
    """Return the draft that a link holds, and what is wrong with its names.

    The draft is None if the link names no setting.
    """
    values: dict[str, Any] = {}
    unknown: list[str] = []
    for path, text in query:
        if path not in entries():
            unknown.append(path)
        elif entries()[path].kind is bool:
            values[path] = ON_OFF.get(text, text)
        else:
            values[path] = text
    problems = [_no_such_setting(name) for name in unknown[:MOST_UNKNOWN]]
    if len(unknown) > MOST_UNKNOWN:
        problems.append(f"and {len(unknown) - MOST_UNKNOWN} more")
    if not values:
        return None, problems
    draft = Draft(Scenario())
    draft.enter(values)
    return draft, problems


def _no_such_setting(name: str) -> str:
    """Return what is wrong with a name, and the one that may be meant."""
    short = printable(name, LONGEST_NAME)
    close = get_close_matches(short, entries(), 1)
    advice = f"; did you mean {close[0]}?" if close else ""
    return f"{short}: no such setting{advice}"
