"""The first difference between two pieces of plain data, with its place in them.

The guard shows it for an agent that answers otherwise when it is asked again, and for a memory that
is another one after it was sent as bytes.
"""

from collections.abc import Collection
from dataclasses import fields, is_dataclass
from typing import Any

import msgspec

# Characters of a value that are shown.
SHOWN = 80
# Types of data without parts. Most data are of these, so they are told apart first, for speed.
_SIMPLE = (float, str, int, bool, bytes, type(None))


def difference(before: Any, after: Any, where: str) -> str:
    """Return the first difference between two values, as "memory['seen']: set {1}, then list [1]".

    Return '' if they are the same, types too. Two exceptions: NaN is the same as NaN, and an int
    before is the same as an equal float after, because a field of type float reads an int so.
    `where`: the name of the values.

    >>> difference({"row": 3}, {"row": 4}, "memory")
    "memory['row']: 3, then 4"
    """
    if _is_same(before, after):
        return ""
    parts_before = parts_of(before, where)
    parts_after = parts_of(after, where)
    # If parts are missing or new, their difference is that of the whole values.
    if type(before) is type(after) and _places(parts_before) == _places(parts_after):
        for (place, old), (_, new) in zip(parts_before, parts_after, strict=True):
            if words := difference(old, new, place):
                return words
    return f"{where}: {_shown(before, after)}, then {_shown(after, before)}"


def _is_same(before: Any, after: Any) -> bool:
    """Whether two values are the same, as `difference` says."""
    if before is after:
        return True
    kind = type(before)
    if kind is not type(after):
        return kind is int and type(after) is float and bool(before == after)
    if kind is dict:
        # The keys, and their order, and then the values.
        return _are_same(before, after) and _are_same(before.values(), after.values())
    if kind is list or kind is tuple:
        return _are_same(before, after)
    if kind not in _SIMPLE and (names := _names_in(before)):
        return all(_is_same(getattr(before, name), getattr(after, name)) for name in names)
    # Only NaN differs from itself.
    return bool(before == after or before != before)  # noqa: PLR0124


def _are_same(before: Collection[Any], after: Collection[Any]) -> bool:
    """Whether two collections have the same values, in the same order."""
    return len(before) == len(after) and all(map(_is_same, before, after))


def parts_of(data: Any, where: str) -> list[tuple[str, Any]]:
    """Return the place and the value of each part of a dict, list, tuple, Struct or dataclass.

    Other data have no parts.
    """
    if type(data) is dict:
        return [(f"{where}[{key!r}]", value) for key, value in data.items()]
    if type(data) in (list, tuple):
        return [(f"{where}[{i}]", value) for i, value in enumerate(data)]
    return [(f"{where}.{name}", getattr(data, name)) for name in _names_in(data)]


def _places(parts: list[tuple[str, Any]]) -> list[str]:
    return [place for place, _ in parts]


def _names_in(data: Any) -> list[str]:
    """Return the names of the fields of a Struct or dataclass; of other data none."""
    if isinstance(data, msgspec.Struct):
        return list(data.__struct_fields__)
    if is_dataclass(data) and not isinstance(data, type):
        return [field.name for field in fields(data)]
    return []


def _shown(value: Any, beside: Any) -> str:
    """Return a value as text, with its type if the value beside it has another one."""
    text = repr(value)
    if type(value) is not type(beside):
        text = f"{type(value).__name__} {value!r}"
    if len(text) <= SHOWN:
        return text
    return text[: SHOWN - 3] + "..."
