"""The scenarios that come with the package: the files `config/NAME.yaml`."""

from importlib.resources import files
from pathlib import Path

from orchard.field.scenario import Scenario, load, parse

DEFAULT = "orchard"  # the name of the scenario that a run has if none is given
_CONFIG = files("orchard.config")


def names() -> list[str]:
    """Return the names of all scenarios that come with the package, in order."""
    return sorted(
        file.name.removesuffix(".yaml") for file in _CONFIG.iterdir() if file.name.endswith(".yaml")
    )


def shipped() -> dict[str, Scenario]:
    """Return all scenarios that come with the package, by their names."""
    return {name: _one(name) for name in names()}


def _one(name: str) -> Scenario:
    return parse(_CONFIG.joinpath(f"{name}.yaml").read_text("utf-8"), f"{name}.yaml")


def load_or_shipped(path: Path | None) -> Scenario:
    """Return the scenario of a file, or else the shipped one of this name; the default one for
    None. Raises `ScenarioError`.
    """
    name = DEFAULT if path is None else str(path)
    return _one(name) if name in names() and (path is None or not path.is_file()) else load(name)
