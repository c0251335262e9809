"""Values of single pickers as a user types them: "picker 8: 0-4.5 h; picker 2: 17-25.5 h".

A semicolon parts pickers. A comma and a space, or "and", part the absences of one picker; a comma
before a digit is a decimal sign.
"""

import re
from collections.abc import Callable
from typing import TypeVar

from orchard.app.typed_numbers import number_of, shown
from orchard.field.kinds import name_of

PICKER = re.compile(r"(?:picker[ _]?)?0*([1-9][0-9]?)", re.IGNORECASE)
# From and to, in hours of work.
ABSENCE = re.compile(r"(?:from +)?([0-9.,]+) *h? *(?:-|\u2013|to) *([0-9.,]+) *(?:h|hours)?")
BETWEEN_ABSENCES = re.compile(r", +| +and +")
PERCENT = 100.0
# What is said of one picker.
_Value = TypeVar("_Value")


def rates_of(text: str) -> dict[str, float] | str:
    """Return the rate of each picker as a share of the usual one; the text, stripped, if it is
    something else.

    >>> rates_of("picker 1: 0.5; picker 12: 80 %"), rates_of("one is slow")
    ({'picker_01': 0.5, 'picker_12': 0.8}, 'one is slow')
    """
    return _by_picker(text, _rate_of)


def absences_of(text: str) -> dict[str, list[list[float]]] | str:
    """Return the absences of each picker, in hours of work; the text, stripped, if it is
    something else.

    >>> absences_of("picker 8: 0-4,5 h, 17-25.5 h")
    {'picker_08': [[0.0, 4.5], [17.0, 25.5]]}
    """
    return _by_picker(text, _absences_of_one)


def _by_picker(text: str, value_of: Callable[[str], _Value | None]) -> dict[str, _Value] | str:
    """Return the value of each picker; the text, stripped, if it has anything else, or a picker
    twice.

    `value_of`: reads what is typed of a picker, and returns None if that has no meaning.
    """
    text = text.strip()
    values = dict[str, _Value]()
    for part in text.split(";"):
        if not part.strip():
            continue
        who, _, words = part.partition(":")
        match = PICKER.fullmatch(who.strip())
        value = value_of(words.strip())
        if match is None or value is None:
            return text
        name = name_of("picker", int(match[1]))
        if name in values:
            return text
        values[name] = value
    return values


def _rate_of(words: str) -> float | None:
    """Return a share that is typed as 0.5 or 50 %; None for all else."""
    number = number_of(words.removesuffix("%"))
    if isinstance(number, str):
        return None
    if words.endswith("%"):
        return number / PERCENT
    return float(number)


def _absences_of_one(words: str) -> list[list[float]] | None:
    """Return from and to of each absence; None for something else."""
    absences = []
    for part in BETWEEN_ABSENCES.split(words):
        match = ABSENCE.fullmatch(part.strip())
        if match is None:
            return None
        begin = number_of(match[1])
        end = number_of(match[2])
        if isinstance(begin, str) or isinstance(end, str):
            return None
        absences.append([float(begin), float(end)])
    return absences


def pickers_shown(values: object) -> str:
    """Return rates or absences of pickers as a user types them. A text stays as it is.

    >>> pickers_shown({"picker_08": [[0.0, 4.5]]}), pickers_shown({"picker_01": 0.5})
    ('picker 8: 0-4.5 h', 'picker 1: 0.5')
    """
    if isinstance(values, str):
        return values
    if not isinstance(values, dict):
        return ""
    return "; ".join(f"{_name_shown(name)}: {_shown(value)}" for name, value in values.items())


def _name_shown(name: str) -> str:
    """Return the name of a picker as people say it: picker 8 of picker_08."""
    kind, _, number = name.partition("_")
    return f"{kind} {int(number)}"


def _shown(value: float | list[list[float]]) -> str:
    """Return the rate or the absences of a picker."""
    if not isinstance(value, list | tuple):
        return shown(value)
    absences = []
    for begin, end in value:
        absences.append(f"{shown(begin)}-{shown(end)} h")
    return ", ".join(absences)
