"""The fields of a message in words: name, type with its bounds as msgpack has it, and meaning."""

import re
from collections.abc import Iterator
from typing import Any, get_args

from msgspec import inspect

from orchard.contract.messages import FASTEST, Answer, Deed, Request, Tick
from orchard.wire.messages import FARTHEST

UNIONS: dict[str, Any] = {"deeds": Deed, "requests": Request, "answers": Answer}
WIDE = (
    (-FARTHEST, FARTHEST),
    (-FASTEST, FASTEST),
)  # bounds that docs/templates/messages.md.in names once
TICKS = get_args(Tick)[1].description  # which that template says once
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
    """The maps in a message, at any depth, but for deeds, requests and answers."""
    found: set[type] = set()
    waiting: list[Any] = [inspect.type_info(type_)]
    while waiting:
        part = waiting.pop()
        if isinstance(part, inspect.StructType):
            if part.cls in found or part.cls in MEMBERS:
                continue
            found.add(part.cls)
        waiting += [field.type for field in getattr(part, "fields", ())]
        waiting += [*getattr(part, "types", ()), *getattr(part, "item_types", ())]
        waiting += [
            getattr(part, name)
            for name in ("type", "item_type", "value_type")
            if hasattr(part, name)
        ]
    return found - {type_}


def _bare(type_: inspect.Type) -> tuple[inspect.Type, str]:
    """A type without its metadata, and its description."""
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
    """The name of a type in msgpack, with its bounds."""
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
    rest = [name for name in names if name != "nil"]
    for title, union in UNIONS.items():
        if set(rest) == {member.__name__ for member in get_args(union)}:
            return title[:-1]
    return "|".join(rest)


def _bounds(type_: Any) -> str:
    low, high = getattr(type_, "ge", None), _highest(type_)
    if low is not None and high is not None and (low, high) not in WIDE:
        return f"({_figure(low)}..{_figure(high)})" if low != high else f"({_figure(low)})"
    if choice := re.fullmatch(r"\^\((\w+(?:\|\w+)*)\)\$", getattr(type_, "pattern", None) or ""):
        return ": " + "|".join(f"'{word}'" for word in choice[1].split("|"))
    return ""


def _highest(type_: Any) -> float | None:
    """The highest number of a type, if it has one."""
    if isinstance(type_, inspect.IntType) and type_.lt is not None:
        return type_.lt - 1
    return getattr(type_, "le", None)


def _figure(number: float) -> str:
    """A number in full if it is an int."""
    return str(number) if isinstance(number, int) else f"{number:g}"
