"""The kinds of fields that a scenario has: choices, counts, prices, rules, names of agents.

The files `schema`, `sections` and `prices` beside this one use them in annotations.
"""

from collections.abc import Sequence
from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, Field

from orchard.field.decisions import Decision
from orchard.field.kinds import BODILESS, KINDS

# Marks of fields: what decides the value (orchard/field/decisions.py). `choice` below is something
# else: a field whose value is one of some names.
CHOICE = Decision.CHOICE
CIRCUMSTANCE = Decision.CIRCUMSTANCE
# The most people together, animals together, and weeds.
MOST_GUESTS = 50
# The latest hour of work at which an absence of a picker begins or ends.
MOST_HOURS = 2000.0
# In any currency.
HIGHEST_PRICE = 1e9

_NAME = "[A-Za-z_][A-Za-z0-9_]*"
# module.Class or module:Class; a module may lie in packages.
_PATH = rf"{_NAME}(\.{_NAME})*[.:]{_NAME}"
ClassPath = Annotated[str, Field(pattern=rf"^{_PATH}$", max_length=200)]
# What a class can drive: a kind, a body by its name, or a built-in agent without a body.
Driven = Annotated[str, Field(pattern=rf"^(({'|'.join(KINDS)})(_[0-9]+)?|{'|'.join(BODILESS)})$")]
# Time of work since the harvest began, h.
Hours = Annotated[float, Field(ge=0.0, le=MOST_HOURS)]

# A value of a map whose keys are pickers.
_Value = TypeVar("_Value")


def _by_name(values: dict[str, _Value]) -> dict[str, _Value]:
    """Return values of pickers in the order of their names, so that equal maps give equal texts."""
    return dict(sorted(values.items()))


PICKER_RATES = "picker -> its picking rate as a share of the usual one: 0.5 is half as fast"
PickerRates = Annotated[
    dict[
        Annotated[str, Field(pattern="^picker_[0-9]{2}$")],
        Annotated[float, Field(ge=0.05, le=20.0)],
    ],
    Field(max_length=60, description=PICKER_RATES),
    AfterValidator(_by_name),
]
PICKER_ABSENCES = (
    "picker -> when it is away, as pairs of hours of work since the harvest began: [[0, 4.5]] comes"
    " after 4.5 h; its rows wait for it"
)
PickerAbsences = Annotated[
    dict[
        Annotated[str, Field(pattern="^picker_[0-9]{2}$")],
        Annotated[
            list[Annotated[list[Hours], Field(min_length=2, max_length=2)]],
            Field(min_length=1, max_length=20),
        ],
    ],
    Field(max_length=60, description=PICKER_ABSENCES),
    AfterValidator(_by_name),
]
# The name of a user's agent without a body.
Bodiless = Annotated[str, Field(pattern="^[a-z][a-z0-9_]{0,63}$")]
Classes = Annotated[
    dict[Driven, ClassPath],
    Field(max_length=200, description="kind or name -> module.Class in place of the built-in one"),
]
MoreAgents = Annotated[
    dict[Bodiless, ClassPath],
    Field(max_length=200, description="name -> module.Class of another agent without a body"),
]


def choice(names: Sequence[str], meaning: str) -> Any:
    """Return a field whose value is one of some names. `meaning`: its description.

    Programs that offer a choice, such as the page, find the names in the field's `examples`.
    """
    return Field(
        pattern=rf"^({'|'.join(names)})$",
        examples=list(names),
        description=f"{meaning}: {', '.join(names)}",
    )


def count(meaning: str) -> Any:
    """Return a field whose value is a number of people, animals or weeds."""
    return Field(ge=0, le=MOST_GUESTS, description=meaning)


def price_of(meaning: str) -> Any:
    """Return a field whose value is a price, in any currency, the same for all prices."""
    return Field(ge=0.0, le=HIGHEST_PRICE, description=meaning)


def plugin(builtin: Sequence[str], meaning: str) -> Any:
    """Return a field whose value names a rule: a built-in one, or module.Class of a user.

    The names of the built-in rules are the field's `examples`.
    """
    return Field(
        pattern=rf"^({'|'.join(builtin)}|{_PATH})$",
        max_length=200,
        examples=list(builtin),
        description=f"{meaning}: {', '.join(builtin)}, or module.Class",
    )
