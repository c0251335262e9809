"""Each key of the scenario says whether its value is a choice or a circumstance, once.

The grower makes a choice for the next harvest, such as the number of carriers. A circumstance is
given, such as how fast people pick. A section may say it for all that is in it.
"""

from collections.abc import Iterator
from typing import Any

import pytest

from orchard.field.decisions import Decision, decided, decision_at, is_choice
from orchard.field.scenario import Scenario

SCHEMA = Scenario.model_json_schema()


def keys(schema: dict[str, Any], before: str = "") -> Iterator[list[str]]:
    """Yield the path of each value that is no section, and the paths of the sections around it."""
    for name, field in schema["properties"].items():
        path = f"{before}{name}"
        # A section refers to its own schema, by itself or as the only part of `allOf`.
        parts = [field, *field.get("allOf", [])]
        references = [part["$ref"] for part in parts if "$ref" in part]
        if not references:
            yield [path]
            continue
        section = SCHEMA["$defs"][references[0].rpartition("/")[2]]
        for paths in keys(section, f"{path}."):
            yield [path, *paths]


def test_each_key_of_the_schema_is_a_choice_or_a_circumstance():
    unknown = [paths[-1] for paths in keys(SCHEMA) if decision_at(Scenario, paths[-1]) is None]
    assert unknown == [], "mark these fields of the scenario with CHOICE or CIRCUMSTANCE"
    assert len(list(keys(SCHEMA))) > 40


def test_each_path_is_decided_once():
    choices = set(decided(Scenario, Decision.CHOICE))
    circumstances = set(decided(Scenario, Decision.CIRCUMSTANCE))
    assert {"dispatch", "carrying.battery.reserve"} < choices
    assert {"people", "carrying.failure"} < circumstances
    for paths in keys(SCHEMA):
        assert len([path for path in paths if path in choices | circumstances]) == 1, paths


@pytest.mark.parametrize(
    ("path", "decision"),
    [
        ("pickers", Decision.CHOICE),
        ("dispatch", Decision.CHOICE),
        ("agents.picker", Decision.CHOICE),
        ("carrying.battery.reserve", Decision.CHOICE),
        ("carrying.battery.hours", Decision.CIRCUMSTANCE),
        ("prices.carrier_per_hour", Decision.CIRCUMSTANCE),
        ("picking_rate", Decision.CIRCUMSTANCE),
        ("picking.spread.cv", Decision.CIRCUMSTANCE),
        ("carrying", None),
        ("no_such.key", None),
    ],
)
def test_a_value_is_decided_as_its_section_is(path: str, decision: Decision | None):
    assert decision_at(Scenario, path) == decision


@pytest.mark.parametrize(
    ("path", "values", "choice"),
    [
        ("carriers", [1, None], True),
        ("picking_speed", [0.3, 0.5], False),
        ("people", [{"workers": 0}, {}], False),
        ("carrying", [{"battery": {"reserve": 0.1}}, {"battery": {"reserve": 0.2}}], True),
        ("carrying", [{"battery": {"reserve": 0.1, "hours": 2.0}}], False),
        ("survey", [None], False),
    ],
)
def test_a_section_is_a_choice_if_all_that_changes_is(path: str, values: list, choice: bool):
    assert is_choice(Scenario, path, values) == choice
