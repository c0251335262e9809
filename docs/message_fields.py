"""The fields of a message in words: name, type with its bounds as msgpack has it, and meaning."""

import re
from collections.abc import Iterator
from typing import Any, get_args

from msgspec import inspect

from orchard.contract.messages import FASTEST, Answer, Deed, Request, Tick
from orchard.wire.messages import FARTHEST

UNIONS: dict[str, Any] = {"deeds": Deed, "requests": Request, "answers": Answer}
# Limits, and a meaning, that docs/templates/messages.md.in says once, and no field again.
WIDE = ((-FARTHEST, FARTHEST), (-FASTEST, FASTEST))
TICKS = get_args(Tick)[1].description
MEMBERS = {member for union in UNIONS.values() for member in get_args(union)}


def struct_of(type_: type) -> inspect.StructType:
    """Return what msgspec knows of the fields of a message."""
    info = inspect.type_info(type_)
    assert isinstance(info, inspect.StructType)
    return info


def rows_of(type_: type) -> Iterator[tuple[str, str, str]]:
    """Yield (name, type, meaning) of the fields of a map, without `run` and `tick`, which the
    document explains once.
    """
    struct = struct_of(type_)
    is_message = any(field.encode_name == "run" for field in struct.fields)
    if struct.tag_field and type_ not in MEMBERS:
        yield struct.tag_field, f"'{struct.tag}'", "which message this is"
    for field in struct.fields:
        if not (is_message and field.encode_name in ("run", "tick")):
            bare, note = _bare(field.type)
            yield (
                field.encode_name,
                type_name(bare) + ("" if field.required else "?"),
                "" if note == TICKS else note,
            )


def parts_of(type_: type) -> set[type]:
    """Return the maps in a message, at any depth, but for deeds, requests and answers."""
    maps: set[type] = set()
    waiting: list[Any] = [inspect.type_info(type_)]
    while waiting:
        part = waiting.pop()
        if isinstance(part, inspect.StructType):
            if part.cls in maps or part.cls in MEMBERS:
                continue
            maps.add(part.cls)
        # The types that are in this one, by the names that msgspec has for them in each kind.
        waiting += [field.type for field in getattr(part, "fields", ())]
        waiting += [*getattr(part, "types", ()), *getattr(part, "item_types", ())]
        waiting += [
            getattr(part, name)
            for name in ("type", "item_type", "value_type")
            if hasattr(part, name)
        ]
    return maps - {type_}


def _bare(type_: inspect.Type) -> tuple[inspect.Type, str]:
    """Return a type without its metadata, and its description."""
    if not isinstance(type_, inspect.Metadata):
        return type_, ""
    return type_.type, (type_.extra_json_schema or {}).get("description", "")


_NAMES: dict[type, str] = {
    inspect.IntType: "int",
    inspect.FloatType: "float",
    inspect.StrType: "str",
    inspect.BytesType: "bin",
    inspect.BoolType: "bool",
    inspect.NoneType: "nil",
    inspect.DictType: "map",
    inspect.AnyType: "any",
}


def type_name(type_: inspect.Type) -> str:
    """Return the name of a type in msgpack, with its bounds."""
    if isinstance(type_, inspect.Metadata):
        return type_name(type_.type)
    if isinstance(type_, inspect.UnionType):
        names = [type_name(part) for part in type_.types]
        return f"{_union_name(names)}|nil" if "nil" in names else _union_name(names)
    if isinstance(type_, inspect.ListType | inspect.VarTupleType):
        return f"{type_name(type_.item_type)}[]"
    if isinstance(type_, inspect.NamedTupleType):
        return f"{type_.cls.__name__}[{','.join(field.encode_name for field in type_.fields)}]"
    if isinstance(type_, inspect.TupleType):
        return f"[{','.join(map(type_name, type_.item_types))}]"
    if isinstance(type_, inspect.LiteralType):
        return "|".join(f"'{value}'" for value in type_.values)
    if isinstance(type_, inspect.StructType):
        return type_.cls.__name__
    if isinstance(type_, inspect.DictType) and not isinstance(type_.value_type, inspect.AnyType):
        return f"map<{type_name(type_.value_type)}>"
    return _NAMES[type(type_)] + _bounds(type_)


def _union_name(names: list[str]) -> str:
    """Return the name of a union: `request` for all requests, else those of its members."""
    rest = [name for name in names if name != "nil"]
    for title, union in UNIONS.items():
        if set(rest) == {member.__name__ for member in get_args(union)}:
            # The titles are plurals.
            return title.removesuffix("s")
    return "|".join(rest)


def _bounds(type_: Any) -> str:
    """Return the bounds of a number, or the words that a text may be; nothing if it may be any."""
    low = getattr(type_, "ge", None)
    high = _highest(type_)
    if low is not None and high is not None and (low, high) not in WIDE:
        return f"({_figure(low)}..{_figure(high)})" if low != high else f"({_figure(low)})"
    # A pattern such as ^(east|west)$ is a choice of words.
    pattern = getattr(type_, "pattern", None) or ""
    choice = re.fullmatch(r"\^\((\w+(?:\|\w+)*)\)\$", pattern)
    if choice:
        return ": " + "|".join(f"'{word}'" for word in choice[1].split("|"))
    return ""


def _highest(type_: Any) -> float | None:
    """Return the highest number of a type; None if there is no limit."""
    if isinstance(type_, inspect.IntType) and type_.lt is not None:
        return type_.lt - 1
    return getattr(type_, "le", None)


def _figure(number: float) -> str:
    """Return a number as text, an int with all its digits."""
    return str(number) if isinstance(number, int) else f"{number:g}"
