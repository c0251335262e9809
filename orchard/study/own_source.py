"""The source of the classes and functions of a user's own that a scenario names: a run is known only as long as this stays the same."""

import ast
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from importlib.util import find_spec, resolve_name
from itertools import accumulate
from pathlib import Path

from orchard.field.plugins import is_own, load_plugin
from orchard.field.scenario import Scenario


@cache
def own_source(classes: tuple[tuple[str, str], ...]) -> tuple[bytes, ...]:
    """Return the files of a scenario's own classes, and the user's files that these import, each once. Raises ScenarioError.

    Also those that are imported in a function. What else the classes read, such as a table of data, is not in it: after a change there,
    take another store.
    """
    for key, path in classes:
        load_plugin(key if key in Scenario.model_fields else f"agents.{key}", path)
    files: dict[str, bytes] = {}
    left = [path.replace(":", ".").rpartition(".")[0] for _, path in classes]
    packages = {module.partition(".")[0] for module in left}  # one that is installed as a library is the user's too
    while left:
        name = left.pop()
        file = _file(name, packages)
        if file is not None and name not in files:
            files[name] = file.read_bytes()
            left += _imported(files[name], name if file.stem == "__init__" else name.rpartition(".")[0])
    return tuple(files[name] for name in sorted(files))


def _file(name: str, packages: set[str]) -> Path | None:
    """The file of a module if it is the user's. A library is not even looked into, because that would import it."""
    whole = name.partition(".")[0]
    with suppress(ImportError, ValueError):
        top = find_spec(whole)
        if top is not None and (whole in packages or top.origin is None or is_own(top.origin)):
            found = find_spec(name)
            return Path(found.origin) if found and found.origin and found.origin.endswith(".py") else None
    return None


def _imported(source: bytes, package: str) -> Iterator[str]:
    """The dotted names that a file of a package may import, each with the packages that it is in."""
    names: list[str] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            whole = resolve_name("." * node.level + (node.module or ""), package)
            names += [whole, *(f"{whole}.{alias.name}" for alias in node.names)]
    return (part for name in names for part in accumulate(name.split("."), "{}.{}".format))
