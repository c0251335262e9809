"""The rules that give rows, numbered from 1 at the top, to pickers: functions of the `Scenario` that return {picker: Block}."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

from orchard.field.kinds import name_of
from orchard.field.plugins import MISTAKES, contained, load_plugin, place_of_class, unusable
from orchard.field.scenario import BALANCED, BALANCED_ENDS, MANUAL, Scenario

End = Literal["west", "east"]


@dataclass(frozen=True)
class Block:
    """The rows of a picker: neighbours, in the order in which it picks them, from north to south, because pickers go on southward only."""

    rows: tuple[int, ...]
    start: End = "west"  #: the end of the first row at which it starts; from there on it ends its rows on either side in turn


def balanced(scenario: Scenario) -> dict[str, Block]:
    """Return neighbouring rows for each picker so that none has two more than another."""
    return _cut(
        scenario, [scenario.rows * i // scenario.pickers for i in range(scenario.pickers + 1)]
    )


def balanced_ends(scenario: Scenario) -> dict[str, Block]:
    """Return the blocks of `balanced`; every second picker starts at the east end, so both sides' roads are used from the beginning."""
    return {
        name: Block(block.rows, ("west", "east")[i % 2])
        for i, (name, block) in enumerate(balanced(scenario).items())
    }


def manual(scenario: Scenario) -> dict[str, Block]:
    """Return rows by the manual's rule: rows // pickers neighbouring rows for each picker; the last one gets the remainder too."""
    share = scenario.rows // scenario.pickers
    return _cut(scenario, [*(i * share for i in range(scenario.pickers)), scenario.rows])


RULES: dict[str, Callable[[Scenario], dict[str, Block]]] = {
    BALANCED: balanced,
    BALANCED_ENDS: balanced_ends,
    MANUAL: manual,
}


def rows_to_pickers(scenario: Scenario) -> dict[str, Block]:
    """Return the block of each picker by the rule that the scenario names: a built-in one, or a user's function.

    A user's rule may return plain sequences of rows, which begin in the west. Raises ScenarioError for a rule or a result that cannot be.
    """
    key, path = "rows_to_pickers", scenario.rows_to_pickers
    if path in RULES:
        return RULES[path](scenario)
    rule = load_plugin(key, path)
    try:
        return _checked(contained(rule, scenario), scenario)
    except MISTAKES as error:
        wanted = "a function of the scenario that returns {picker: Block or rows}"
        raise unusable(key, path, error, wanted, place_of_class(rule)) from error


def _checked(given: Mapping[str, Any], scenario: Scenario) -> dict[str, Block]:
    if not isinstance(given, Mapping) or any(name not in given for name in _pickers(scenario)):
        raise TypeError(
            f"it returned {given!r}; it must return a map with the keys {', '.join(_pickers(scenario))}"
        )
    named = {
        name: given[name] if isinstance(given[name], Block) else Block(given[name])
        for name in _pickers(scenario)
    }
    blocks = {
        name: Block(tuple(int(row) for row in block.rows), block.start)
        for name, block in named.items()
    }
    shown = {name: block.rows for name, block in blocks.items()}
    if sorted(row for rows in shown.values() for row in rows) != list(
        range(1, scenario.rows + 1)
    ) or not all(shown.values()):
        raise ValueError(
            f"{shown}: each row of 1 to {scenario.rows} must go to one picker, and each picker must get at least one"
        )
    if any(rows != tuple(range(rows[0], rows[-1] + 1)) for rows in shown.values()):
        raise ValueError(
            f"{shown}: the rows of a picker must be neighbours, in their order from north to south"
        )
    if wrong := [
        f"{name} at {block.start!r}"
        for name, block in blocks.items()
        if block.start not in get_args(End)
    ]:
        raise ValueError(f"a picker starts at the end 'west' or 'east', and not {', '.join(wrong)}")
    return blocks


def _cut(scenario: Scenario, ends: list[int]) -> dict[str, Block]:
    """`ends`: the last row before each block, and that of the last block."""
    return {
        name: Block(tuple(range(ends[i] + 1, ends[i + 1] + 1)))
        for i, name in enumerate(_pickers(scenario))
    }


def _pickers(scenario: Scenario) -> list[str]:
    return [name_of("picker", i + 1) for i in range(scenario.pickers)]
