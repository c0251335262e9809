"""The base classes of the messages on the wire, and `read`, which checks each payload that arrives."""

from typing import Annotated, TypeVar

import msgspec
from msgspec import Meta

from orchard.contract.messages import MAX_PAYLOAD, Tick, unpack

M = TypeVar("M")
Run = Annotated[str, Meta(max_length=64, description="the run's id, as in the reply to the scenario query")]


class SubMessage(msgspec.Struct, forbid_unknown_fields=True):
    """A map inside a message."""


class RunMessage(SubMessage):
    """A map with the run's id."""

    run: Run


class Message(RunMessage):
    """A map with the run's id and the tick."""

    tick: Tick


def read(payload: bytes, type_: type[M]) -> M:
    """Return the message in a payload. Raises ValueError, with the reason, if it is too large or not such a message."""
    if len(payload) > MAX_PAYLOAD:
        raise ValueError(f"{len(payload)} bytes; at most {MAX_PAYLOAD}")
    message: M = unpack(payload, type_)
    return message
