"""A YAML file as plain data, with the line of each key.

What a scenario does not need, and what could harm, is refused.
"""

import re
from pathlib import Path
from typing import Any

import yaml

from orchard.field.problems import Lines, Problem, ScenarioError, dotted, key_text
from orchard.folders import regular

LARGEST_FILE = 65536  # bytes; a whole scenario needs less than 2,000
DEEPEST = 8  # levels in a file; a scenario needs 3


def dump(values: dict[str, Any], **layout: Any) -> str:
    """Return values as YAML, in their order. `layout`: as of `yaml.safe_dump`."""
    text: str = yaml.dump(values, Dumper=_Dumper, sort_keys=False, **layout)
    return text


def read(path: str | Path, source: str) -> str:
    """Return the text of a file; `source` names it in errors. Raises ScenarioError."""
    try:
        with regular(path).open("rb") as file:
            content = file.read(LARGEST_FILE + 1)
    except FileNotFoundError:
        raise ScenarioError([Problem(source, "no such file")]) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ScenarioError([Problem(source, f"cannot be read: {reason}")]) from None
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise ScenarioError([Problem(source, "is not UTF-8 text", line=line)]) from None


class _Loader(yaml.SafeLoader):
    """Plain data only, after YAML 1.2.

    So 010 is not 8, 1:30 is not 90, `on` is not true, and 1e-1 is a number.
    """

    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012  # as its base class has it
    _depth = 0

    def get_event(self) -> Any:
        """Return the next part of the text. Refuse what is not allowed before it is built."""
        event = super().get_event()  # type: ignore[no-untyped-call]
        if isinstance(event, yaml.CollectionStartEvent):
            self._depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            self._depth -= 1
        refused = self._refused(event)
        if refused:
            text = f"{refused}: not allowed in a scenario"
            raise ScenarioError([_at(event.start_mark, self.name, text)])
        return event

    def _refused(self, event: yaml.Event) -> str:
        """Return what is not allowed in a part of a text; "" if all is.

        A few lines of aliases fill the memory, and tags name types.
        """
        if self._depth > DEEPEST:
            return "nested too deeply"
        if isinstance(event, yaml.AliasEvent):
            return "aliases (*name)"
        if getattr(event, "tag", None):
            return "tags (!name)"
        return ""


class _Dumper(yaml.SafeDumper):
    """Quotes each text that YAML 1.1 or the loader takes for something else.

    For example, 1e3 is a number for the loader only.
    """


for _tag, _pattern, _first in (
    ("null", r"(~|null|Null|NULL|)$", ["~", "n", "N", ""]),
    ("bool", r"(true|True|TRUE|false|False|FALSE)$", list("tTfF")),
    ("int", r"[-+]?(0|[1-9][0-9]{0,18})$", list("-+0123456789")),
    (
        "float",
        r"[-+]?(0|[1-9][0-9]*)?(\.[0-9]+|(?<=[0-9])\.?)([eE][-+]?[0-9]+)?$",
        list("-+.0123456789"),
    ),
    ("float", r"([-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN))$", list("-+.")),
):
    for _class in (_Loader, _Dumper):
        _class.add_implicit_resolver(f"tag:yaml.org,2002:{_tag}", re.compile(_pattern), _first)


def values_of(text: str, source: str) -> tuple[Any, Lines, list[Problem]]:
    """Return the values of a YAML text, the line of each key, and a problem for each repeated key.

    `source`: names the text in errors. Raises ScenarioError.
    """
    if len(text.encode("utf-8", "replace")) > LARGEST_FILE:
        too_large = f"is larger than {LARGEST_FILE} bytes; a scenario needs less than 2000"
        raise ScenarioError([Problem(source, too_large)])
    try:
        loader = _Loader(text)
        loader.name = source
        node = loader.get_single_node()
        keys = _Keys(source)
        keys.read(node)
        values = loader.construct_document(node) if node else None
        return values, keys.lines, keys.repeated
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        fault = f"is not YAML: {error.problem or error.context}"
        raise ScenarioError([_at(mark, source, fault)]) from None
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        fault = f"is not YAML: {' '.join(str(error).split())}"
        raise ScenarioError([Problem(source, fault)]) from None


def _at(mark: Any, source: str, text: str) -> Problem:
    """Return a problem at a place of a text. `mark`: the place, as YAML tells it, or None."""
    if mark is None:
        return Problem(source, text)
    line = mark.line + 1
    return Problem(source, f"{text} (line {line}, column {mark.column + 1})", line=line)


LONGEST_VALUE = 60  # characters of a value in a problem


class _Keys:
    """The keys of a YAML text: the line of each, and a problem for each that is repeated."""

    def __init__(self, source: str) -> None:
        self._source = source
        self.lines: Lines = {}
        self.repeated: list[Problem] = []

    def read(self, node: yaml.Node | None, at: tuple[str, ...] = ()) -> None:
        """Note the keys of a part of the text. `at`: its path."""
        if isinstance(node, yaml.SequenceNode):
            for number, item in enumerate(node.value):
                path = (*at, str(number))
                self.lines[path] = item.start_mark.line + 1
                self.read(item, path)
        elif isinstance(node, yaml.MappingNode):
            for key, value in node.value:
                if isinstance(key, yaml.ScalarNode):
                    path = (*at, key_text(key.value))
                    self._note(path, key.start_mark.line + 1, value)
                    self.read(value, path)

    def _note(self, path: tuple[str, ...], line: int, value: yaml.Node) -> None:
        """Note the line of a key, and whether there is another one with the same path."""
        before = self.lines.get(path)
        self.lines[path] = line
        if before is None:
            return
        text = f"given twice, in lines {before} and {line}; once is allowed"
        shown = value.value[:LONGEST_VALUE] if isinstance(value, yaml.ScalarNode) else "..."
        self.repeated.append(Problem(self._source, text, dotted(path), shown, line))
