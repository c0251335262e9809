"""What a user has entered: the entries of a scenario, their values, and what is wrong with each."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache, reduce
from math import floor, inf, log10
from typing import Any, get_args
from urllib.parse import urlencode

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from orchard.app.own_classes import AGENTS, CHOICES
from orchard.behaviour.catalogue import check_plugins
from orchard.field.layout import lay_out
from orchard.field.problems import Problem, ScenarioError
from orchard.field.scenario import Scenario, with_changes, with_effect
from orchard.study.words import counted, none_words

WHOLE = re.compile(r"[-+]?[0-9]{1,29}")
DECIMAL = re.compile(r"[-+]?([0-9]{1,40}\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]{1,3})?")
WITH_COMMA = re.compile(r"[-+]?[0-9]*,[0-9]+")


def number_of(text: str) -> int | float | str:
    """Return the number in a text, or the text, stripped, if it is not a number."""
    text = text.strip()
    if WHOLE.fullmatch(text):
        return int(text)
    return float(text) if DECIMAL.fullmatch(text) else text


def shown(number: float) -> str:
    """Return a number as a user types it, with all its digits."""
    return str(number).removesuffix(".0")


def with_point(text: object) -> str:
    """Return a number that was typed with a comma as it is typed with a point; '' for all else."""
    is_number = isinstance(text, str) and WITH_COMMA.fullmatch(text.strip())
    return str(text).strip().replace(",", ".") if is_number else ""


def write_a_point(number: str) -> str:
    """Return advice to append to an error message.

    Only a number that is accepted may be advised.
    """
    return f"; write a point: {number}"


def span(limits: tuple[float, float]) -> str:
    return f"{limits[0]:g} to {limits[1]:.0f}"


def number_problem(text: str, limits: tuple[float, float], also: str = "") -> str:
    """Return the problem of a text, with the words `also`; '' if it is a number within the
    limits.
    """
    if _is_within(text, limits):
        return ""
    problem = f"must be a number from {span(limits)}{also}"
    meant = with_point(text)
    return problem + write_a_point(meant) if _is_within(meant, limits) else problem


def _is_within(text: str, limits: tuple[float, float]) -> bool:
    number = number_of(text)
    return not isinstance(number, str) and limits[0] <= number <= limits[1]


FROM_FILE = (*AGENTS, "survey")  # come from a file, and are not entered on the page
NEEDED = ("laser", "odometry")  # sections whose names belong to the labels of their values
LABELS = {  # where the words of the file are too short for a reader of the page
    "dispatch_errors": "After a refused order",
    "picking.spread.distribution": "Spread of times",
    "picking.spread.cv": "Deviation of times",
    "picking.failure.mean_between": "Time between failures",
    "picking.failure.mean_repair": "Time of a repair",
    "carrying.failure.mean_between": "Time between carriers' failures",
    "carrying.failure.mean_repair": "Time of a carrier's repair",
    "carrying.battery.hours": "Hours of a battery",
    "carrying.battery.standing": "Power while standing",
    "sensors.gnss.white": "GNSS error of a tick",
    "sensors.gnss.bias": "GNSS error, slow",
    "sensors.gnss.bias_time": "GNSS correlation time",
    "bay": "Bay moved east by",
}
WIDEST = 1e6  # the range of a slider; a value with a wider one gets a text field only


@dataclass(frozen=True)
class Entry:
    """A value that a user can set."""

    path: str  # dotted path in the scenario file
    words: str  # description, with the unit
    # int, float, bool, or str: one of `choices`, or a class of the user's that a file names.
    kind: type
    optional: bool  # whether None is allowed: the program then chooses the value
    low: float = -inf
    high: float = inf
    choices: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """The name on the page, such as 'Row width' or 'Laser noise'."""
        *_, section, name = ["", *self.path.split(".")]
        known = name.replace("_", " ")
        words = f"{section} {known}" if section in NEEDED else known
        return LABELS.get(self.path, words[0].upper() + words[1:])

    @property
    def none(self) -> str:
        """The word for no value."""
        return none_words(self.words)

    @property
    def unit(self) -> str:
        """The unit in the description, such as m or bins/h; '' if there is none."""
        found = re.search(r", (m/s|m|s|bins/h|t/ha|kg)(?=;|$)", self.words)
        return found.group(1) if found else ""

    @property
    def step(self) -> float:
        """The step of the slider: a hundredth of the range, rounded up to 1, 2 or 5 times a power
        of ten.
        """
        if self.kind is int:
            return 1
        rough = (self.high - self.low) / 100
        power = 10.0 ** floor(log10(rough))
        return round(next(n * power for n in (1, 2, 5, 10) if n * power >= rough * 0.999), 10)

    @property
    def has_slider(self) -> bool:
        return self.kind in (int, float) and self.high - self.low <= WIDEST

    @property
    def limits(self) -> str:
        """The limits and the unit as text, such as '0 to 0.02 m'; '' without a slider."""
        return f"{self.low:g} to {self.high:g} {self.unit}".rstrip() if self.has_slider else ""


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


def _kinds_of(field: FieldInfo) -> tuple[Any, ...]:
    """Return the types that a value may have."""
    return get_args(field.annotation) or (field.annotation,)


def _section_of(field: FieldInfo) -> type[BaseModel] | None:
    """Return the section that stands at a field; None for a value."""
    kind = _kinds_of(field)[0]
    is_section = isinstance(kind, type) and issubclass(kind, BaseModel)
    return kind if is_section else None


def _entry_of(path: str, field: FieldInfo) -> Entry:
    """Return the entry for a value of the scenario."""
    kinds = _kinds_of(field)
    limits = {type(limit).__name__: limit for limit in field.metadata}
    return Entry(
        path=path,
        words=field.description or "",
        kind=kinds[0],
        optional=type(None) in kinds,
        low=limits["Ge"].ge if "Ge" in limits else -inf,
        high=limits["Le"].le if "Le" in limits else inf,
        choices=tuple(map(str, field.examples or ())),
    )


def flat(scenario: Scenario) -> dict[str, Any]:
    """Return the values of a scenario that the page asks for, by path."""
    return {path: reduce(getattr, path.split("."), scenario) for path in entries()}


IN_TITLE = ("rows", "pickers", "carriers", "seed")


def words_of(path: str, value: Any) -> str:
    if value is None:
        return entries()[path].none
    if isinstance(value, str):
        return value
    return ("on" if value else "off") if isinstance(value, bool) else shown(value)


def title_of(scenario: Scenario) -> str:
    """Return a scenario in a line: its size and seed, and what else is not as in the default
    scenario.
    """
    default, values = flat(Scenario()), flat(scenario)
    carriers = counted("carriers", scenario.carrier_count)
    size = f"{scenario.rows} rows, {scenario.pickers} pickers, {carriers}, seed {scenario.seed}"
    other = [
        path for path, value in values.items() if path not in IN_TITLE and value != default[path]
    ]
    more = [f"{_inner(entries()[path].label)} {words_of(path, values[path])}" for path in other]
    surveyed = ["surveyed rows"] if scenario.survey else []
    return ", ".join([size, *more, *surveyed, *(["own classes"] if scenario.own_classes else [])])


def _inner(label: str) -> str:
    return label if label[:2].isupper() else label[0].lower() + label[1:]


class Draft:
    """Entered values by path.

    `scenario`: None while a value is invalid. `problems`: messages by path.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.take(scenario)

    def take(self, scenario: Scenario) -> None:
        self._base, self.values = scenario, flat(scenario)  # the base has the user's own classes
        self._check()

    def become(self, other: "Draft") -> None:
        """Take all that is entered in another draft, also what is invalid."""
        self._base, self.values = other._base, other.values
        self._check()

    @property
    def is_untouched(self) -> bool:
        """Whether it holds the default scenario, so that nothing is lost with it."""
        return self.scenario == Scenario()

    @property
    def title(self) -> str:
        """What is entered, in a line."""
        if self.scenario is None:
            return f"{counted_fields(len(self.problems))} an invalid value"
        return title_of(self.scenario)

    def enter(self, values: Mapping[str, Any]) -> None:
        self.values = {
            **self.values,
            **{path: _typed(path, value) for path, value in values.items()},
        }  # copies share the old ones
        self._check()

    @property
    def classes(self) -> dict[str, str]:
        """The user's own classes and functions, by the key of the scenario or the agent that names
        them.
        """
        return {
            key: path
            for key, path in self._base.own_classes.items()
            if self.values.get(key, path) == path
        }

    def drop_classes(self) -> None:
        self.values = {
            **self.values,
            **{path: getattr(Scenario(), path) for path in CHOICES if path in self.classes},
        }
        self._base = self._base.model_copy(
            update={path: getattr(Scenario(), path) for path in (*AGENTS, *CHOICES)}
        )
        self._check()

    def _check(self) -> None:
        self.scenario, self.problems = None, self._strange()
        if self.problems:
            return
        try:
            scenario = with_effect(with_changes(self._base, **self.values), "entries")
            if self.classes:
                check_plugins(lay_out(scenario))
        except ScenarioError as error:
            self.problems = {
                path: words + self._advice(path)
                for path, words in _by_field(error.problems).items()
            }
        except ValueError as error:
            self.problems = {"agents": str(error)}
        else:
            self.scenario = scenario

    def _advice(self, path: str) -> str:
        """Return advice on a number that was typed with a comma; '' if it is refused with a point
        too.
        """
        meant = with_point(self.values.get(path))
        if not meant:
            return ""
        try:
            with_changes(self._base, **{**self.values, path: _typed(path, meant)})
        except ScenarioError as error:
            if path in _by_field(error.problems):
                return ""
        return write_a_point(meant)

    def _strange(self) -> dict[str, str]:
        """A message for each rule that is neither built in nor of the file: a link must not run any
        class.
        """
        return {
            path: (
                f"must be {', '.join(builtin)}; a class of your own must be named in a scenario"
                " file"
            )
            for path, builtin in CHOICES.items()
            if self.values[path] not in (*builtin, getattr(self._base, path))
        }


def counted_fields(number: int) -> str:
    """Return the subject of a sentence on fields: "1 field has", "2 fields have"."""
    return f"{number} field{'s have' if number > 1 else ' has'}"


def _typed(path: str, value: Any) -> Any:
    if isinstance(value, str):
        value = number_of(value)
    if entries()[path].kind is int and isinstance(value, float) and value.is_integer():
        return int(value)
    return value


def _by_field(problems: list[Problem]) -> dict[str, str]:
    """Messages by field. A rule about several fields appears at each of them, with their values."""
    messages: dict[str, str] = {}
    for problem in problems:
        paths = problem.path.split(", ")
        words = f"{problem.what}: {problem.text}" if len(paths) > 1 else problem.text
        messages |= {
            path: f"{messages[path]}; {words}" if path in messages else words for path in paths
        }
    return messages


ON_OFF = {"true": True, "false": False}


def query_of(scenario: Scenario) -> str:
    """Return the query for a scenario: what differs from the default, but own classes and a
    survey.
    """
    default, own = flat(Scenario()), scenario.own_classes
    return urlencode(
        {
            path: _words(value)
            for path, value in flat(scenario).items()
            if value != default[path] and path not in own
        }
    )


def _words(value: Any) -> str:
    return (
        value
        if isinstance(value, str)
        else str(value).lower()
        if isinstance(value, bool)
        else shown(value)
    )


MOST_UNKNOWN = 5  # names of a link that are reported one by one
LONGEST_NAME = 60  # characters of a name in a report


def draft_of(query: Iterable[tuple[str, str]]) -> tuple[Draft | None, list[str]]:
    """Return the draft that a link holds, None if it names no setting, and what is wrong with its
    names.
    """
    values: dict[str, Any] = {}
    unknown: list[str] = []
    for path, text in query:
        if path in entries():
            values[path] = ON_OFF.get(text, text) if entries()[path].kind is bool else text
        else:
            unknown.append(path)
    problems = [_no_such_setting(name[:LONGEST_NAME]) for name in unknown[:MOST_UNKNOWN]]
    if len(unknown) > MOST_UNKNOWN:
        problems.append(f"and {len(unknown) - MOST_UNKNOWN} more")
    if not values:
        return None, problems
    draft = Draft(Scenario())
    draft.enter(values)
    return draft, problems


def _no_such_setting(name: str) -> str:
    close = get_close_matches(name, entries(), 1)
    return f"{name}: no such setting" + (f"; did you mean {close[0]}?" if close else "")
