"""The entries of the form: a value of a scenario each, with its label, its limits and its words.

They follow from the fields of `Scenario`: so a new value of a scenario has its control by itself.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, reduce
from math import floor, inf, log10
from typing import Any, NamedTuple, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from orchard.app.own_classes import AGENTS
from orchard.app.typed_numbers import number_of, shown
from orchard.app.typed_pickers import absences_of, pickers_shown, rates_of
from orchard.app.typed_times import breaks_of, breaks_shown, time_of
from orchard.field.scenario import Scenario
from orchard.field.survey import row_width_of, spacing_of
from orchard.study.words import none_words

# These come from a file, and are not entered on the page.
FROM_FILE = (*AGENTS, "survey")
# Sections with names that belong to the labels of their values.
NEEDED = ("laser", "odometry")
# Labels of values for which the words of the file are too short for a reader of the page.
LABELS = {
    "row_width": "Spacing of rows",
    "crop.tonnes_per_hectare": "Yield",
    "crop.kilograms_per_bin": "Fruit in a bin",
    "picking_rate": "Bins an hour each",
    "picker_rates": "How fast each is",
    "picker_absences": "Who is away",
    "rows_to_pickers": "Who picks which rows",
    "prices.picker_per_hour": "Price of a picker",
    "prices.carrier_per_hour": "Price of a carrier",
    "prices.overhead_per_hour": "Price of all else",
    "prices.per_bin": "Price of a bin",
    "dispatch": "Dispatch policy",
    "dispatch_errors": "After a refused order",
    "picking.spread.distribution": "Spread of times",
    "picking.spread.cv": "Deviation of times",
    "picking.spread_of_pickers.distribution": "Spread of pickers",
    "picking.spread_of_pickers.cv": "Deviation of pickers",
    "picking.spread_of_bins.distribution": "Spread of bins",
    "picking.spread_of_bins.cv": "Deviation of bins",
    "picking.failure.mean_between": "Time between failures",
    "picking.failure.mean_repair": "Time of a repair",
    "carrying.failure.mean_between": "Time between carriers' failures",
    "carrying.failure.mean_repair": "Time of a carrier's repair",
    "carrying.battery.hours": "Hours of a battery",
    "carrying.battery.standing": "Power while standing",
    "picking.driving_speed": "Pickers' driving speed",
    "carrying.speed": "Carriers' speed",
    "picking.turning": "Pickers' rate of turning",
    "carrying.turning": "Carriers' rate of turning",
    "handling.coupling": "Time to couple",
    "handling.uncoupling": "Time to uncouple",
    "handling.exchange": "Time with the empty bin",
    "handling.unloading": "Time at the bay",
    "bays": "Places at the bay",
    "load_out.metres": "Way to the load-out",
    "load_out.speed": "Speed to the load-out",
    "load_out.seconds": "Time at the load-out",
    "load_out.seconds_away": "Time away in all",
    "load_out.trailers.count": "Trailers at the bay",
    "load_out.trailers.bins": "Bins on a trailer",
    "shift.begin": "Work begins",
    "shift.end": "Work ends",
    "prices.picker_per_bin": "Piece rate of a bin",
    "prices.picker_least_per_day": "Least a picker gets a day",
    "prices.carrier_per_day": "Rent of a carrier",
    "prices.picker_bought.price": "Price of a robot picker",
    "prices.picker_bought.years": "Years of a robot picker",
    "prices.picker_bought.hours_per_year": "Hours a year of a robot picker",
    "prices.carrier_bought.price": "Price of a bought carrier",
    "prices.carrier_bought.years": "Years of a bought carrier",
    "prices.carrier_bought.hours_per_year": "Hours a year of a bought carrier",
    "prices.overhead_per_day": "Price of all else a day",
    "load_out.truck.every": "Time between trucks",
    "load_out.truck.bins": "Bins on the truck",
    "load_out.empty_bins": "Empty bins at the bay",
    "sensors.gnss.white": "GNSS error of a tick",
    "sensors.gnss.bias": "GNSS error, slow",
    "sensors.gnss.bias_time": "GNSS correlation time",
    "bay": "Bay moved east by",
}
# Units of values whose words name none.
UNITS = {
    "pickers": "people",
    "row_width": "m, from tree to tree",
    "prices.picker_per_hour": "an hour",
    "prices.carrier_per_hour": "an hour",
    "prices.overhead_per_hour": "an hour",
    "prices.per_bin": "each",
    "prices.picker_per_bin": "each",
    "prices.picker_least_per_day": "a day",
    "prices.carrier_per_day": "a day",
    "prices.picker_bought.price": "each",
    "prices.carrier_bought.price": "each",
    "prices.overhead_per_day": "a day",
    "shift.begin": "such as 7:00",
    "shift.end": "such as 16:30",
    "shift.breaks": "such as 12:00-12:45",
    "picker_rates": "such as picker 1: 0.5",
    "picker_absences": "such as picker 8: 0-4.5 h",
}
# What must be entered at a value that is no number, in words of the page.
WANTED = {
    "shift.begin": "must be a time of day such as 7:00",
    "shift.end": "must be a time of day such as 16:30",
    "shift.breaks": "must be begin and end of each break, such as 10:00-10:15, 12:00-12:45",
    "picker_rates": (
        "must be pickers and their shares of the usual rate, 0.05 to 20, such as picker 1: 0.5;"
        " picker 3: 120 %"
    ),
    "picker_absences": (
        "must be pickers and the hours of work, 0 to 2000, between which each is away, one"
        " absence after the other, such as picker 8: 0-4.5 h; picker 2: 17-25.5 h, 30-31 h"
    ),
}
# What reads the text of a map of pickers.
OF_PICKERS = {"picker_rates": rates_of, "picker_absences": absences_of}


class Measure(NamedTuple):
    """Another measure of a value: that of the page. `words`: its meaning, with the unit."""

    words: str
    to_page: Callable[[float], float]
    from_page: Callable[[float], float]


# Values that people measure otherwise than the scenario has them.
MEASURES = {
    "row_width": Measure(
        "spacing of rows, from one line of trees to the next, m", spacing_of, row_width_of
    ),
}
# The widest range of a slider. A value with a wider one gets a text field only.
WIDEST = 1e6


@dataclass(frozen=True)
class Entry:
    """A value that a user can set.

    `path`: dotted path in the scenario file. `words`: its description, with the unit. `kind`: int,
    float, bool, str, tuple for pairs of times, or dict for a map of pickers; a str is one of
    `choices`, or a class of the user's that a file names; without choices it is a time of day.
    `optional`: whether None is allowed, with which the program chooses the value. `low`, `high`:
    limits, both included, in the measure of the page.
    """

    path: str
    words: str
    kind: type
    optional: bool
    low: float = -inf
    high: float = inf
    choices: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """The name on the page, such as 'Row width' or 'Laser noise'."""
        if self.path in LABELS:
            return LABELS[self.path]
        before, _, name = self.path.rpartition(".")
        section = before.rpartition(".")[2]
        words = name.replace("_", " ")
        if section in NEEDED:
            words = f"{section} {words}"
        return words[0].upper() + words[1:]

    @property
    def none(self) -> str:
        """The word for no value."""
        return none_words(self.words)

    @property
    def unit(self) -> str:
        """The unit in the description, such as m or bins/h; '' if there is none."""
        if self.path in UNITS:
            return UNITS[self.path]
        match = re.search(r", (m/s|m|s|bins/h|t/ha|kg|degrees/s)(?=[;,]|$)", self.words)
        if not match:
            return ""
        return match.group(1)

    @property
    def step(self) -> float:
        """The step of the slider.

        A hundredth of the range, rounded up to 1, 2 or 5 times a power of ten.
        """
        if self.kind is int:
            return 1
        hundredth = (self.high - self.low) / 100
        power = 10.0 ** floor(log10(hundredth))
        # A hundredth may be a little more than a step, because of its last bits.
        least = hundredth * 0.999
        step = 10 * power
        for digit in (5, 2, 1):
            if digit * power >= least:
                step = digit * power
        # Without the last bits of the product: 0.3, and not 0.30000000000000004.
        return round(step, 10)

    @property
    def has_slider(self) -> bool:
        """Whether it is a number with a range that a slider can show."""
        return self.kind in (int, float) and self.high - self.low <= WIDEST

    @property
    def limits(self) -> str:
        """The limits and the unit as text, such as '0 to 0.02 m'; without a slider the unit."""
        if not self.has_slider:
            return self.unit
        return f"{self.low:g} to {self.high:g} {self.unit}".rstrip()

    @property
    def wanted(self) -> str:
        """What a value must be, in words: 'must be a number from 20 to 400 m'; '' for a choice.

        Limits are written with all their digits.
        """
        if self.path in WANTED:
            return WANTED[self.path] + self._or_none
        if self.kind not in (int, float):
            return ""
        noun = "a whole number" if self.kind is int else "a number"
        span = "" if self.low == -inf else f" from {shown(self.low)} to {shown(self.high)}"
        return f"must be {noun}{span} {self.unit}".rstrip() + self._or_none

    @property
    def _or_none(self) -> str:
        """What may be entered in place of a value, to append to what a value must be."""
        if not self.optional:
            return ""
        return f", or tick “{self.none}”"

    @property
    def is_time(self) -> bool:
        """Whether it is a time of day."""
        return self.kind is str and not self.choices

    def typed(self, entered: Any) -> Any:
        """Return what a text means here: a number, a time or breaks, if it is one; else the text.

        What is no text stays.
        """
        if not isinstance(entered, str):
            return self._whole(entered)
        if self.kind is tuple:
            return breaks_of(entered)
        if self.path in OF_PICKERS:
            return OF_PICKERS[self.path](entered)
        if self.is_time:
            return time_of(entered)
        return self._whole(number_of(entered))

    def _whole(self, number: Any) -> Any:
        """Return a whole number as an int, where one is wanted. All else stays."""
        if self.kind is int and isinstance(number, float) and number.is_integer():
            return int(number)
        return number

    def as_typed(self, value: Any) -> str:
        """Return a value of the scenario as a user types it, in its measure; a text as it is."""
        if isinstance(value, str):
            return value
        if self.kind is tuple:
            return breaks_shown(value)
        if self.kind is dict:
            return pickers_shown(value)
        if isinstance(value, bool):
            return str(value).lower()
        return shown(value)

    def to_page(self, value: Any) -> Any:
        """Return a value of the scenario in the measure of the page. What is no number stays."""
        is_measured = self.path in MEASURES and isinstance(value, int | float)
        if is_measured:
            return MEASURES[self.path].to_page(value)
        return value

    def from_page(self, value: Any) -> Any:
        """Return a value of the page in the measure of the scenario. What is no number stays."""
        is_measured = self.path in MEASURES and isinstance(value, int | float)
        if is_measured:
            return MEASURES[self.path].from_page(value)
        return value


@cache
def entries(model: type[BaseModel] = Scenario, before: str = "") -> dict[str, Entry]:
    """Return all entries by path, in the order of the file.

    `model`: the scenario, or a section of it. `before`: the path of the section, with a dot.
    """
    of_model: dict[str, Entry] = {}
    for name, field in model.model_fields.items():
        if name in FROM_FILE:
            continue
        path = before + name
        section = _section_of(field)
        if section is None:
            of_model[path] = _entry_of(path, field)
        else:
            of_model |= entries(section, f"{path}.")
    return of_model


def label_of(path: str) -> str:
    """Return the label of an entry; of anything else in a scenario, such as a class, its path."""
    if path in entries():
        return entries()[path].label
    return path


def _kinds_of(field: FieldInfo) -> tuple[Any, ...]:
    """Return the types that a value may have."""
    return get_args(field.annotation) or (field.annotation,)


def _section_of(field: FieldInfo) -> type[BaseModel] | None:
    """Return the section that stands at a field; None for a value."""
    kind = _kinds_of(field)[0]
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return kind
    return None


def _entry_of(path: str, field: FieldInfo) -> Entry:
    """Return the entry for a value of the scenario."""
    kinds = _kinds_of(field)
    container = get_origin(field.annotation)
    # pydantic keeps limits as objects of the classes Ge (greater or equal) and Le.
    limits = {type(limit).__name__: limit for limit in field.metadata}
    low = limits["Ge"].ge if "Ge" in limits else -inf
    high = limits["Le"].le if "Le" in limits else inf
    words = field.description or ""
    if path in MEASURES:
        measure = MEASURES[path]
        words = measure.words
        low = measure.to_page(low)
        high = measure.to_page(high)
    return Entry(
        path=path,
        words=words,
        kind=container if container in (tuple, dict) else kinds[0],
        optional=type(None) in kinds,
        low=low,
        high=high,
        # A field with choices names them as its examples.
        choices=tuple(map(str, field.examples or ())),
    )


def flat(scenario: Scenario) -> dict[str, Any]:
    """Return the values of a scenario that the page asks for, by path."""
    return {path: reduce(getattr, path.split("."), scenario) for path in entries()}


def words_of(path: str, value: Any) -> str:
    """Return a value of an entry as words for a person."""
    if value is None:
        return entries()[path].none
    if isinstance(value, list | tuple | dict):
        return entries()[path].as_typed(value) or "none"
    if isinstance(value, str):
        return value
    if isinstance(value, bool):
        if value:
            return "on"
        return "off"
    return shown(entries()[path].to_page(value))
