"""Error reports for a scenario that cannot be used: file, line, key, value, what is allowed; and
what all its sections are.
"""

import difflib
from dataclasses import dataclass
from functools import reduce
from typing import Any, get_args, get_origin

from pydantic import BaseModel, ConfigDict
from pydantic.fields import FieldInfo
from pydantic_core import PydanticCustomError

from orchard.field.kinds import KINDS

MOST_TOLD = 50  # problems in the text of a ScenarioError
LONGEST = 200  # characters of a line of a user's code

Lines = dict[tuple[str, ...], int]  # path in the file -> its line, from 1

_CLASSES = {  # what each map of names and classes must be
    "agents": (
        f"a map of kinds ({', '.join(KINDS)}) or names and the classes that drive them: {{picker:"
        " my_package.MyPicker}"
    ),
    "agents_without_body": (
        "a map of new names and the classes that drive them: {weather: my_package.Weather}"
    ),
}
_NOT_A_NAME = {  # what is wrong with a key of it
    "agents": f"not a kind ({', '.join(KINDS)}) and not a name such as picker_01",
    "agents_without_body": "not a name: small letters, digits and _, beginning with a letter",
}


def printable(words: str, most: int = LONGEST) -> str:
    """Return the text of an agent, a class or a client that may be faulty as one short line,
    harmless in a terminal, a log and a page.
    """
    short = words if len(words) <= most else words[: most - 3] + "..."
    if type(short) is str and short.isprintable():
        return short
    return "".join(c if c.isprintable() else "?" for c in short)


@dataclass(frozen=True)
class Problem:
    """One fault in a scenario: its place, the value there, and what is allowed."""

    file: str  # or another source of the values
    text: str  # what is wrong, and what is allowed
    path: str = ""  # dotted path in the file, or several with commas; empty: the whole file
    value: str = ""  # as text, one for each path; empty if the path itself is wrong
    line: int = 0  # from 1; 0: unknown

    @property
    def what(self) -> str:
        """The place with its value: "rows = 2".

        A rule about several values has all of them: "pickers = 4, rows = 3".
        """
        paths, values = self.path.split(", "), self.value.split(", ")
        if len(paths) != len(values):
            paths, values = [self.path], [self.value]
        return ", ".join(
            f"{path} = {value}" if value else path
            for path, value in zip(paths, values, strict=True)
        )

    def __str__(self) -> str:
        where = f"{self.file}:{self.line}" if self.line else self.file
        return f"{where}: {self.what}: {self.text}" if self.path else f"{where}: {self.text}"


class ScenarioError(Exception):
    """A scenario cannot be used.

    `problems` holds all its faults in file order; the message names the first MOST_TOLD of them.

    `rest`: the scenario with the defaults in place of all that is wrong; None if nothing of it can
    be read.
    """

    def __init__(self, problems: list[Problem], rest: Any = None) -> None:
        self.problems, self.rest = sorted(problems, key=lambda problem: problem.line), rest
        more = len(problems) - MOST_TOLD
        super().__init__(
            "\n".join(
                [
                    *map(str, self.problems[:MOST_TOLD]),
                    *([f"and {more} more problems"] if more > 0 else []),
                ]
            )
        )


class Section(BaseModel):
    """A section of a scenario: a map with known keys, strictly typed, with rules about several of
    their fields.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    def _demand(self, holds: bool, text: str, *fields: str) -> None:
        """Check a rule about several fields, named by dotted paths.

        Raise an error that names them and their values unless it holds.
        """
        if not holds:
            values = [reduce(getattr, field.split("."), self) for field in fields]
            raise PydanticCustomError(
                "rule", "{text}", {"text": text, "fields": fields, "values": values}
            )


def problem_of(error: dict[str, Any], model: type[BaseModel], source: str, lines: Lines) -> Problem:
    """Convert a pydantic error about values of `model`; `lines` gives the line of each key."""
    loc, line = error["loc"], max(lines.get(field, 0) for field in error["fields"])
    if error["type"] == "rule":
        return Problem(
            source,
            error["msg"],
            ", ".join(map(dotted, error["fields"])),
            ", ".join(map(str, error["ctx"]["values"])),
            line,
        )
    if error["of_key"]:
        return Problem(source, _NOT_A_NAME[loc[0]], dotted(loc), "", line)
    if error["type"] == "missing":
        return Problem(
            source, f"is missing: {_wanted(loc, model)}", dotted(loc), "", lines.get(loc[:-1], 0)
        )
    text = (
        _unknown(loc, model)
        if error["type"] == "extra_forbidden"
        else f"must be {_wanted(loc, model)}{_meant(loc, model, error['input'])}"
    )
    return Problem(source, text, dotted(loc), show(error["input"]), line)


def _wanted(path: tuple[str, ...], model: type[BaseModel]) -> str:
    """The allowed values of a field: 'a number from 5.0 to 12.0 (width of a row between its trees,
    m)'.
    """
    if path[0] in _CLASSES:
        return (
            _CLASSES[path[0]]
            if len(path) == 1
            else "the class that drives it, such as my_package.MyPicker"
        )
    field = _field(path, model)
    limits = {type(limit).__name__: limit for limit in field.metadata}
    if get_origin(field.annotation) is tuple and not path[-1].isdecimal():
        return (
            f"a list of {limits['MinLen'].min_length} to {limits['MaxLen'].max_length} maps"
            f" ({field.description})"
        )
    if inner := _section(field):
        return f"a map with some of the keys {', '.join(inner.model_fields)}"
    kinds: dict[Any, str] = {
        str: "a name",
        bool: "true or false",
        float: "a number",
        int: "a whole number",
    }
    kinds |= {kind | None: f"null or {words}" for kind, words in kinds.items()}
    kind = kinds[field.annotation]
    span = f" from {limits['Ge'].ge} to {limits['Le'].le}" if "Ge" in limits else ""
    return f"{kind}{span} ({field.description})"


def _field(path: tuple[str, ...], model: type[BaseModel]) -> FieldInfo:
    *section, name = [part for part in path if not part.isdecimal()]
    return _keys(tuple(section), model)[name]


def _meant(path: tuple[str, ...], model: type[BaseModel], value: Any) -> str:
    known = [] if path[0] in _CLASSES else _field(path, model).examples or []
    near = (
        difflib.get_close_matches(value[:60], map(str, known), n=1)
        if isinstance(value, str)
        else []
    )
    return f"; did you mean {near[0]}?" if near else ""


def _unknown(path: tuple[str, ...], model: type[BaseModel]) -> str:
    here = _keys(path[:-1], model)
    elsewhere = _paths(model)
    key = path[-1].lower().replace("-", "_").replace(" ", "_")[:60]
    near = [
        close for known in (here, elsewhere) for close in difflib.get_close_matches(key, known, n=1)
    ]
    guess = near and (near[0] if near[0] in here else elsewhere[near[0]])
    return (
        f"unknown key{f'; did you mean {guess}?' if guess else ';'} known here: {', '.join(here)}"
    )


def _paths(model: type[BaseModel], before: str = "") -> dict[str, str]:
    found: dict[str, str] = {}
    for name, field in model.model_fields.items():
        if section := _section(field):
            found |= _paths(section, f"{before}{name}.")
    return found | {name: before + name for name in model.model_fields}


def _keys(path: tuple[str, ...], model: Any) -> dict[str, FieldInfo]:
    """The fields of the section at a path. A number in it is a place in a list of sections."""
    for part in path:
        model = model if part.isdecimal() else _section(model.model_fields[part])
    fields: dict[str, FieldInfo] = model.model_fields
    return fields


def _section(field: FieldInfo) -> type[BaseModel] | None:
    kinds = [
        kind for kind in (field.annotation, *get_args(field.annotation)) if isinstance(kind, type)
    ]
    return next((kind for kind in kinds if issubclass(kind, BaseModel)), None)


def key_text(key: Any) -> str:
    """Return a key of any type as readable text."""
    return key if isinstance(key, str) and key.isprintable() and key else show(key)


def dotted(path: tuple[str, ...]) -> str:
    """Return a path in a file as text: "people.workers"."""
    return ".".join(part if len(part) <= 60 else part[:57] + "..." for part in path)


def show(value: Any) -> str:
    """Return a value of any type as YAML text, at most 60 characters."""
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    try:
        text = repr(value)
    except Exception:  # for example a whole number of more than 4,300 digits
        text = f"some {type(value).__name__}"
    return text if len(text) <= 60 else text[:57] + "..."
