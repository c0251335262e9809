"""A note on whole sections and maps that vary: what their values leave out stays as it is."""

from collections.abc import Mapping, Sequence
from typing import Any

from orchard.field.problems import show
from orchard.field.scenario import Scenario
from orchard.field.scenario.checking import NAMED_BY_USERS

# How many kept values a note names.
MOST_NAMED = 4


def notes_on_kept_values(varied: Mapping[str, Sequence[Any]], scenario: Scenario) -> list[str]:
    """Return a note for each key that varies in whole maps which leave out something that the
    scenario sets.

    `varied`: dotted path -> its values. Such a map is put into that of the scenario, so the table
    alone would not tell what a setting has.
    """
    notes = []
    for key, values in varied.items():
        kept = _kept(key, values, scenario)
        if not kept:
            continue
        words = [f"{name} {show(value)}" for name, value in kept.items()]
        named = ", ".join(words[:MOST_NAMED])
        if len(words) > MOST_NAMED:
            named += f" and {len(words) - MOST_NAMED} more"
        remedy = "to take it out, say so in the value, as null"
        if key in NAMED_BY_USERS:
            remedy = "{} takes all of it out"
        notes.append(
            f"{key}: what a value leaves out stays as the scenario has it: {named}; {remedy}"
        )
    return notes


def _kept(key: str, values: Sequence[Any], scenario: Scenario) -> dict[str, Any]:
    """Return what the scenario sets below a key and some values leave out: path -> value."""
    said = []
    for value in values:
        empties_map = key in NAMED_BY_USERS and not value
        if isinstance(value, dict) and not empties_map:
            said.append(set(_leaves(value)))
    if not said:
        # The scenario need not have the key: picker_rates.picker_01.
        return {}
    said_by_all = set.intersection(*said)
    usual = _leaves(_at(Scenario(), key))
    kept = {}
    for path, value in sorted(_leaves(_at(scenario, key)).items()):
        is_usual = path in usual and usual[path] == value
        if not is_usual and path not in said_by_all:
            kept[path] = value
    return kept


def _at(scenario: Scenario, key: str) -> Any:
    """Return the value of a scenario at a dotted path."""
    value: Any = scenario.model_dump()
    for name in key.split("."):
        value = value[name]
    return value


def _leaves(value: Any) -> dict[str, Any]:
    """Return what is in a map and the maps in it: dotted path -> value; {} of no map."""
    if not isinstance(value, dict):
        return {}
    leaves = {}
    for name, inner in value.items():
        if not isinstance(inner, dict):
            leaves[name] = inner
        for path, leaf in _leaves(inner).items():
            leaves[f"{name}.{path}"] = leaf
    return leaves
