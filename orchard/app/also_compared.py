"""One more setting that a study compares: its values as they are typed, and the option that they
become.
"""

import re
from typing import Any

from orchard.app.draft import Draft
from orchard.app.entries import entries
from orchard.app.typed_numbers import shown
from orchard.field.scenario import Scenario

COMPARED_LABEL = "Compare, too"
# A study on the page varies them by fields of their own, or never.
ELSEWHERE = ("carriers", "dispatch", "route", "seed")
# A comma before a digit is a decimal sign.
BETWEEN_VALUES = re.compile(r"; *|, +| +and +")
RANGE = re.compile(r"([0-9]{1,4}) *(?:-|\u2013|\.\.|to) *([0-9]{1,4})")
# Values that are compared, at most.
MOST_VALUES = 40
WHICH = "choose which setting has these values"
NO_VALUES = "enter the values to compare, such as 4-8, or 4, 6 and 8"
TOO_MANY = f"must be at most {MOST_VALUES} values"


def comparable() -> dict[str, str]:
    """Return the settings that can be compared: path -> label, in the order of the file."""
    labels = {}
    for path, entry in entries().items():
        is_number = entry.kind in (int, float)
        if path not in ELSEWHERE and (is_number or entry.choices):
            labels[path] = entry.label
    return labels


def values_of(path: str, text: str) -> list[Any]:
    """Return the values in a text, in the measure of the scenario. What is no value stays a text.

    `path`: of the setting. A whole number may be a range: 4-8.

    >>> values_of("pickers", "4-6, 8"), values_of("row_width", "4,5 and 5")
    ([4, 5, 6, 8], [4.0, 4.5])
    """
    entry = entries()[path]
    values: list[Any] = []
    for part in BETWEEN_VALUES.split(text.strip()):
        match = RANGE.fullmatch(part.strip())
        if entry.kind is int and match is not None and int(match[1]) < int(match[2]):
            values += range(int(match[1]), int(match[2]) + 1)
        else:
            values.append(entry.from_page(entry.typed(part)))
    return values


def compared_option(path: str, text: str) -> list[str]:
    """Return the option of `orchard study` that compares these values."""
    words = []
    for value in values_of(path, text):
        words.append(value if isinstance(value, str) else shown(value))
    return ["--vary", f"{path}={','.join(words)}"]


def problem_of_compared(path: str, text: str) -> str:
    """Return what is wrong whatever the scenario is; '' if nothing is, or nothing is entered."""
    if not path:
        return WHICH if text.strip() else ""
    if not text.strip():
        return NO_VALUES
    if len(values_of(path, text)) > MOST_VALUES:
        return TOO_MANY
    return ""


def problem_in(scenario: Scenario, path: str, text: str) -> str:
    """Return what is wrong with the first value that a scenario cannot have; '' if it can have all.

    `path`: of a setting, and not ''.
    """
    draft = Draft(scenario)
    for value in values_of(path, text):
        problems = draft.problems_with({path: value})
        if problems:
            return next(iter(problems.values()))
    return ""
