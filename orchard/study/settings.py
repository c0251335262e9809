"""The settings of a study: each combination of the values that vary, as a scenario.

This module also reads the option `--vary KEY=VALUES`, and chooses numbers of carriers for an open
study. A study is open if the user gives no numbers of carriers: it tries as many as it takes.
"""

import json
import re
from bisect import bisect_left
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import product
from math import ceil, prod
from types import MappingProxyType
from typing import Any

from orchard.field.layout import lay_out
from orchard.field.problems import Problem, ScenarioError, show
from orchard.field.queue import MOST_CARRIERS
from orchard.field.scenario import Scenario, with_changes
from orchard.report.bounds import Bounds
from orchard.report.costs import payments_of_harvest, payments_of_long_run
from orchard.report.days import WorkDays, work_days
from orchard.report.limits import full_bins, limit_of_question
from orchard.terminal.values import value_of

MOST_SETTINGS = 10_000
# How many values a message about a fault of several values names.
MOST_NAMED = 3
SEED = "seed"
CARRIERS = "carriers"

# FIRST..LAST or FIRST..LAST..STEP.
_RANGE = re.compile(r"(-?\d{1,9})\.\.(-?\d{1,9})(?:\.\.(\d{1,9}))?")

# Dotted path of a scenario -> its values in the settings; no values: the study chooses them.
Varied = dict[str, list[Any]]


@dataclass(frozen=True)
class Setting:
    """One combination of the values that vary, and the scenario that has them."""

    values: dict[str, Any]
    scenario: Scenario

    @cached_property
    def words(self) -> str:
        """The setting as a user would type it: "carriers=9, dispatch=predictive"."""
        parts = []
        for key, value in self.values.items():
            if isinstance(value, str):
                parts.append(f"{key}={value}")
            else:
                parts.append(f"{key}={show(value)}")
        return ", ".join(parts)

    @property
    def robots(self) -> int:
        """How many pickers and carriers there are."""
        return self.scenario.pickers + self.scenario.carrier_count

    @property
    def is_random(self) -> bool:
        """Whether two seeds can give two results."""
        scenario = self.scenario
        guests = [*scenario.people.model_dump().values(), *scenario.animals.model_dump().values()]
        # Own classes may draw by the seed.
        has_chance = bool(scenario.own_classes) or any(guests)
        has_noise = scenario.laser.noise > 0.0 or not scenario.sensors.are_exact
        return scenario.work_is_drawn or has_chance or has_noise

    def seeds_that_differ(self, count: int) -> int:
        """Return how many of `count` seeds can give different results: 1 without chance."""
        if self.is_random:
            return count
        return 1

    @cached_property
    def limit(self) -> Bounds:
        """Its limit without traffic, the same for all seeds. Raises ScenarioError."""
        return limit_of_question(self.scenario)

    @cached_property
    def full_share(self) -> float:
        """The full bins that the fruit of one harvest fills, as a share of its bins, which may be
        part full.
        """
        layout = lay_out(self.scenario)
        return full_bins(layout) / layout.bins

    @cached_property
    def days(self) -> WorkDays | None:
        """The days of its harvests; None if there is no shift.

        Only the longest job of a carrier matters, and that is the same for any number of carriers.
        So it is taken from the limit with one carrier, which is computed once for all settings.
        """
        if not self.scenario.shift.is_set:
            return None
        alone = self.scenario.model_copy(update={"carriers": 1, "queue_room": None})
        return work_days(self.scenario, limit_of_question(alone))

    @property
    def has_prices(self) -> bool:
        """Whether the scenario says what something costs."""
        return self.scenario.prices.are_set

    def payments(self, bins_per_hour: float, bins: int | None = None) -> dict[str, float]:
        """Return what a bin costs at a rate: key of a payment -> amount (`orchard.report.costs`).

        `bins`: of one harvest; None: the rate is that of the long run.
        """
        if bins is None:
            return payments_of_long_run(self.scenario, bins_per_hour, self.days)
        return payments_of_harvest(self.scenario, bins, bins_per_hour, self.days)

    def cost_per_bin(self, bins_per_hour: float, bins: int | None = None) -> float | None:
        """Return what a bin costs at a rate, in the currency of the prices; None without prices.

        `bins`: as in `payments`.
        """
        if not self.has_prices:
            return None
        return sum(self.payments(bins_per_hour, bins).values())


def have_prices(settings: Iterable[Setting]) -> bool:
    """Whether each of these settings says what something costs."""
    return all(setting.has_prices for setting in settings)


def is_possible(scenario: Scenario, changes: Mapping[str, Any]) -> bool:
    """Whether a scenario can have these values. `changes`: dotted path -> value."""
    try:
        with_changes(scenario, **changes)
    except ScenarioError:
        return False
    return True


class VaryError(ValueError):
    """What `--vary` says cannot be understood: the text says why."""


FORM = (
    "must be KEY=VALUE,VALUE or KEY=FIRST..LAST, such as carriers=1..20; "
    "carriers alone: as many as it takes, and with a deadline pickers alone too"
)


def varied_of(
    words: Sequence[str], open_keys: Sequence[str] = (CARRIERS,)
) -> tuple[Varied, list[Problem]]:
    """Return what `--vary` options say, and all faults of their form.

    `open_keys`: keys that may be given without values.
    """
    varied: Varied = {}
    problems = []
    for word in words:
        try:
            key, values = _key_and_values(word, open_keys)
        except VaryError as error:
            problems.append(Problem(f"--vary {word}", str(error)))
            continue
        if key in varied:
            text = "this key varies already; give all its values in one --vary"
            problems.append(Problem(f"--vary {word}", text, key))
        else:
            varied[key] = values
    return varied, problems


def _key_and_values(word: str, open_keys: Sequence[str]) -> tuple[str, list[Any]]:
    """Return the key of a `--vary`, and its values. Raises VaryError."""
    if word.strip() in open_keys:
        return word.strip(), []
    key, _, text = word.partition("=")
    if not key.strip():
        raise VaryError(FORM)
    return key.strip(), _values(text)


def _values(text: str) -> list[Any]:
    """Return the values that a text lists. Raises VaryError."""
    values = _json_values(text)
    if not values:
        for part in text.split(","):
            values += _values_of_part(part)
    # More values are refused later anyway, and comparing all of them would take long.
    if len(values) <= MOST_SETTINGS:
        for number, value in enumerate(values):
            if value in values[:number]:
                raise VaryError(f"{value}: given twice")
    return values


def _json_values(text: str) -> list[Any]:
    """Return the values of a text that is a JSON list without its brackets; none if it is not.

    A JSON value may have commas in it, as a section does: {"a": 1, "b": 2}.
    """
    try:
        return list(json.loads(f"[{text}]"))
    except (ValueError, RecursionError):
        return []


def _values_of_part(part: str) -> list[Any]:
    """Return the value or the range of values between two commas. Raises VaryError."""
    if not part.strip():
        raise VaryError(FORM)
    bounds = _RANGE.fullmatch(part.strip())
    if bounds is None:
        return [value_of(part.strip())]
    first = int(bounds[1])
    last = int(bounds[2])
    step = int(bounds[3] or 1)
    if step < 1 or last < first:
        raise VaryError(
            f"{part}: this range is empty; "
            "the last number must be at least the first, and the step at least 1"
        )
    values = range(first, last + 1, step)
    if len(values) > MOST_SETTINGS:
        raise VaryError(f"{part}: more than {MOST_SETTINGS:,} values")
    return list(values)


def settings_of(
    scenario: Scenario, varied: Mapping[str, Sequence[Any]]
) -> tuple[list[Setting], list[Problem]]:
    """Return each combination of the values that is a valid scenario, in order, and what is wrong
    with the other combinations, each fault once.
    """
    unusable = _unusable(varied)
    if unusable:
        return [], unusable
    settings: list[Setting] = []
    faults = _Faults(varied)
    for values in product(*varied.values()):
        setting = dict(zip(varied, values, strict=True))
        try:
            settings.append(Setting(setting, with_changes(scenario, **setting)))
        except ScenarioError as error:
            for problem in error.problems:
                faults.add(problem, setting)
    return settings, faults.problems()


def is_of_several_values(problem: Problem) -> bool:
    """Whether a problem is one of values together, of which each alone may be right."""
    return ", " in problem.path


def impossible_settings(
    settings: Sequence[Setting], varied: Mapping[str, Sequence[Any]]
) -> list[Setting]:
    """Return the combinations of values that are not among the settings. Their scenario is none of
    theirs: there is none.

    `settings`: as `settings_of` returns them, in order.
    """
    possible = iter(settings)
    following = next(possible, None)
    impossible = []
    for values in product(*varied.values()):
        setting = dict(zip(varied, values, strict=True))
        if following is not None and following.values == setting:
            following = next(possible, None)
        else:
            impossible.append(Setting(setting, Scenario()))
    return impossible


class _Faults:
    """What is wrong with settings: each fault once, with some of the values that have it."""

    def __init__(self, varied: Mapping[str, Sequence[Any]]) -> None:
        self._varied = varied
        # Path and text of a fault -> its problem, and the values that have it.
        self._problems: dict[tuple[str, str], Problem] = {}
        self._values: dict[tuple[str, str], list[str]] = {}

    def add(self, problem: Problem, setting: dict[str, Any]) -> None:
        """Add a problem of a setting."""
        key = problem.path, problem.text
        if key not in self._problems:
            self._problems[key] = _placed(problem, setting, self._varied)
            self._values[key] = []
        if self._tells_more(problem, self._values[key]):
            self._values[key].append(problem.value)

    def _tells_more(self, problem: Problem, known: Sequence[str]) -> bool:
        """Whether the message should name the value of a problem too.

        `known`: the values that it names already.
        """
        if problem.text.startswith("unknown key"):
            return False
        if problem.path in self._varied:
            return problem.value not in known
        # A fault at another key does not come from one value. One example is enough.
        return not known

    def problems(self) -> list[Problem]:
        """Return all problems, in the order in which they came."""
        problems = []
        for key, problem in self._problems.items():
            problems.append(replace(problem, value=_together(self._values[key])))
        return problems


def _together(values: Sequence[str]) -> str:
    """Return the first values that have a fault, and how many more have it, in words."""
    words = ", ".join(values[:MOST_NAMED])
    more = len(values) - MOST_NAMED
    if more > 0:
        words += f" and {more} more"
    return words


def _unusable(varied: Mapping[str, Sequence[Any]]) -> list[Problem]:
    """Return what is wrong with the values that vary, whatever the scenario is."""
    problems = []
    count = prod(len(values) for values in varied.values())
    all_keys = _option(varied, ", ".join(varied))
    if count == 0:
        problems.append(Problem(all_keys, "no values"))
    if count > MOST_SETTINGS:
        text = f"{count:,} settings; at most {MOST_SETTINGS:,} can be compared"
        problems.append(Problem(all_keys, text))
    if SEED in varied:
        text = "each replication has its own seed; vary other keys"
        problems.append(Problem(_option(varied, SEED), text, SEED))
    return problems


def _placed(
    problem: Problem, setting: dict[str, Any], varied: Mapping[str, Sequence[Any]]
) -> Problem:
    """Return a problem of a setting with its source: the option `--vary` that has its key, or else
    the whole setting.
    """
    if problem.path in varied:
        source = _option(varied, problem.path)
    else:
        source = f"the setting {Setting(setting, Scenario()).words}"
    return Problem(source, problem.text, problem.path, problem.value)


def _option(varied: Mapping[str, Sequence[Any]], keys: str) -> str:
    """Return the `--vary` of a key as a user types it, with a range where that is shorter."""
    values = list(varied.get(keys, []))
    if not values:
        return f"--vary {keys}"
    is_whole = all(type(value) is int for value in values)
    if len(values) > 2 and is_whole and values == list(range(values[0], values[-1] + 1)):
        return f"--vary {keys}={values[0]}..{values[-1]}"
    return f"--vary {keys}={','.join(map(str, values))}"


# -- the numbers of carriers that an open study tries
#
# The limit without traffic says how many carriers keep pickers and unloading busy. First come
# numbers about that one, then more, until the answer lies inside the range that was tried.

# What varies if the user does not say it: an open study.
ALL_IT_TAKES: Mapping[str, Sequence[Any]] = MappingProxyType({CARRIERS: ()})
# The first numbers are from FEWER times to MORE times that number. Chosen.
FEWER = 0.5
MORE = 1.5
# The distance between two of them is that number divided by STEPS, at least 1.
STEPS = 4


def most_carriers(scenario: Scenario) -> int:
    """Return for how many carriers the orchard has room."""
    # Numbers with room come first. So the place of the first one without room, counted from 0, is
    # how many have room.
    numbers = range(1, MOST_CARRIERS + 1)
    return bisect_left(numbers, True, key=partial(_lacks_room, scenario))


def _lacks_room(scenario: Scenario, carriers: int) -> bool:
    """Whether the orchard has no room for so many carriers."""
    return not is_possible(scenario, {CARRIERS: carriers})


def is_open(varied: Mapping[str, Sequence[Any]]) -> bool:
    """Whether a study chooses the numbers of carriers itself."""
    return CARRIERS in varied and not varied[CARRIERS]


def numbered(scenario: Scenario, varied: Mapping[str, Sequence[Any]]) -> dict[str, list[Any]]:
    """Return what varies, with the numbers of carriers with which an open study begins."""
    known = as_lists(varied)
    if is_open(varied):
        known[CARRIERS] = first_numbers(scenario)
    return known


def as_lists(varied: Mapping[str, Sequence[Any]]) -> dict[str, list[Any]]:
    """Return a copy of what varies, with lists of its own."""
    return {key: list(values) for key, values in varied.items()}


def first_numbers(scenario: Scenario) -> list[int]:
    """Return the numbers of carriers to begin with: about that which keeps pickers and unloading
    busy without traffic.
    """
    most = most_carriers(scenario)
    try:
        terms = limit_of_question(with_changes(scenario, carriers=1)).terms
    except ScenarioError:
        # An own class is wrong. `orchard.study.checking` reports it.
        return [scenario.carrier_count]
    busy = min(most, ceil(min(terms["pickers"], terms["unloading"]) / terms["carriers"]))
    step = max(1, busy // STEPS)
    first = max(1, int(FEWER * busy))
    last = min(most, ceil(MORE * busy) + step)
    return list(range(first, last + 1, step))


def more_numbers(tried: Sequence[int], answer: int, most: int) -> list[int]:
    """Return further numbers to try, so that the answer lies inside and both its neighbours are
    tried.

    One number halves the gap below the answer. If there is no gap it is the number above the
    answer. Others go on to MORE times the answer. `answer`: the best number so far. `most`: for how
    many carriers there is room.
    """
    below = max((number for number in tried if number < answer), default=0)
    neighbour = (below + answer) // 2
    if answer - below == 1:
        neighbour = answer + 1
    further = range(max(tried), ceil(MORE * answer) + 1, max(1, answer // STEPS))
    wanted = {neighbour, *further}
    return sorted(number for number in wanted - set(tried) if 1 <= number <= most)
