"""The scenarios that come with the package: the files `config/NAME.yaml`."""

from importlib.resources import files
from pathlib import Path

from orchard.field.scenario import Scenario, load, parse

DEFAULT = "orchard"  # the name of the scenario that a run has if none is given
_CONFIG = files("orchard.config")


def names() -> list[str]:
    """Return the names of all shipped scenarios, sorted."""
    yaml_names = [file.name for file in _CONFIG.iterdir() if file.name.endswith(".yaml")]
    return sorted(name.removesuffix(".yaml") for name in yaml_names)


def shipped() -> dict[str, Scenario]:
    """Return all shipped scenarios by name."""
    return {name: _shipped(name) for name in names()}


def _shipped(name: str) -> Scenario:
    """Return the shipped scenario of a name, which must be one of `names`."""
    return parse(_CONFIG.joinpath(f"{name}.yaml").read_text("utf-8"), f"{name}.yaml")


def load_or_shipped(path: Path | None) -> Scenario:
    """Return the scenario of a file or, without such a file, the shipped one of this name.

    None: the default scenario. Raises `ScenarioError`.
    """
    if path is None:
        return _shipped(DEFAULT)
    if str(path) in names() and not path.is_file():
        return _shipped(str(path))
    return load(str(path))
