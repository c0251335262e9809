"""What a vehicle reports as wrong: errors as VDA 5050 writes them."""

from collections.abc import Mapping
from typing import Literal

from orchard_vda5050.parts import MessagePart

Level = Literal["WARNING", "URGENT", "CRITICAL", "FATAL"]
# Characters of what an error says or refers to.
LONGEST_TEXT = 300
# Errors with which a vehicle stands until its order is cancelled.
LASTING = ("ACTION_FAILED", "NODE_UNREACHABLE")


class Reference(MessagePart):
    """What an error is about: the name of a field, and its value."""

    reference_key: str
    reference_value: str


class Error(MessagePart):
    """An error of a vehicle."""

    error_type: str
    error_level: Level
    error_references: list[Reference]
    error_description: str


class Rejected(Exception):
    """Raised for a message that the vehicle does not obey. `error`: what it reports of that."""

    def __init__(
        self, error_type: str, why: str, references: Mapping[str, object], level: Level = "WARNING"
    ) -> None:
        """`references`: names of fields, and their values."""
        super().__init__(why)
        self.error = Error(
            error_type,
            level,
            [Reference(key, str(value)[:LONGEST_TEXT]) for key, value in references.items()],
            why[:LONGEST_TEXT],
        )


def unsupported(
    why: str, parameter: str, references: Mapping[str, object] | None = None
) -> Rejected:
    """Return the error of a parameter that the vehicle cannot use.

    `references`: beside the name of the parameter.
    """
    named = {"parameter": parameter} | dict(references or {})
    return Rejected("UNSUPPORTED_PARAMETER", why, named, "CRITICAL")
