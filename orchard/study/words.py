"""How a setting, a figure and its interval are said: in the sentence, the table and the pictures."""

import re
from collections.abc import Collection, Mapping
from math import floor, log10
from typing import Any

from pydantic import BaseModel

from orchard.field.scenario import Scenario
from orchard.study.result import Interval

GOALS = {"bins_per_hour": "most bins an hour", "cost_per_bin": "least cost of a bin", "harvest_seconds": "shortest harvest"}
COUNTED = ("rows", "pickers", "carriers", "people.workers", "people.visitors", "animals.dogs", "animals.cats", "weeds")  # numbers of things
SAID = {"dispatch": "with {}", "rows_to_pickers": "with {} rows", "route": "on {}"}  # keys whose value says enough
SAME = 1e-9  # of the mean: an interval narrower than that is rounding
TWO_DIGITS = 2.0  # a spread that begins with a 1 keeps two digits, all others one


def setting_words(setting: Mapping[str, Any]) -> str:
    """Return a setting in words: '9 carriers with predictive on two-way, picking speed 0.03'."""
    counts = ", ".join(counted(key, setting[key]) for key in COUNTED if key in setting)
    choices = [words.format(setting[key]) for key, words in SAID.items() if key in setting]
    named = [f"{key_words(key)} {value_words(value)}" for key, value in setting.items() if key not in (*COUNTED, *SAID)]
    first = " ".join(filter(None, [counts, *choices])).removeprefix("with ").removeprefix("on ")
    return ", ".join(filter(None, [first, *named])) or "this scenario"


def orchard_words(scenario: Scenario, varied: Collection[str] = ()) -> str:
    """Return the orchard of a study in words, without the keys that vary: '20 rows of 49 m, 10 pickers, one-way, predictive dispatch'."""
    rows = "rows" if "rows" in varied else f"{scenario.rows} rows"
    length = ", as surveyed" if scenario.survey else "" if "row_length" in varied else f" of {scenario.row_length:g} m"
    words = {
        "pickers": counted("pickers", scenario.pickers),
        "carriers": counted("carriers", scenario.carrier_count),
        "route": scenario.route,
        "dispatch": f"{scenario.dispatch} dispatch",
    }
    return ", ".join([rows + length, *(said for key, said in words.items() if key not in varied)])


def counted(key: str, number: object) -> str:
    """Return a number of things: '9 carriers', '1 worker'."""
    things = key.rpartition(".")[2]
    return f"{value_words(number)} {things.removesuffix('s') if number == 1 else things}"


def key_words(key: str) -> str:
    """Return the words for a key of the scenario: 'picking speed', 'people workers'."""
    return key.replace("_", " ").replace(".", " ")


def axis_words(key: str) -> str:
    """Return the words for a key with its unit, as its description in the scenario has it: 'picking speed, m/s'."""
    found = re.search(r", (m/s|m|s)(?=;|$)", _description(key))
    return key_words(key) + (found.group(0) if found else "")


def _description(key: str) -> str:
    """The description of a dotted key of the scenario; '' for a key that it does not have."""
    model: Any = Scenario
    words = ""
    for name in key.split("."):
        field = model.model_fields.get(name) if isinstance(model, type) and issubclass(model, BaseModel) else None
        model, words = (field.annotation, field.description or "") if field else (None, "")
    return words


def value_words(value: object) -> str:
    """Return a value of a setting: '0.03', 'predictive', 'automatic' for none."""
    return "automatic" if value is None else f"{value:g}" if isinstance(value, float) else str(value)


def number_words(value: float, spread: float = 0.0) -> str:
    """Return a number with the digits that its spread leaves: 84.1 for a spread of 0.6, 1,217 for one of 12; three digits without one."""
    size = spread / TWO_DIGITS or abs(value) / 100.0
    places = min(3, max(0, -floor(log10(size)))) if size else 0
    return f"{value:,.{places}f}"


def interval_words(interval: Interval | None, sign: str = " ± ") -> str:
    """Return a mean with the larger half of its interval: '84.1 ± 0.6'; '84.1' if all replications gave the same; '' for none."""
    if interval is None:
        return ""
    half = max(interval.high - interval.mean, interval.mean - interval.low)
    if half <= abs(interval.mean) * SAME:
        return number_words(interval.mean)
    return number_words(interval.mean, half) + sign + number_words(half, half)
