"""The scenarios that come with the package: the files `orchard/config/NAME.yaml`."""

from importlib.resources import files
from pathlib import Path

from orchard.field.scenario import Scenario, load, parse

DEFAULT = "orchard"  # the name of the scenario that a run has if none is given


def shipped() -> dict[str, Scenario]:
    """Return these scenarios by name."""
    ready = {file.name: file for file in files("orchard").joinpath("config").iterdir() if file.name.endswith(".yaml")}
    return {name.removesuffix(".yaml"): parse(ready[name].read_text("utf-8"), name) for name in sorted(ready)}


def load_or_shipped(path: Path | None) -> Scenario:
    """Return the scenario of a file, or else the shipped one of this name; the default one for None. Raises `ScenarioError`."""
    ready, name = shipped(), DEFAULT if path is None else str(path)
    return ready[name] if name in ready and (path is None or not path.is_file()) else load(name)
