"""A link that holds a scenario: each value that differs from the default, as a query such as `rows=7&people.workers=2`."""

from collections.abc import Iterable
from difflib import get_close_matches
from typing import Any
from urllib.parse import urlencode

from orchard.app.draft import Draft, entries, flat, shown
from orchard.field.scenario import Scenario

ON_OFF = {"true": True, "false": False}


def query_of(scenario: Scenario) -> str:
    """Return the query for a scenario; '' for the default. It holds no own classes, which are code, and no survey."""
    default, own = flat(Scenario()), scenario.own_classes
    return urlencode({path: _words(value) for path, value in flat(scenario).items() if value != default[path] and path not in own})


def _words(value: Any) -> str:
    return value if isinstance(value, str) else str(value).lower() if isinstance(value, bool) else shown(value)


def draft_of(query: Iterable[tuple[str, str]]) -> tuple[Draft, list[str]]:
    """Return the draft that a link holds, and a message for each name that is no setting. The draft tells which values are wrong."""
    draft, values, unknown = Draft(Scenario()), {}, []
    for path, text in query:
        if path in entries():
            values[path] = ON_OFF.get(text, text) if entries()[path].kind is bool else text
        else:
            close = get_close_matches(path, entries(), 1)
            unknown.append(f"{path}: no such setting" + (f"; did you mean {close[0]}?" if close else ""))
    draft.enter(values)
    return draft, unknown
