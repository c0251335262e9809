"""Reads payloads as messages: physics, hosts, the logger and clients use it."""

from typing import TypeVar

from orchard.contract.messages import MAX_PAYLOAD, unpack
from orchard.wire.messages.observers import Bundle
from orchard.wire.messages.run import Joined

# Bytes of a message that holds much: the largest memories of 512 agents (`Joined`), or ten ticks of
# the largest orchard (`Bundle`).
LARGEST_OF_MANY = 16 * MAX_PAYLOAD
M = TypeVar("M")


def read(payload: bytes, type_: type[M]) -> M:
    """Return the message in a payload. Raises ValueError, with the reason, if it is too large or
    not such a message.

    >>> from orchard.contract.messages import pack
    >>> from orchard.wire.messages.control import StepSimulation
    >>> read(pack({"run": "a1", "steps": 2}), StepSimulation).steps
    2
    >>> read(pack({"run": "a1", "step": 2}), StepSimulation)
    Traceback (most recent call last):
    msgspec.ValidationError: Object contains unknown field `step`
    """
    if type_ in (Joined, Bundle):
        most = LARGEST_OF_MANY
    else:
        most = MAX_PAYLOAD
    if len(payload) > most:
        raise ValueError(f"{len(payload)} bytes; at most {most}")
    message: M = unpack(payload, type_)
    return message
