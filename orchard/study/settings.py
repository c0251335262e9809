"""The settings of a study: what `--vary KEY=VALUES` means, each combination of values as a scenario, and the numbers of carriers to try."""

import json
import re
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from math import ceil, prod
from types import MappingProxyType
from typing import Any

from orchard.field.layout import lay_out
from orchard.field.problems import Problem, ScenarioError, show
from orchard.field.queue import MOST_CARRIERS
from orchard.field.scenario import Scenario, with_changes
from orchard.report.bounds import Bounds
from orchard.terminal.values import value_of

MOST_SETTINGS = 10_000
MOST_NAMED = 3  # values that have one fault
SEED = "seed"
CARRIERS = "carriers"

_RANGE = re.compile(r"(-?\d{1,9})\.\.(-?\d{1,9})(?:\.\.(\d{1,9}))?")

Varied = dict[str, list[Any]]


@dataclass(frozen=True)
class Setting:
    """One combination of the values that vary, and the scenario that has them."""

    values: dict[str, Any]
    scenario: Scenario

    @cached_property
    def words(self) -> str:
        """The setting as a user would type it: "carriers=9, dispatch=predictive"."""
        return ", ".join(
            f"{key}={value if isinstance(value, str) else show(value)}"
            for key, value in self.values.items()
        )

    @property
    def is_random(self) -> bool:
        """Whether two seeds can give two results."""
        scenario = self.scenario
        guests = [*scenario.people.model_dump().values(), *scenario.animals.model_dump().values()]
        guests += scenario.own_classes.values()  # they may draw by the seed
        return (
            scenario.work_is_drawn
            or any(guests)
            or scenario.laser.noise > 0.0
            or not scenario.sensors.are_exact
        )

    @property
    def has_prices(self) -> bool:
        return any(price is not None for price in self.scenario.prices.model_dump().values())

    def cost_per_bin(self, bins_per_hour: float) -> float | None:
        """Return what a bin costs at a rate, in the currency of the prices; None without prices."""
        scenario, prices = self.scenario, self.scenario.prices
        if not self.has_prices:
            return None
        robots = scenario.pickers * (prices.picker_per_hour or 0.0) + scenario.carrier_count * (
            prices.carrier_per_hour or 0.0
        )
        return (robots + (prices.overhead_per_hour or 0.0)) / bins_per_hour + (
            prices.per_bin or 0.0
        )


def varied_of(words: Sequence[str]) -> tuple[Varied, list[Problem]]:
    """Return what `--vary` options say, as dotted path -> its values, and all faults of their form. Carriers alone have no values."""
    varied: Varied = {}
    problems = []
    for word in words:
        key, _, text = word.partition("=")
        key = key.strip()
        values = [] if word.strip() == CARRIERS else _values(text)
        if not key or isinstance(values, str):
            problems.append(
                Problem(f"--vary {word}", values if key and isinstance(values, str) else FORM)
            )
        elif key in varied:
            problems.append(
                Problem(
                    f"--vary {word}",
                    "this key varies already; give all its values in one --vary",
                    key,
                )
            )
        else:
            varied[key] = values
    return varied, problems


FORM = "must be KEY=VALUE,VALUE or KEY=FIRST..LAST, such as carriers=1..20; carriers alone: as many as it takes"


def _values(text: str) -> list[Any] | str:
    found: list[Any] = []
    with suppress(ValueError, RecursionError):  # values of JSON, as sections are, may have commas
        found = json.loads(f"[{text}]")
    for part in () if found else text.split(","):
        if not part.strip():
            return FORM
        span = _RANGE.fullmatch(part.strip())
        if span is None:
            found.append(value_of(part.strip()))
            continue
        first, last, step = int(span[1]), int(span[2]), int(span[3] or 1)
        if step < 1 or last < first:
            return f"{part}: this range is empty; the last number must be at least the first, and the step at least 1"
        if len(range(first, last + 1, step)) > MOST_SETTINGS:
            return f"{part}: more than {MOST_SETTINGS:,} values"
        found += range(first, last + 1, step)
    twice = (
        [value for i, value in enumerate(found) if value in found[:i]]
        if len(found) <= MOST_SETTINGS
        else []
    )
    return f"{twice[0]}: given twice" if twice else found


def settings_of(
    scenario: Scenario, varied: Mapping[str, Sequence[Any]]
) -> tuple[list[Setting], list[Problem]]:
    """Return each combination of the values that is a scenario, in order, and what is wrong with the others."""
    if found := _unusable(varied):
        return [], found
    settings: list[Setting] = []
    problems: dict[tuple[str, str], Problem] = {}
    values_of: dict[tuple[str, str], list[str]] = {}  # problem -> the values that have it
    for values in product(*varied.values()):
        setting = dict(zip(varied, values, strict=True))
        try:
            settings.append(Setting(setting, with_changes(scenario, **setting)))
        except ScenarioError as error:
            for problem in error.problems:
                key = problem.path, problem.text
                problems.setdefault(key, _placed(problem, setting, varied))
                of_key = values_of.setdefault(key, [])
                is_more = (
                    problem.value not in of_key if problem.path in varied else not of_key
                )  # else one setting is named
                if is_more and not problem.text.startswith("unknown key"):
                    of_key.append(problem.value)
    return settings, [
        replace(problem, value=_together(values_of[key])) for key, problem in problems.items()
    ]


def _together(values: Sequence[str]) -> str:
    more = len(values) - MOST_NAMED
    return ", ".join(values[:MOST_NAMED]) + (f" and {more} more" if more > 0 else "")


def _unusable(varied: Mapping[str, Sequence[Any]]) -> list[Problem]:
    count, problems = prod(len(values) for values in varied.values()), []
    if not 0 < count <= MOST_SETTINGS:
        text = (
            "no values"
            if not count
            else f"{count:,} settings; at most {MOST_SETTINGS:,} can be compared"
        )
        problems.append(Problem(_option(varied, ", ".join(varied)), text))
    if SEED in varied:
        problems.append(
            Problem(
                _option(varied, SEED), "each replication has its own seed; vary other keys", SEED
            )
        )
    return problems


def _placed(
    problem: Problem, setting: dict[str, Any], varied: Mapping[str, Sequence[Any]]
) -> Problem:
    """Return a problem of a setting with the `--vary` to which it belongs, or with the whole setting."""
    source = (
        _option(varied, problem.path)
        if problem.path in varied
        else f"the setting {Setting(setting, Scenario()).words}"
    )
    return Problem(source, problem.text, problem.path, problem.value)


def _option(varied: Mapping[str, Sequence[Any]], keys: str) -> str:
    values = list(varied.get(keys, []))
    if (
        len(values) > 2
        and all(type(value) is int for value in values)
        and values == list(range(values[0], values[-1] + 1))
    ):
        return f"--vary {keys}={values[0]}..{values[-1]}"
    return f"--vary {keys}" + (f"={','.join(map(str, values))}" if values else "")


# -- the numbers of carriers that a study tries if it is told none: first those about the bound's, then more until the answer lies inside

ALL_IT_TAKES: Mapping[str, Sequence[Any]] = MappingProxyType(
    {CARRIERS: ()}
)  # what varies if a study is told nothing
FEWER, MORE = 0.5, 1.5  # times the number in question, between which numbers are tried
STEPS = 4  # in which they come up to that number; those next to the answer follow


def most_carriers(scenario: Scenario) -> int:
    """Return for how many carriers the orchard has room."""
    return bisect_left(
        range(1, MOST_CARRIERS + 1), True, key=lambda number: not _has_room(scenario, number)
    )


def _has_room(scenario: Scenario, carriers: int) -> bool:
    try:
        with_changes(scenario, carriers=carriers)
    except ScenarioError:
        return False
    return True


def is_open(varied: Mapping[str, Sequence[Any]]) -> bool:
    """Whether a study chooses the numbers of carriers itself."""
    return CARRIERS in varied and not varied[CARRIERS]


def numbered(scenario: Scenario, varied: Mapping[str, Sequence[Any]]) -> dict[str, list[Any]]:
    """Return what varies, with the numbers of carriers with which an open study begins."""
    return {
        key: list(values) or (first_numbers(scenario) if key == CARRIERS else [])
        for key, values in varied.items()
    }


def first_numbers(scenario: Scenario) -> list[int]:
    """Return the numbers to begin with: about that which keeps pickers and unloading busy if there is no traffic."""
    most = most_carriers(scenario)
    try:
        terms = Bounds(lay_out(with_changes(scenario, carriers=1))).terms
    except ScenarioError:  # of an own class, which is reported elsewhere
        return [scenario.carrier_count]
    busy = min(most, ceil(min(terms["pickers"], terms["unloading"]) / terms["carriers"]))
    step = max(1, busy // STEPS)
    return list(range(max(1, int(FEWER * busy)), min(most, ceil(MORE * busy) + step) + 1, step))


def more_numbers(tried: Sequence[int], answer: int, most: int) -> list[int]:
    """Return the numbers to try as well, so that the answer has its neighbours, and is no end of what was tried.

    Each halves the gap below the answer; the one above follows when there is no gap."""
    below = max((number for number in tried if number < answer), default=0)
    next_one = answer + 1 if answer - below == 1 else (below + answer) // 2
    wanted = {next_one, *range(max(tried), ceil(MORE * answer) + 1, max(1, answer // STEPS))}
    return sorted(number for number in wanted - set(tried) if 1 <= number <= most)
