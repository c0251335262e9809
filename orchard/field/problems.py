"""Error reports for a scenario that cannot be used: file, line, key, value and what is allowed.

Pydantic checks the values, and its errors become `Problem`s here: `errors_of` adds to each error
the fields that it is about, and `problems_of` puts it into words. `Section` is the base class of
all sections of a scenario (orchard/field/scenario).
"""

import difflib
from collections.abc import Iterable
from dataclasses import dataclass
from functools import reduce
from typing import Any, get_args, get_origin

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import PydanticCustomError

from orchard.field.kinds import KINDS

# Problems in the text of a ScenarioError, at most.
MOST_NAMED = 50
# What pydantic calls an unknown key.
UNKNOWN = "extra_forbidden"
# Characters of a line of text from elsewhere, at most.
LONGEST = 200
# Characters of a value or of a part of a path, at most.
LONGEST_VALUE = 60

# Path of a key in the file, as ("people", "workers") -> its line, from 1.
Lines = dict[tuple[str, ...], int]

# Key of the scenario whose value is a map of names and classes -> what the map must be.
_CLASSES = {
    "agents": (
        f"a map of kinds ({', '.join(KINDS)}) or names and the classes that drive them: {{picker:"
        " my_package.MyPicker}"
    ),
    "agents_without_body": (
        "a map of new names and the classes that drive them: {weather: my_package.Weather}"
    ),
}
# Key of another map with names -> what the map must be, and what a value in it must be.
_MAPS = {
    "picker_rates": (
        "a map of pickers and their rates as shares of the usual one: {picker_03: 0.5}",
        "a number from 0.05 to 20: the share of the usual rate",
    ),
    "picker_absences": (
        "a map of pickers and the hours of work between which they are away: {picker_03: [[0,"
        " 4.5]]}",
        "pairs of hours of work, from and to, 0 to 2000: [[0, 4.5]]",
    ),
}
# Keys of a farm's file, which `orchard.study.farm_file` reads.
_OF_FARMS = ("blocks", "transfer_minutes")
# Key of such a map -> what is wrong with a name in it that is refused.
_NOT_A_NAME = {
    "picker_absences": "not the name of a picker, such as picker_01",
    "picker_rates": "not the name of a picker, such as picker_01",
    "agents": f"not a kind ({', '.join(KINDS)}) and not a name such as picker_01",
    "agents_without_body": "not a name: small letters, digits and _, beginning with a letter",
}


def printable(words: str, most: int = LONGEST) -> str:
    """Return a text from an agent, a class or a client as one short line.

    Such text may be faulty. The line is harmless in a terminal, a log and a page. `most`: its
    length at most, characters.
    """
    short = words
    if len(words) > most:
        short = words[: most - 3] + "..."
    # A class derived from str may have an `isprintable` of its own that is wrong.
    if type(short) is str and short.isprintable():
        return short
    return "".join(c if c.isprintable() else "?" for c in short)


@dataclass(frozen=True)
class Problem:
    """One fault in a scenario: its place, the value there, and what is allowed."""

    #: The file, or another source of the values, as "changes".
    file: str
    #: What is wrong, and what is allowed.
    text: str
    #: Dotted path in the file, or several with ", " between them; empty: the whole file.
    path: str = ""
    #: The value as text, or one for each path with ", " between them; empty if the path itself is
    #: wrong.
    value: str = ""
    #: Line of the file, from 1; 0: unknown.
    line: int = 0

    @property
    def what(self) -> str:
        """The place with its value: "rows = 2".

        A rule about several values has all of them: "pickers = 4, rows = 3".
        """
        paths = self.path.split(", ")
        values = self.value.split(", ")
        # A comma in a single value is no separator.
        if len(paths) != len(values):
            paths = [self.path]
            values = [self.value]
        parts = []
        for path, value in zip(paths, values, strict=True):
            if value:
                parts.append(f"{path} = {value}")
            else:
                parts.append(path)
        return ", ".join(parts)

    def __str__(self) -> str:
        """Return the problem as a line: file, its line, place, value, and what is wrong."""
        place = self.file
        if self.line:
            place = f"{self.file}:{self.line}"
        parts = [place]
        if self.path:
            parts.append(self.what)
        parts.append(self.text)
        return ": ".join(parts)


@dataclass(frozen=True)
class Called:
    """A mark in the annotation of a field: what its value must be, in words.

    It is for fields of which the type alone does not tell that, such as a time of day.
    """

    words: str


class ScenarioError(Exception):
    """A scenario cannot be used.

    `problems` holds all its faults in file order; the message names the first MOST_NAMED of them.

    `rest` is the scenario with the defaults in place of all that is wrong; None if nothing of it
    can be read.
    """

    def __init__(self, problems: list[Problem], rest: Any = None) -> None:
        """`problems`: in any order. `rest`: see the class."""
        self.problems = sorted(problems, key=lambda problem: problem.line)
        self.rest = rest
        lines = [str(problem) for problem in self.problems[:MOST_NAMED]]
        more = len(problems) - MOST_NAMED
        if more > 0:
            lines.append(f"and {more} more problems")
        super().__init__("\n".join(lines))

    def __reduce__(self) -> tuple[Any, ...]:
        """Return how to make the same error again, for pickle: it may come from a worker process.

        By default pickle would give `__init__` the message, and not the problems.
        """
        return type(self), (self.problems, self.rest)


class Section(BaseModel):
    """A section of a scenario: a map with known keys and strictly typed values.

    A section may have rules about several of its fields, which it checks with `_demand`.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    def __init__(self, /, **values: Any) -> None:
        """Make it from values of its keys. Raises ScenarioError for those that cannot be."""
        try:
            super().__init__(**values)
        except ValidationError as failure:
            errors = errors_of(failure)
        else:
            return
        # Outside of `except`, so that pydantic's error is not shown beside this one.
        raise ScenarioError(problems_of(errors, type(self), type(self).__name__, {}))

    # Tells pydantic that this `__init__` only wraps its own. So a scenario is validated at once
    # with all its sections, and pydantic calls no `__init__` for each section.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    def _demand(self, is_met: bool, text: str, *fields: str) -> None:
        """Raise an error that names some fields and their values, unless a rule about them is met.

        `text`: what is wrong, and what is allowed. `fields`: dotted paths in this section.
        """
        if not is_met:
            values = [reduce(getattr, field.split("."), self) for field in fields]
            raise PydanticCustomError(
                "rule", "{text}", {"text": text, "fields": fields, "values": values}
            )


def errors_of(failure: ValidationError) -> list[dict[str, Any]]:
    """Return the errors of a failure of pydantic, for `problems_of`.

    Each is pydantic's own dict, with the changes of `_located`.
    """
    details = failure.errors(include_url=False)
    return [_located(error) for error in details if not _follows_from_others(error)]


def _follows_from_others(error: Any) -> bool:
    """Whether an error only follows from others.

    Pydantic does not count the invalid items of a list. So it may add that the list is too short,
    although it has enough items.
    """
    return bool(
        error["type"] == "too_short" and error["ctx"]["actual_length"] < len(error["input"])
    )


def _located(error: Any) -> dict[str, Any]:
    """Return an error of pydantic with three entries for `problems_of`.

    `loc`: the path of the section or of the field, as texts. `fields`: the paths of all fields that
    the error is about; a rule is about several. `of_key`: whether it is about a key of a map with
    names, and not about a value.
    """
    location = error["loc"]
    # Pydantic puts "[key]" behind the path of a map's key that is wrong.
    of_key = location[2:] == ("[key]",)
    if of_key:
        location = location[:2]
    path = tuple(map(str, location))
    fields = [path]
    if error["type"] == "rule":
        fields = [(*path, *field.split(".")) for field in error["ctx"]["fields"]]
    return dict(error) | {"loc": path, "of_key": of_key, "fields": fields}


def problems_of(
    errors: Iterable[dict[str, Any]], model: type[BaseModel], source: str, lines: Lines
) -> list[Problem]:
    """Return the errors of `errors_of` as problems, in file order.

    `model`: the section whose values they are about. `source`: names the file in the problems.
    `lines`: the line of each key.
    """
    in_order = sorted(errors, key=lambda error: _line_of(error, lines))
    unknown = [error for error in in_order if error["type"] == UNKNOWN]
    # To look for a known key that is like an unknown one takes 3 ms. So it is done only for as many
    # unknown keys as the text of a ScenarioError names.
    explained = {error["loc"] for error in unknown[:MOST_NAMED]}
    problems = []
    for error in in_order:
        if error["type"] == UNKNOWN and error["loc"] not in explained:
            place = dotted(error["loc"])
            line = _line_of(error, lines)
            problems.append(Problem(source, "unknown key", place, show(error["input"]), line))
        else:
            problems.append(_problem_of(error, model, source, lines))
    return problems


def _line_of(error: dict[str, Any], lines: Lines) -> int:
    """Return the last line that an error is about; 0 if none is known."""
    return max(lines.get(field, 0) for field in error["fields"])


def _problem_of(
    error: dict[str, Any], model: type[BaseModel], source: str, lines: Lines
) -> Problem:
    """Return an error as a problem. The parameters are those of `problems_of`."""
    path = error["loc"]
    line = _line_of(error, lines)
    if error["type"] == "rule":
        names = ", ".join(map(dotted, error["fields"]))
        values = ", ".join(map(str, error["ctx"]["values"]))
        return Problem(source, error["msg"], names, values, line)
    if error["of_key"]:
        return Problem(source, _NOT_A_NAME[path[0]], dotted(path), "", line)
    if error["type"] == "missing":
        text = f"is missing: {_wanted(path, model)}"
        # A missing key has no line; that of its section is shown.
        return Problem(source, text, dotted(path), "", lines.get(path[:-1], 0))
    if error["type"] == UNKNOWN:
        text = _unknown(path, model)
    else:
        text = f"must be {_wanted(path, model)}{_guess(path, model, error['input'])}"
    return Problem(source, text, dotted(path), show(error["input"]), line)


# How the types of fields are called.
_TYPES: dict[Any, str] = {
    str: "a name",
    bool: "true or false",
    float: "a number",
    int: "a whole number",
}


def _wanted(path: tuple[str, ...], model: type[BaseModel]) -> str:
    """Return what the value at a path must be, in words.

    For example 'a number from 5.0 to 12.0 (width of a row between its trees, m)'.
    """
    key = path[0]
    # Else the path leads into the map that the key has.
    is_whole_key = len(path) == 1
    if key in _MAPS:
        of_map, of_value = _MAPS[key]
        if is_whole_key:
            return of_map
        return of_value
    if key in _CLASSES and is_whole_key:
        return _CLASSES[key]
    if key in _CLASSES:
        return "the class that drives it, such as my_package.MyPicker"
    return _wanted_of_field(path, _field(path, model))


def _wanted_of_field(path: tuple[str, ...], field: FieldInfo) -> str:
    """Return the allowed values of a field that is no map of names, nor of classes."""
    # Limits of pydantic and the marks of this program, by the names of their classes.
    limits = {type(limit).__name__: limit for limit in field.metadata}
    if "Called" in limits:
        return f"{limits['Called'].words} ({field.description})"
    is_list = get_origin(field.annotation) is tuple and not path[-1].isdecimal()
    if is_list:
        least = limits["MinLen"].min_length
        most = limits["MaxLen"].max_length
        return f"a list of {least} to {most} maps ({field.description})"
    section = _section(field)
    if section is not None:
        return f"a map with some of the keys {', '.join(section.model_fields)}"
    span = ""
    if "Ge" in limits:
        span = f" from {limits['Ge'].ge} to {limits['Le'].le}"
    return f"{_type_words(field.annotation)}{span} ({field.description})"


def _type_words(annotation: Any) -> str:
    """Return what a field must be by its type: one of `_TYPES`, or one of them or None."""
    if annotation in _TYPES:
        return _TYPES[annotation]
    (words,) = (words for type_, words in _TYPES.items() if annotation == type_ | None)
    return f"null or {words}"


def _field(path: tuple[str, ...], model: type[BaseModel]) -> FieldInfo:
    """Return the field at a path. A number in the path is a place in a list of sections."""
    *section, name = [part for part in path if not part.isdecimal()]
    return _keys(tuple(section), model)[name]


def _guess(path: tuple[str, ...], model: type[BaseModel], value: Any) -> str:
    """Return which known name a wrong one may stand for, in words; nothing if none is near."""
    if path[0] in (*_CLASSES, *_MAPS) or not isinstance(value, str):
        return ""
    known_names = map(str, _field(path, model).examples or [])
    near = difflib.get_close_matches(value[:LONGEST_VALUE], known_names, n=1)
    if near:
        return f"; did you mean {near[0]}?"
    return ""


def _unknown(path: tuple[str, ...], model: type[BaseModel]) -> str:
    """Return what to say of an unknown key: the key that may be meant, here or elsewhere."""
    if len(path) == 1 and path[0] in _OF_FARMS:
        return (
            "unknown key of a scenario: it is one of a farm's file, which only orchard study reads;"
            " harvest each block's own file"
        )
    here = _keys(path[:-1], model)
    elsewhere = _paths(model)
    key = path[-1].lower().replace("-", "_").replace(" ", "_")[:LONGEST_VALUE]
    near_here = difflib.get_close_matches(key, here, n=1)
    near_elsewhere = difflib.get_close_matches(key, elsewhere, n=1)
    if near_here:
        hint = f"; did you mean {near_here[0]}?"
    elif near_elsewhere:
        hint = f"; did you mean {elsewhere[near_elsewhere[0]]}?"
    else:
        hint = ";"
    return f"unknown key{hint} known here: {', '.join(here)}"


def _paths(model: type[BaseModel], before: str = "") -> dict[str, str]:
    """Return the dotted path of each key of a section and of the sections in it.

    If several sections have the same key, it is the path of the outermost one. `before`: the path
    of the section with a dot at its end; "" for the scenario.
    """
    paths: dict[str, str] = {}
    for name, field in model.model_fields.items():
        section = _section(field)
        if section is not None:
            paths |= _paths(section, f"{before}{name}.")
    # Last, because they take the place of equal keys further in.
    for name in model.model_fields:
        paths[name] = before + name
    return paths


def _keys(path: tuple[str, ...], model: Any) -> dict[str, FieldInfo]:
    """Return the fields of the section at a path, by their keys.

    A number in the path is a place in a list of sections.
    """
    for part in path:
        if not part.isdecimal():
            model = _section(model.model_fields[part])
    fields: dict[str, FieldInfo] = model.model_fields
    return fields


def _section(field: FieldInfo) -> type[BaseModel] | None:
    """Return the class of the section that a field holds, alone or in a list; None for a value."""
    for type_ in (field.annotation, *get_args(field.annotation)):
        if isinstance(type_, type) and issubclass(type_, BaseModel):
            return type_
    return None


def key_text(key: Any) -> str:
    """Return a key of any type as readable text: a printable text as it is, all else as `show`."""
    if isinstance(key, str) and key.isprintable() and key:
        return key
    return show(key)


def dotted(path: tuple[str, ...]) -> str:
    """Return a path in a file as text: "people.workers"."""
    return ".".join(map(_shortened, path))


def show(value: Any) -> str:
    """Return a value of any type as YAML text, at most LONGEST_VALUE characters."""
    if value is None:
        return "null"
    if isinstance(value, bool):
        return str(value).lower()
    try:
        text = repr(value)
    except Exception:
        # For example a whole number of more than 4,300 digits.
        text = f"some {type(value).__name__}"
    return _shortened(text)


def _shortened(text: str) -> str:
    """Return a text, or its begin and "..." if it has more than LONGEST_VALUE characters."""
    if len(text) <= LONGEST_VALUE:
        return text
    return text[: LONGEST_VALUE - 3] + "..."
