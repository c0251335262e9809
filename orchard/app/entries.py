"""What the page asks for: every value of a scenario, with the limits and the words of its model."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache, reduce
from math import floor, inf, log10
from typing import Any, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from orchard.field.scenario import Scenario

MOST_STEPS = 1e6  # beyond this a slider is of no use


@dataclass(frozen=True)
class Entry:
    """One value that a user may set."""

    path: str  # dotted, as in the file
    words: str  # what it is
    kind: type  # int, float or bool
    optional: bool  # whether it may be left to the program
    low: float = -inf
    high: float = inf

    @property
    def label(self) -> str:
        """Its name for people: 'Row width', 'Laser noise'."""
        section, _, name = self.path.rpartition(".")
        known = name.replace("_", " ")
        return (f"{section} {known}" if section == "laser" else known).capitalize()

    @property
    def unit(self) -> str:
        found = re.search(r", (m/s|m)(?=;|$)", self.words)
        return found.group(1) if found else ""

    @property
    def step(self) -> float:
        """Of the slider: a hundredth of the span, rounded up to 1, 2 or 5 times a power of ten; whole for whole numbers."""
        if self.kind is int:
            return 1
        rough = (self.high - self.low) / 100
        power = 10.0 ** floor(log10(rough))
        return round(next(n * power for n in (1, 2, 5, 10) if n * power >= rough * 0.999), 10)

    @property
    def has_slider(self) -> bool:
        return self.kind is not bool and (self.high - self.low) / self.step <= MOST_STEPS

    @property
    def limits(self) -> str:
        return f"{self.low:g} to {self.high:g} {self.unit}".rstrip() if self.has_slider else ""


@cache
def entries() -> dict[str, Entry]:
    """By path, in the order of the file."""
    return {entry.path: entry for entry in _entries(Scenario)}


def _entries(model: type[BaseModel], before: str = "") -> Iterator[Entry]:
    for name, field in model.model_fields.items():
        kind = field.annotation
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            yield from _entries(kind, f"{before}{name}.")
        elif get_origin(kind) is not dict:  # which classes drive comes with a file
            yield _entry(before + name, field)


def _entry(path: str, field: FieldInfo) -> Entry:
    kinds = get_args(field.annotation) or (field.annotation,)
    limits = {type(limit).__name__: limit for limit in field.metadata}
    span = (limits["Ge"].ge, limits["Le"].le) if "Ge" in limits else ()
    return Entry(path, field.description or "", kinds[0], type(None) in kinds, *span)


def flat(scenario: Scenario) -> dict[str, Any]:
    """By path, all that the page asks for."""
    return {path: reduce(getattr, path.split("."), scenario) for path in entries()}


def nested(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values by path, as the file holds them."""
    tree: dict[str, Any] = {}
    for path, value in values.items():
        *sections, key = path.split(".")
        place = tree
        for section in sections:
            place = place.setdefault(section, {})
        place[key] = value
    return tree
