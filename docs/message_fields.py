"""The fields of a message in words: path, type with its bounds as msgpack has it, and meaning."""

import re
from collections.abc import Iterator
from typing import Any, get_args

from msgspec import inspect

from orchard.contract.messages import Answer, Deed, Request

UNIONS: dict[str, Any] = {"deeds": Deed, "requests": Request, "answers": Answer}


def struct_of(type_: type) -> inspect.StructType:
    """Return what msgspec knows of the fields of a message."""
    info = inspect.type_info(type_)
    assert isinstance(info, inspect.StructType)
    return info


def field_rows(struct: inspect.StructType, path: str = "") -> Iterator[tuple[str, str, str]]:
    """Yield (path, type, meaning) of the fields of a map, with those of the maps in it."""
    if struct.tag_field:
        yield struct.tag_field, f"'{struct.tag}'", "which message this is"
    for field in struct.fields:
        type_, note = _bare(field.type)
        entry, step = _entry(type_)
        maps = [part for part in _members(entry) if isinstance(part, inspect.StructType)]
        where = f"{path}{field.encode_name}"
        if maps != [type_]:
            yield where, type_name(type_) + ("" if field.required else ", optional"), note
        if len(maps) == 1:
            yield from field_rows(maps[0], where + step)


def _entry(type_: inspect.Type) -> tuple[inspect.Type, str]:
    """What a map from names or an array holds, or else the type itself; and how the path of a field in it goes on."""
    if isinstance(type_, inspect.DictType):
        return _bare(type_.value_type)[0], ".*."
    if isinstance(type_, inspect.ListType | inspect.VarTupleType):
        return _bare(type_.item_type)[0], ".*."
    return type_, "."


def _bare(type_: inspect.Type) -> tuple[inspect.Type, str]:
    """A type without its metadata, and its description."""
    if not isinstance(type_, inspect.Metadata):
        return type_, ""
    return type_.type, (type_.extra_json_schema or {}).get("description", "")


def _members(type_: inspect.Type) -> tuple[inspect.Type, ...]:
    return tuple(type_.types) if isinstance(type_, inspect.UnionType) else (type_,)


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
        return f"{_union_name(names)} or nil" if "nil" in names else _union_name(names)
    if isinstance(type_, inspect.ListType | inspect.VarTupleType):
        return f"array of {type_name(type_.item_type)}"
    if isinstance(type_, inspect.NamedTupleType):
        return f"array {type_.cls.__name__}: {', '.join(type_name(field.type) for field in type_.fields)}"
    if isinstance(type_, inspect.TupleType):
        return f"array of {len(type_.item_types)}: {', '.join(map(type_name, type_.item_types))}"
    if isinstance(type_, inspect.LiteralType):
        return " or ".join(f"'{value}'" for value in type_.values)
    if isinstance(type_, inspect.StructType):
        return f"map {type_.cls.__name__}"
    if isinstance(type_, inspect.DictType) and not isinstance(type_.value_type, inspect.AnyType):
        return f"map of {type_name(type_.value_type)}"
    return _NAMES[type(type_)] + _bounds(type_)


def _union_name(names: list[str]) -> str:
    rest = [name for name in names if name != "nil"]
    for title, union in UNIONS.items():
        if set(rest) == {f"map {member.__name__}" for member in get_args(union)}:
            return f"map, one of the {title}"
    return " or ".join(rest)


def _bounds(type_: Any) -> str:
    low, high, most = getattr(type_, "ge", None), _highest(type_), getattr(type_, "max_length", None)
    if low is not None and high is not None:
        return f", {_figure(low)} to {_figure(high)}" if low != high else f", {_figure(low)}"
    if choice := re.fullmatch(r"\^\((\w+(?:\|\w+)*)\)\$", getattr(type_, "pattern", None) or ""):
        return ", " + " or ".join(f"'{word}'" for word in choice[1].split("|"))
    unit = "bytes" if isinstance(type_, inspect.BytesType) else "characters"
    return f", at most {most} {unit}" if most is not None else ""


def _highest(type_: Any) -> float | None:
    """The highest number of a type, if it has one."""
    if isinstance(type_, inspect.IntType) and type_.lt is not None:
        return type_.lt - 1
    return getattr(type_, "le", None)


def _figure(number: float) -> str:
    """A number in full if it is an int."""
    return str(number) if isinstance(number, int) else f"{number:g}"
