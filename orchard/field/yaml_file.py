"""A YAML file as plain data, with the line of each key.

Aliases, tags, large files and deep nesting are refused: a scenario needs none of them, and they
could harm.
"""

import re
from pathlib import Path
from typing import Any

import yaml

from orchard.field.problems import (
    LONGEST_VALUE,
    Lines,
    Problem,
    ScenarioError,
    dotted,
    key_text,
)
from orchard.folders import regular

# Bytes. A scenario needs less than 2,000, with a survey of 100 rows about 10,000.
LARGEST_FILE = 65536
# Maps and lists within each other. A scenario needs 4, as in picker_absences.
DEEPEST = 8


def dump(values: dict[str, Any], **layout: Any) -> str:
    """Return values as YAML, in their order. `layout`: keyword arguments of `yaml.safe_dump`."""
    text: str = yaml.dump(values, Dumper=_Dumper, sort_keys=False, **layout)
    return text


def read(path: str | Path, source: str) -> str:
    """Return the text of a file, or a beginning of it that is too long for `values_of`.

    `source`: names the file in errors. Raises ScenarioError.
    """
    try:
        with regular(path).open("rb") as file:
            # With one byte more than is allowed, `values_of` sees that the file is too large.
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
    """Reads plain data only, by the rules of YAML 1.2, where PyYAML has those of YAML 1.1.

    So 010 is not 8, 1:30 is not 90, `on` is not true, and 1e-1 is a number.
    """

    # Empty, so that the rules of YAML 1.1 of the base class do not hold; those of YAML 1.2 are
    # added below.
    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012  # as its base class has it
    # In how many maps and lists the present part of the text is.
    _depth = 0

    def get_event(self) -> Any:
        """Return the next part of the text, for the base class, which builds values from it.

        Raises ScenarioError for what is not allowed, before any of it is built.
        """
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
        """Return what is not allowed in a part of a text; "" if all of it is allowed.

        With aliases in aliases a few lines fill the memory; tags make objects of other types.
        """
        if self._depth > DEEPEST:
            return "nested too deeply"
        if isinstance(event, yaml.AliasEvent):
            return "aliases (*name)"
        if getattr(event, "tag", None):
            return "tags (!name)"
        return ""


class _Dumper(yaml.SafeDumper):
    """Writes values, and quotes each text that YAML 1.1 or the loader would take for no text.

    For example, the text 1e3 is a number for the loader, and none in YAML 1.1.
    """


# Type, pattern of the whole text, characters with which such a text may begin: the rules of
# YAML 1.2 by which a text without quotes is no text. The loader gets only these, the dumper these
# beside its own.
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

    The values are None for an empty text. `source`: names the text in errors. Raises ScenarioError.
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


class _Keys:
    """The keys of a YAML text: the line of each, and a problem for each that is repeated."""

    def __init__(self, source: str) -> None:
        self._source = source
        self.lines: Lines = {}
        self.repeated: list[Problem] = []

    def read(self, node: yaml.Node | None, at: tuple[str, ...] = ()) -> None:
        """Note the keys of a part of the text, and of the parts in it. `at`: the path of the part.

        A place in a list counts as a key: "0", "1" and so on.
        """
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
        """Note the line of a key, and a problem if an earlier key has the same path."""
        before = self.lines.get(path)
        self.lines[path] = line
        if before is None:
            return
        text = f"given twice, in lines {before} and {line}; once is allowed"
        shown = value.value[:LONGEST_VALUE] if isinstance(value, yaml.ScalarNode) else "..."
        self.repeated.append(Problem(self._source, text, dotted(path), shown, line))
