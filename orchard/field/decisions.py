"""Which values of the scenario the grower chooses, and which the circumstances give.

The annotation of a field has a mark for it, a `Decision`. The mark of a section holds for all of
its fields. A study (`orchard/study`) looks for the best choice, for each of the circumstances.
"""

from collections.abc import Iterator, Mapping, Sequence
from enum import Enum
from typing import Any

from pydantic import BaseModel


class Decision(Enum):
    """What decides a value."""

    #: The grower's choice, for the next harvest.
    CHOICE = "choice"
    #: The orchard, the crop, people, machines as they are built, prices, chance.
    CIRCUMSTANCE = "circumstance"


def decision_at(model: type[BaseModel], path: str) -> Decision | None:
    """Return what decides the value at a dotted path, such as "people.workers".

    None for a section without a mark, whose fields have marks of their own, and for a path that
    leads to no field.
    """
    section: Any = model
    for name in path.split("."):
        is_section = isinstance(section, type) and issubclass(section, BaseModel)
        field = section.model_fields.get(name) if is_section else None
        if field is None:
            return None
        marks = [mark for mark in field.metadata if isinstance(mark, Decision)]
        if marks:
            return marks[0]
        section = field.annotation
    return None


def decided(model: type[BaseModel], decision: Decision, before: str = "") -> Iterator[str]:
    """Yield the dotted paths of all fields of a model with this mark.

    A section with a mark is one path: its fields are not yielded. `before`: what stands before each
    path, "" or the path of the model with a dot at its end.
    """
    for name, field in model.model_fields.items():
        if decision in field.metadata:
            yield f"{before}{name}"
        elif isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            yield from decided(field.annotation, decision, f"{before}{name}.")


def is_choice(model: type[BaseModel], path: str, values: Sequence[Any]) -> bool:
    """Whether the grower chooses among some values of the field or section at a dotted path.

    A value of a section is a map of the fields that it changes. The grower must choose all of them.
    """
    leaves = {leaf for value in values for leaf in _leaves(path, value)}
    return all(decision_at(model, leaf) is Decision.CHOICE for leaf in leaves)


def _leaves(path: str, value: Any) -> Iterator[str]:
    """Yield the dotted paths of all values in a map and in the maps inside it.

    Any other value, and an empty map, is yielded as `path` itself.
    """
    if not isinstance(value, Mapping) or not value:
        yield path
        return
    for name, inner in value.items():
        yield from _leaves(f"{path}.{name}", inner)
