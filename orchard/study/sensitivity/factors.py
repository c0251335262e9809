"""The values that a sensitivity study moves, the factors, and the range of each.

A value is moved up and down by a share of what the scenario says, or through a range that the user
names. The shares below say how well such a value is known before a harvest. They are judgements. So
the answer names each range, and the user can give another one by `--vary`.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from math import floor, inf
from types import MappingProxyType
from typing import Any, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from orchard.field.problems import Problem, ScenarioError
from orchard.field.scenario import Scenario, other_ways, with_changes
from orchard.field.scenario.effect import with_effect
from orchard.field.scenario.sections import SPREADS
from orchard.field.scenario.ways import value_at
from orchard.study.settings import SEED
from orchard.study.spread import is_number

# The values that are moved if the user names none: key -> the share by which it is moved up and
# down. People pick 1.2 to 1.8 bins an hour, which is 1.5 and 20 %. A crop is estimated to about 15
# %. Machines keep their speeds within 10 %. How long people handle bins, and how much rows differ,
# is known least well. The width of rows, which is their spacing, is often assumed: most orchards
# are within 10 % of the usual one. A number of things is moved by at least one. If a scenario has
# more than MOST_FACTORS of these values, the last ones stay.
SHARES: Mapping[str, float] = MappingProxyType(
    {
        "picking_rate": 0.20,
        "picking_speed": 0.20,
        "metres_per_bin": 0.15,
        "bins_per_row": 0.15,
        "crop.tonnes_per_hectare": 0.15,
        "picking.spread.cv": 0.30,
        "picking.spread_of_pickers.cv": 0.30,
        "picking.spread_of_bins.cv": 0.30,
        "picking.driving_speed": 0.10,
        "carriers": 0.10,
        "carrying.speed": 0.10,
        "carrying.battery.hours": 0.20,
        "picking.failure.mean_between": 0.30,
        "carrying.failure.mean_between": 0.30,
        "handling.coupling": 0.30,
        "handling.uncoupling": 0.30,
        "handling.exchange": 0.30,
        "handling.unloading": 0.30,
        "load_out.speed": 0.10,
        "load_out.seconds": 0.30,
        "load_out.seconds_away": 0.20,
        "load_out.truck.every": 0.20,
        "row_width": 0.10,
    }
)
# The share of a value that the user names without a share, and that has none above.
USUAL_SHARE = 0.10
# Digits of a value that is moved: so it can be shown as it is.
DIGITS = 5
FORM = "must be KEY, KEY=LOW..HIGH or KEY=SHARE%, such as picking_rate=1.2..1.8 or carriers=20%"
# What would be right where no share of a value can be moved.
SAY_RANGE = "say KEY=LOW..HIGH"
# More factors would need more than a thousand harvests.
MOST_FACTORS = 16
_NUMBER = r"\s*(-?(?:\d+\.?\d*|\.\d+))\s*"
_RANGE = re.compile(rf"{_NUMBER}\.\.{_NUMBER}")
_SHARE = re.compile(rf"{_NUMBER}%\s*")
PICKER_RATES = "picker_rates"
# The rate, as a share of the usual one, of a picker that `picker_rates` does not name.
USUAL_RATE = 1.0
# Key of a spread -> the key of its distribution, which is "none" if there is no spread.
_OF_SPREADS = {f"picking.{key}.cv": f"picking.{key}.distribution" for key in SPREADS}


class FactorError(ValueError):
    """A value cannot be moved as `--vary` says: the text says why."""


@dataclass(frozen=True, kw_only=True)
class Factor:
    """A value that is moved. `low` and `high` are the ends of its range."""

    key: str
    low: float
    high: float
    #: Whether it is a number of things, such as carriers. Each whole number is equally likely.
    is_whole: bool = False

    def value(self, share: float) -> float:
        """Return the value at a share of the way from the low end to the high one, 0 to 1."""
        if self.is_whole:
            count = int(self.high - self.low) + 1
            return int(self.low) + min(count - 1, floor(share * count))
        return float(f"{self.low + share * (self.high - self.low):.{DIGITS}g}")

    def place(self, value: float) -> float:
        """Return where a value lies: -1 at the low end, 1 at the high one."""
        half = 0.5 * (self.high - self.low)
        return (value - self.low) / half - 1.0


def factors_of(scenario: Scenario, words: Sequence[str]) -> tuple[list[Factor], list[Problem]]:
    """Return the values to move, and what is wrong with the options `--vary`.

    `words`: of these options; [] for the values of SHARES that the scenario has.
    """
    if not words:
        return list(islice(_usual_factors(scenario), MOST_FACTORS)), []
    factors: list[Factor] = []
    problems = []
    for word in words:
        key = word.partition("=")[0].strip()
        try:
            factor = _factor_of(scenario, key, word)
            _demand_one_way(factor, factors)
            _demand_effect(scenario, factor)
        except FactorError as fault:
            problems.append(Problem(f"--vary {word}", str(fault), key))
        except ScenarioError as error:
            for problem in error.problems:
                problems.append(Problem(f"--vary {word}", problem.text, key))
        else:
            factors.append(factor)
    return factors, problems


def _usual_factors(scenario: Scenario) -> Iterator[Factor]:
    """Yield the values that are moved if the user names none."""
    taken: list[str] = []
    for key, share in SHARES.items():
        value = _known_value(scenario, key)
        is_other_way = any(spelling in taken for spelling in other_ways(key))
        if value is None or is_other_way or not _is_in_use(scenario, key):
            continue
        least, most = _limits(key)
        # A value at its limit is a default, not a measurement, and cannot be moved to both sides.
        if not value or value in (least, most):
            continue
        taken.append(key)
        yield _moved(key, value, share)


def _is_in_use(scenario: Scenario, key: str) -> bool:
    """Whether a scenario uses a value of SHARES, and does not take another one in its place."""
    if key in _OF_SPREADS:
        return bool(value_at(scenario, _OF_SPREADS[key]) != "none")
    if key == "row_width":
        # Surveyed rows have measured places.
        return scenario.survey is None
    # These three have a number even where they are not set, because it follows from other values:
    # the length of a row says how many metres fill a bin, and the speed of picking says the rate.
    # Then the other values are moved.
    follows = key in ("metres_per_bin", "bins_per_row", "picking_rate")
    return not follows or value_at(scenario, key) is not None


def _factor_of(scenario: Scenario, key: str, word: str) -> Factor:
    """Return the factor of an option `--vary`. Raises FactorError, or ScenarioError for a wrong
    key.

    `word`: the whole text. `key`: what stands before its "=".
    """
    _, equals, text = word.partition("=")
    if not key:
        raise FactorError(FORM)
    if key == SEED:
        raise FactorError("the luck of the seed is told in any case; leave it out")
    if _is_unknown_in_section(key):
        # This raises an error that names the possible keys, and the one that was probably meant.
        with_changes(scenario, **{key: 1})
    value = _known_value(scenario, key)
    if not _takes_numbers(key):
        raise FactorError("only a number can be moved; compare others without --sensitivity")
    bounds = _RANGE.fullmatch(text)
    if bounds is not None:
        return _ranged(key, float(bounds[1]), float(bounds[2]))
    if value is None:
        raise FactorError(f"it is not set, so no share of it can be moved; {SAY_RANGE}")
    share = SHARES.get(key, USUAL_SHARE)
    if equals:
        share = _share_of(text)
    if not value:
        raise FactorError(f"it is 0, and a share of 0 is 0; {SAY_RANGE}")
    factor = _moved(key, value, share)
    if factor.low >= factor.high:
        raise FactorError(f"{value:g} has no room to be moved; {SAY_RANGE}")
    return factor


def _share_of(text: str) -> float:
    """Return the share that a text names. Raises FactorError."""
    share = _SHARE.fullmatch(text)
    if share is None:
        raise FactorError(FORM)
    if not 0.0 < float(share[1]) < 100.0:
        raise FactorError("a share must be above 0 % and below 100 %")
    return float(share[1]) / 100.0


def _ranged(key: str, low: float, high: float) -> Factor:
    """Return a value that is moved through a range. Raises FactorError."""
    is_whole = _is_whole(key)
    if is_whole and not (low.is_integer() and high.is_integer()):
        raise FactorError("it is a number of things; the ends must be whole numbers")
    if low >= high:
        raise FactorError("this range is empty; the last number must be above the first")
    least, most = _limits(key)
    if low < least or high > most:
        raise FactorError(f"must lie between {least:g} and {most:g}")
    return Factor(key=key, low=low, high=high, is_whole=is_whole)


def _moved(key: str, value: float, share: float) -> Factor:
    """Return a value that is moved by a share, as far as its limits allow."""
    is_whole = _is_whole(key)
    step = share * value
    if is_whole:
        step = max(1.0, round(step))
    least, most = _limits(key)
    low = max(least, value - step)
    high = min(most, value + step)
    return Factor(key=key, low=_rounded(low), high=_rounded(high), is_whole=is_whole)


def _rounded(value: float) -> float:
    """Return a value to DIGITS digits."""
    return float(f"{value:.{DIGITS}g}")


def _demand_effect(scenario: Scenario, factor: Factor) -> None:
    """Raise FactorError if a value has no effect, wherever it stands in its range.

    Both ends of the range are checked. But a value that is the schema's default is never reported
    as having no effect, so an end that is the default is not checked. The ends differ, so at least
    one is checked.
    """
    default = _known_value(Scenario(), factor.key)
    faults = []
    for end in (factor.value(0.0), factor.value(1.0)):
        if end != default:
            faults.append(_why_in_vain(scenario, factor.key, end))
    if all(faults):
        raise FactorError(faults[0])


def _why_in_vain(scenario: Scenario, key: str, value: float) -> str:
    """Return why a value has no effect, and what would give it one; '' if it has an effect."""
    try:
        changed = with_changes(scenario, **{key: value})
    except ScenarioError:
        # A value that cannot stand with the others is reported later, with the points.
        return ""
    try:
        with_effect(changed, "--vary")
    except ScenarioError as error:
        for problem in error.problems:
            # `with_effect` names the value that has no effect, and then those that it needs.
            without_effect, *needed = problem.path.split(", ")
            if without_effect == key:
                return f"{problem.text}; set {' and '.join(needed)}"
    return ""


def _demand_one_way(factor: Factor, factors: Sequence[Factor]) -> None:
    """Raise FactorError if another factor has the same key, or a key that says the same."""
    for known in factors:
        if known.key == factor.key:
            raise FactorError("this key is moved already")
        if known.key in other_ways(factor.key):
            raise FactorError(f"{known.key} says the same in another way; move one of them")


# -- what a scenario knows of a key


def _known_value(scenario: Scenario, key: str) -> float | None:
    """Return the number that holds for a key; None if there is none."""
    section, _, name = key.rpartition(".")
    if section == PICKER_RATES:
        return scenario.picker_rates.get(name, USUAL_RATE)
    try:
        value = value_at(scenario, key)
    except AttributeError:
        return None
    if value is None:
        # A value that is not set may follow from others.
        value = scenario.chosen.get(key)
    if not is_number(value):
        return None
    return float(value)


def _field(key: str) -> FieldInfo | None:
    """Return the schema's field of a dotted path, also of a user's name in a map, such as
    `picker_rates.picker_01`; None if there is none.
    """
    inside: Any = Scenario
    field = None
    for name in key.split("."):
        if isinstance(inside, type) and issubclass(inside, BaseModel):
            field = inside.model_fields.get(name)
        elif get_origin(inside) is dict:
            field = FieldInfo.from_annotation(get_args(inside)[1])
        else:
            return None
        if field is None:
            return None
        inside = field.annotation
    return field


def _is_unknown_in_section(key: str) -> bool:
    """Whether a key is unknown, and the longest part of its path that is known is a section.

    A key below a value that is no section, such as `rows.x`, does not count: there an error of
    `with_changes` would be about `rows`, which is a right key. It is refused because it takes no
    numbers.
    """
    if _field(key) is not None:
        return False
    # The longest beginning of the path that is known.
    known = key.rpartition(".")[0]
    while known and _field(known) is None:
        known = known.rpartition(".")[0]
    kind: Any = Scenario
    if known:
        kind = _kind(known)
    return isinstance(kind, type) and issubclass(kind, BaseModel)


def _kind(key: str) -> Any:
    """Return the type of a key's values; None if it has no field of its own."""
    field = _field(key)
    if field is None:
        return None
    return field.annotation


def _takes_numbers(key: str) -> bool:
    """Whether the values of a key are numbers."""
    return _kind(key) in (int, float, int | None, float | None)


def _is_whole(key: str) -> bool:
    """Whether the values of a key are numbers of things."""
    return _kind(key) in (int, int | None)


def _limits(key: str) -> tuple[float, float]:
    """Return the least and the greatest value that the schema allows."""
    least = -inf
    most = inf
    field = _field(key)
    if field is not None:
        for limit in field.metadata:
            least = getattr(limit, "ge", least)
            most = getattr(limit, "le", most)
    return float(least), float(most)
