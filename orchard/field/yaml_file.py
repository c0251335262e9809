"""A YAML file as plain data, with the line of each key. What a scenario does not need, and what could harm, is refused."""

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
        raise ScenarioError(
            [Problem(source, f"cannot be read: {getattr(error, 'strerror', None) or error}")]
        ) from None
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise ScenarioError([Problem(source, "is not UTF-8 text", line=line)]) from None


class _Loader(yaml.SafeLoader):
    """Plain data only, after YAML 1.2: 010 is not 8, 1:30 is not 90, `on` is not true, 1e-1 is a number."""

    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012  # as its base class has it
    _depth = 0

    def get_event(self) -> Any:
        """Refuse, before it is built: aliases (a few lines of them fill the memory), tags (they name types), deep nesting."""
        event = super().get_event()  # type: ignore[no-untyped-call]
        self._depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(
            event, yaml.CollectionEndEvent
        )
        what = (
            "nested too deeply"
            if self._depth > DEEPEST
            else "aliases (*name)"
            if isinstance(event, yaml.AliasEvent)
            else ""
        )
        if what := what or ("tags (!name)" if getattr(event, "tag", None) else ""):
            raise ScenarioError(
                [_at(event.start_mark, self.name, f"{what}: not allowed in a scenario")]
            )
        return event


class _Dumper(yaml.SafeDumper):
    """Quotes each text that YAML 1.1 or the loader takes for something else: 1e3 is a number for the loader only."""


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
    """Return the values of a YAML text, the line of each key, and a problem for each repeated key. Raises ScenarioError."""
    if len(text.encode("utf-8", "replace")) > LARGEST_FILE:
        raise ScenarioError(
            [
                Problem(
                    source, f"is larger than {LARGEST_FILE} bytes; a scenario needs less than 2000"
                )
            ]
        )
    try:
        loader = _Loader(text)
        loader.name = source
        node = loader.get_single_node()
        lines: Lines = {}
        repeated = _walk(node, source, lines)
        return (loader.construct_document(node) if node else None), lines, repeated
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        raise ScenarioError(
            [_at(mark, source, f"is not YAML: {error.problem or error.context}")]
        ) from None
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        raise ScenarioError(
            [Problem(source, f"is not YAML: {' '.join(str(error).split())}")]
        ) from None


def _at(mark: Any, source: str, text: str) -> Problem:
    if mark is None:
        return Problem(source, text)
    return Problem(
        source, f"{text} (line {mark.line + 1}, column {mark.column + 1})", line=mark.line + 1
    )


def _walk(
    node: yaml.Node | None, source: str, lines: Lines, at: tuple[str, ...] = ()
) -> list[Problem]:
    repeated = []
    for number, item in enumerate(node.value) if isinstance(node, yaml.SequenceNode) else ():
        lines[(*at, str(number))] = item.start_mark.line + 1
        repeated += _walk(item, source, lines, (*at, str(number)))
    for key, value in node.value if isinstance(node, yaml.MappingNode) else ():
        if not isinstance(key, yaml.ScalarNode):
            continue
        path, line = (*at, key_text(key.value)), key.start_mark.line + 1
        if path in lines:
            text = f"given twice, in lines {lines[path]} and {line}; once is allowed"
            repeated.append(
                Problem(
                    source,
                    text,
                    dotted(path),
                    value.value[:60] if isinstance(value, yaml.ScalarNode) else "...",
                    line,
                )
            )
        lines[path] = line
        repeated += _walk(value, source, lines, path)
    return repeated
