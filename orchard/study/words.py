"""Settings, keys, values and figures of a study in words.

`orchard.study.orchard_words` describes an orchard, and `orchard.study.answer_words` the answer.
"""

import re
from collections.abc import Mapping
from math import floor, log10
from typing import Any

from pydantic import BaseModel

from orchard.field.scenario import Scenario
from orchard.study.result import Goal, Interval

# What a study looks for -> the same in words.
GOALS = {
    "bins_per_hour": "most bins an hour",
    "cost_per_bin": "least cost of a bin",
    "harvest_seconds": "shortest harvest",
}
# The words after a figure of a goal.
UNITS: dict[Goal, str] = {
    "bins_per_hour": "bins an hour",
    "cost_per_bin": "a bin",
    "harvest_seconds": "s for the harvest",
}
# Keys of a scenario whose value is said before their name: "9 carriers".
COUNTED = (
    "rows",
    "pickers",
    "carriers",
    "bays",
    "people.workers",
    "people.visitors",
    "animals.dogs",
    "animals.cats",
    "weeds",
)
# Keys that are not named in words, because their value says enough, with the words about the value.
PHRASES = {
    "dispatch": "with {}",
    "rows_to_pickers": "with {} rows",
    "order_in_row": "{} in rows",
    "route": "on {}",
}
# As a share of the mean: an interval that is not wider has no width, but for rounding.
SAME = 1e-9
# A spread below this, but for its power of ten, keeps two digits, such as 0.16; others keep one.
TWO_DIGITS = 2.0


def setting_words(setting: Mapping[str, Any]) -> str:
    """Return a setting in words: '9 carriers with predictive on two-way, picking speed 0.03'."""
    counts = ", ".join(counted(key, setting[key]) for key in COUNTED if key in setting)
    choices = [words.format(setting[key]) for key, words in PHRASES.items() if key in setting]
    first = " ".join(filter(None, [counts, *choices]))
    # Without a number before it a phrase needs no "with" or "on".
    parts = [first.removeprefix("with ").removeprefix("on ")]
    for key, value in setting.items():
        if key not in COUNTED and key not in PHRASES:
            parts.append(f"{key_words(key)} {value_words(value, key)}")
    return ", ".join(filter(None, parts)) or "this scenario"


def counted(key: str, number: object) -> str:
    """Return a number of things: '9 carriers', '1 worker'."""
    things = key.rpartition(".")[2]
    if number == 1:
        things = things.removesuffix("s")
    return f"{value_words(number)} {things}"


def key_words(key: str) -> str:
    """Return the words for a key of the scenario: 'picking speed', 'people workers'."""
    return key.replace("_", " ").replace(".", " ")


def axis_words(key: str) -> str:
    """Return the words for a key with the unit of its description: 'picking speed, m/s'."""
    words = key_words(key)
    unit = re.search(r", (m/s|m|s)(?=;|$)", _description(key))
    if unit is None:
        return words
    return words + unit.group(0)


def _description(key: str) -> str:
    """Return the description of a key in the scenario's schema; '' if there is no such key."""
    model: Any = Scenario
    words = ""
    for name in key.split("."):
        is_section = isinstance(model, type) and issubclass(model, BaseModel)
        if not is_section or name not in model.model_fields:
            return ""
        field = model.model_fields[name]
        model = field.annotation
        words = field.description or ""
    return words


def value_words(value: object, key: str = "") -> str:
    """Return a value of a setting in words: '0.03', 'predictive'.

    `key`: its description says what None means, such as 'never'.
    """
    if value is None:
        return none_words(_description(key))
    if isinstance(value, float):
        return f"{value:g}"
    return str(value)


def none_words(description: str) -> str:
    """Return the words for None that a description of a key gives; 'automatic' if it gives none.

    A description gives them as `null: never` or `null: no days` at the end of a sentence.
    """
    meaning = re.search(r"null: ((?:no )?\w+)(?:\.|$)", description)
    if meaning is None:
        return "automatic"
    return meaning.group(1)


def number_words(value: float, spread: float = 0.0) -> str:
    """Return a number with the digits that its spread leaves: 84.1 for a spread of 0.6, and 1,217
    for 12. Without a spread it has three digits, and at most three places after the point.
    """
    # The size of the last digit to show is this, rounded down to a power of ten.
    size = abs(value) / 100.0
    if spread:
        size = spread / TWO_DIGITS
    places = 0
    if size:
        places = min(3, max(0, -floor(log10(size))))
    return f"{value:,.{places}f}"


def interval_words(interval: Interval | None, sign: str = " ± ") -> str:
    """Return a mean with the larger half of its interval: '84.1 ± 0.6'.

    It is '84.1' if the interval has no width, and '' for None. `sign`: between the two numbers.
    """
    if interval is None:
        return ""
    half = max(interval.high - interval.mean, interval.mean - interval.low)
    if half <= abs(interval.mean) * SAME:
        return number_words(interval.mean)
    return number_words(interval.mean, half) + sign + number_words(half, half)
