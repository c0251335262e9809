"""The parts of what a user's agent returns: each is refused, or returned as plain data.

The guard (orchard/contract/guard.py) puts an action together from them. Plain data are of the exact
types that physics expects: a class that a user derives from `str` or `Hold` may have methods of its
own, which would run outside the guard.

Each function raises TypeError or ValueError, with what is wrong and what would be right.
"""

from collections.abc import Iterable, Sequence
from itertools import chain
from typing import Any

from orchard.contract import agent as limits
from orchard.contract.agent import STATES, State
from orchard.contract.difference import parts_of
from orchard.contract.messages import AgentMessage, Answer, CustomMessage, Request, pack
from orchard.field.problems import printable

# What `pack` raises for data that are not plain.
NOT_PLAIN = (TypeError, OverflowError, UnicodeError)
PLAIN = "numbers, texts, bytes, lists, dicts, or a msgspec.Struct"
SURVIVES = f"{PLAIN} that the agent's `Memory` names"


def own_messages(agent: Any) -> tuple[type[AgentMessage], ...]:
    """Return the types of messages that an agent names in `Messages`."""
    types = getattr(agent, "Messages", ())
    are_messages = isinstance(types, tuple) and all(
        isinstance(type_, type) and issubclass(type_, AgentMessage) for type_ in types
    )
    if not are_messages:
        raise TypeError(
            f"Messages must be a tuple of classes that are derived from AgentMessage, not {types!r}"
        )
    return types


def packed_or_none(memory: Any) -> bytes | None:
    """Return the bytes of a memory; None without a memory."""
    if memory is None:
        return None
    return pack(memory)


def packed_within_limit(data: Any, subject: str) -> bytes:
    """Return the bytes of some data, at most LARGEST_MEMORY.

    `subject`: the words of an error up to the number, such as "its memory takes".
    """
    packed = pack(data)
    if len(packed) > limits.LARGEST_MEMORY:
        raise ValueError(f"{subject} {len(packed)} bytes; at most {limits.LARGEST_MEMORY}")
    return packed


def packed_memory(memory: Any) -> bytes:
    """Return the bytes of an agent's memory. An error names the part that is not plain data."""
    try:
        return packed_within_limit(memory, "its memory takes")
    except NOT_PLAIN as error:
        raise TypeError(f"{place_of_fault(memory, 'memory')}: {error}. Use {SURVIVES}") from None


def place_of_fault(data: Any, where: str) -> str:
    """Return the place of the innermost part that cannot be packed. `where`: the name of `data`."""
    for at, value in parts_of(data, where):
        try:
            pack(value)
        except NOT_PLAIN:
            return place_of_fault(value, at)
    return where


def checked_state(state: Any) -> State | None:
    """Return a state as a plain text; None for None."""
    if state is None:
        return None
    plain = ""
    if isinstance(state, str):
        plain = _plain_text(state)
    if plain not in STATES:
        raise ValueError(f"state {state!r}: must be one of {', '.join(STATES)}")
    return plain


def texts_for_people(doing: Any, waits_for: Any) -> tuple[str, str]:
    """Return the two texts of an action that people read, plain and printable."""
    if not (isinstance(doing, str) and isinstance(waits_for, str)):
        raise TypeError(f"doing {doing!r}, waits_for {waits_for!r}: both must be text")
    return printable(_plain_text(doing)), printable(_plain_text(waits_for))


def _plain_text(text: str) -> str:
    """Return a text as a `str`, if its class is derived from `str`.

    `str(text)` would call a method of that class.
    """
    return "".join([text])


def listed(name: str, messages: Any) -> Sequence[Any]:
    """Return messages that are in a list or a tuple. `name`: the field of the action."""
    if not isinstance(messages, list | tuple):
        raise TypeError(f"{name} {type(messages).__name__}: must be a list")
    return messages


def of_kind(message: Any, type_: Any) -> Any:
    """Return a message that is of a type, such as `Request`."""
    if not isinstance(message, type_):
        known = "a message of orchard/contract/messages.py"
        raise TypeError(f"{message!r} is neither {known} nor of a type in the agent's `Messages`")
    return message


def refuse_depth(messages: Sequence[Request | Answer]) -> None:
    """Raise ValueError for an own message whose lists and maps are nested too deeply."""
    most = limits.MOST_LEVELS
    for message in messages:
        if isinstance(message, CustomMessage) and not _is_shallow(message.fields, most):
            fault = f"lists and maps are nested more than {most} levels deep"
            raise ValueError(f"{message.name}: {fault}")


def _is_shallow(data: Any, levels: int) -> bool:
    """Whether some data have at most so many levels: a number has one, a list of numbers two."""
    parts: Iterable[Any] = ()
    if isinstance(data, dict):
        parts = chain(data, data.values())
    elif isinstance(data, list | tuple):
        parts = data
    return levels > 0 and all(_is_shallow(part, levels - 1) for part in parts)


def refuse_more(name: str, count: int, most: int) -> None:
    """Raise ValueError for more than `most`. `name`: of what there are `count`, in the plural."""
    if count > most:
        raise ValueError(f"{count} {name} in one tick; at most {most}")
