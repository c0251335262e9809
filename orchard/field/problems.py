"""Error reports for a scenario that cannot be used: file, line, key, value, what is allowed; and
what all its sections are.
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

MOST_NAMED = 50  # problems in the text of a ScenarioError
# What pydantic calls an unknown key.
UNKNOWN = "extra_forbidden"
LONGEST = 200  # characters of a line of a user's code

Lines = dict[tuple[str, ...], int]  # path in the file -> its line, from 1

# What each map of names and classes must be.
_CLASSES = {
    "agents": (
        f"a map of kinds ({', '.join(KINDS)}) or names and the classes that drive them: {{picker:"
        " my_package.MyPicker}"
    ),
    "agents_without_body": (
        "a map of new names and the classes that drive them: {weather: my_package.Weather}"
    ),
}
# The same of other maps, and of a value in them.
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
# What is wrong with a key of such a map.
_NOT_A_NAME = {
    "picker_absences": "not the name of a picker, such as picker_01",
    "picker_rates": "not the name of a picker, such as picker_01",
    "agents": f"not a kind ({', '.join(KINDS)}) and not a name such as picker_01",
    "agents_without_body": "not a name: small letters, digits and _, beginning with a letter",
}


def printable(words: str, most: int = LONGEST) -> str:
    """Return the text of an agent, a class or a client that may be faulty as one short line,
    harmless in a terminal, a log and a page.
    """
    short = words
    if len(words) > most:
        short = words[: most - 3] + "..."
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
        paths = self.path.split(", ")
        values = self.value.split(", ")
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
    """A mark of a field: what a value of it must be, in words, where its type does not say it."""

    words: str


class ScenarioError(Exception):
    """A scenario cannot be used.

    `problems` holds all its faults in file order; the message names the first MOST_NAMED of them.

    `rest`: the scenario with the defaults in place of all that is wrong; None if nothing of it can
    be read.
    """

    def __init__(self, problems: list[Problem], rest: Any = None) -> None:
        """`problems`: in any order. `rest`: as above."""
        self.problems = sorted(problems, key=lambda problem: problem.line)
        self.rest = rest
        lines = [str(problem) for problem in self.problems[:MOST_NAMED]]
        more = len(problems) - MOST_NAMED
        if more > 0:
            lines.append(f"and {more} more problems")
        super().__init__("\n".join(lines))

    def __reduce__(self) -> tuple[Any, ...]:
        """Be pickled as the problems, so that it comes out of a worker process as it is."""
        return type(self), (self.problems, self.rest)


class Section(BaseModel):
    """A section of a scenario: a map with known keys, strictly typed, with rules about several of
    their fields.
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
        raise ScenarioError(problems_of(errors, type(self), type(self).__name__, {}))

    # A whole scenario is validated at once, with what is in its sections.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    def _demand(self, is_met: bool, text: str, *fields: str) -> None:
        """Check a rule about several fields, named by dotted paths.

        Raise an error that names them and their values unless it is met.
        """
        if not is_met:
            values = [reduce(getattr, field.split("."), self) for field in fields]
            raise PydanticCustomError(
                "rule", "{text}", {"text": text, "fields": fields, "values": values}
            )


def errors_of(failure: ValidationError) -> list[dict[str, Any]]:
    """Return the errors of pydantic, for `problems_of`.

    Each has the paths of the fields that it is about, and whether it is about a key of a map.
    """
    details = failure.errors(include_url=False)
    return [_located(error) for error in details if not _follows_from_others(error)]


def _follows_from_others(error: Any) -> bool:
    """Whether an error only follows from others: pydantic does not count the invalid items of a
    list, and then says that the list is too short.
    """
    return bool(
        error["type"] == "too_short" and error["ctx"]["actual_length"] < len(error["input"])
    )


def _located(error: Any) -> dict[str, Any]:
    """Return an error of pydantic with the paths of the fields that it is about, and whether it is
    about a key of a map.
    """
    location = error["loc"]
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
    """Return the problems that errors of `errors_of` are, about values of `model`, in file order.

    `lines`: the line of each key.
    """
    in_order = sorted(errors, key=lambda error: _line_of(error, lines))
    unknown = [error for error in in_order if error["type"] == UNKNOWN]
    # To look for a known key like an unknown one takes 3 ms, and a text names these only.
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
    """Convert an error about values of `model`; `lines` gives the line of each key."""
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
    """The allowed values of a field: 'a number from 5.0 to 12.0 (width of a row between its trees,
    m)'.
    """
    key = path[0]
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
    """Return what a field must be by its type, or by its type and None."""
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
    near = difflib.get_close_matches(value[:60], known_names, n=1)
    if near:
        return f"; did you mean {near[0]}?"
    return ""


def _unknown(path: tuple[str, ...], model: type[BaseModel]) -> str:
    """Return what to say of an unknown key: the key it may stand for, here or elsewhere."""
    here = _keys(path[:-1], model)
    elsewhere = _paths(model)
    key = path[-1].lower().replace("-", "_").replace(" ", "_")[:60]
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
    """Return the dotted path of each key of a section and of those in it; the outer one wins.

    `before`: the path of the section, with a dot at its end.
    """
    paths: dict[str, str] = {}
    for name, field in model.model_fields.items():
        section = _section(field)
        if section is not None:
            paths |= _paths(section, f"{before}{name}.")
    for name in model.model_fields:
        paths[name] = before + name
    return paths


def _keys(path: tuple[str, ...], model: Any) -> dict[str, FieldInfo]:
    """The fields of the section at a path. A number in it is a place in a list of sections."""
    for part in path:
        if not part.isdecimal():
            model = _section(model.model_fields[part])
    fields: dict[str, FieldInfo] = model.model_fields
    return fields


def _section(field: FieldInfo) -> type[BaseModel] | None:
    """Return the section that a field is, or a list of which it is; None for a value."""
    for type_ in (field.annotation, *get_args(field.annotation)):
        if isinstance(type_, type) and issubclass(type_, BaseModel):
            return type_
    return None


def key_text(key: Any) -> str:
    """Return a key of any type as readable text."""
    if isinstance(key, str) and key.isprintable() and key:
        return key
    return show(key)


def dotted(path: tuple[str, ...]) -> str:
    """Return a path in a file as text: "people.workers"."""
    return ".".join(map(_shortened, path))


def show(value: Any) -> str:
    """Return a value of any type as YAML text, at most 60 characters."""
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
    """Return a text, or its first 57 characters if it has more than 60."""
    if len(text) <= 60:
        return text
    return text[:57] + "..."
