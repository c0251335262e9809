"""Scenarios as text: read from YAML with the line of each problem, and written as YAML."""

from pathlib import Path

from orchard.field.problems import key_text
from orchard.field.scenario.checking import check
from orchard.field.scenario.effect import with_effect
from orchard.field.scenario.rules import Scenario
from orchard.field.yaml_file import dump, read, values_of


def load(path: str | Path) -> Scenario:
    """Return the scenario in a YAML file.

    Values that the file leaves out keep their defaults. Raises `ScenarioError`.
    """
    source = key_text(str(path))
    return parse(read(path, source), source)


def parse(text: str, source: str = "scenario") -> Scenario:
    """Return the scenario in a YAML text.

    `source` names the text in errors. Raises `ScenarioError`.

    >>> parse("rows: 8").rows
    8
    """
    values, lines, repeated = values_of(text, source)
    if values is None:
        values = {}
    scenario = check(values, source, lines, repeated)
    return with_effect(scenario, source, lines)


def to_yaml(scenario: Scenario) -> str:
    """Return all values of a scenario as YAML. `parse` reads it back to an equal scenario."""
    return dump(scenario.model_dump())


def to_short_yaml(scenario: Scenario) -> str:
    """Return the values of a scenario that differ from their defaults as YAML.

    A surveyed row takes one line, as flow style has it.

    >>> print(to_short_yaml(Scenario(rows=8, carriers=3)), end="")
    {rows: 8, carriers: 3}
    """
    return dump(scenario.model_dump(exclude_defaults=True), default_flow_style=None, width=200)
