"""Who decides a value of the scenario: the grower chooses it, or it is given by the circumstances.

A field says so in its annotation. What a section says holds for all that is in it. A study looks
for the best of what can be chosen, for each of the circumstances.
"""

from collections.abc import Iterator, Mapping, Sequence
from enum import Enum
from typing import Any

from pydantic import BaseModel


class Decision(Enum):
    """Who decides a value."""

    #: The grower, for the next harvest.
    CHOICE = "choice"
    #: The orchard, the crop, people, machines as they are built, prices, chance.
    CIRCUMSTANCE = "circumstance"


def decision_at(model: type[BaseModel], path: str) -> Decision | None:
    """Return who decides the value at a dotted path; None for a section of which the parts
    say it.
    """
    inside: Any = model
    for name in path.split("."):
        is_section = isinstance(inside, type) and issubclass(inside, BaseModel)
        field = inside.model_fields.get(name) if is_section else None
        if field is None:
            return None
        marks = [mark for mark in field.metadata if isinstance(mark, Decision)]
        if marks:
            return marks[0]
        inside = field.annotation
    return None


def decided(model: type[BaseModel], decision: Decision, before: str = "") -> Iterator[str]:
    """Yield the paths that are decided so: a section as a whole, if it says so itself."""
    for name, field in model.model_fields.items():
        if decision in field.metadata:
            yield f"{before}{name}"
        elif isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            yield from decided(field.annotation, decision, f"{before}{name}.")


def is_choice(model: type[BaseModel], path: str, values: Sequence[Any]) -> bool:
    """Whether the grower chooses among these values.

    One of a section is a map of what it changes.
    """
    leaves = {leaf for value in values for leaf in _leaves(path, value)}
    return all(decision_at(model, leaf) is Decision.CHOICE for leaf in leaves)


def _leaves(path: str, value: Any) -> Iterator[str]:
    if not isinstance(value, Mapping) or not value:
        yield path
        return
    for name, inner in value.items():
        yield from _leaves(f"{path}.{name}", inner)
