"""Random orchards for tests that compare the event model with the simulator.

A quiet orchard has no people, animals, weeds or tractor, and nothing fails in it. A test adds the
rest by values of its own.
"""

from collections.abc import Callable, Iterator
from random import Random
from typing import Any

from pydantic import ValidationError

from orchard.field.layout import Layout, lay_out
from orchard.field.problems import ScenarioError
from orchard.field.scenario import Scenario

NOBODY: dict[str, Any] = {
    "people": {"workers": 0, "visitors": 0},
    "animals": {"dogs": 0, "cats": 0},
    "weeds": 0,
    "tractor": False,
}
POLICIES = (
    "nearest",
    "farthest-first",
    "longest-waiting",
    "predictive",
    "predictive-farthest",
    "assignment",
)


def quiet_layouts(seed: int, count: int) -> Iterator[Layout]:
    """Yield so many random layouts. What cannot be built is drawn again."""
    return random_layouts(seed, count, lambda _: {})


def random_layouts(
    seed: int, count: int, values_of: Callable[[Random], dict[str, Any]]
) -> Iterator[Layout]:
    """Yield so many random layouts.

    `values_of`: returns values of a scenario that are put over those of a quiet one. Where a value
    is a section, such as `carrying`, only its own entries are replaced.
    """
    chances = Random(seed)

    def drawn() -> dict[str, Any]:
        values = _values(chances)
        for group, more in values_of(chances).items():
            values[group] = values.get(group, {}) | more if isinstance(more, dict) else more
        return values

    return laid_out(drawn, count)


def laid_out(drawn: Callable[[], dict[str, Any]], count: int) -> Iterator[Layout]:
    """Yield the layouts of so many drawn scenarios. What cannot be built is drawn again.

    `drawn`: draws the values of one scenario.
    """
    laid = 0
    while laid < count:
        values = drawn()
        try:
            layout = lay_out(Scenario.model_validate(values))
        except (ScenarioError, ValidationError):
            continue
        laid += 1
        yield layout


def small_harvest(chances: Random, rows: tuple[int, int], load_out: Any) -> dict[str, Any]:
    """Return the values of a small orchard, drawn at random, with this load-out.

    `rows`: the fewest and the most. `load_out`: that section of the scenario.
    """
    return NOBODY | {
        "rows": chances.randint(*rows),
        "row_length": float(chances.randint(20, 30)),
        "pickers": chances.randint(2, 3),
        "carriers": chances.randint(1, 6),
        "picking_speed": chances.choice([1.0, 0.4, 0.15]),
        "route": chances.choice(["one-way", "two-way"]),
        "dispatch": chances.choice(["nearest", "predictive", "rolling", "assignment"]),
        "seed": chances.randint(1, 1000),
        "load_out": load_out,
    }


def _values(chances: Random) -> dict[str, Any]:
    """Return the values of a scenario, which may be impossible together."""
    rows = chances.randint(2, 14)
    pickers = chances.randint(1, rows)
    values = NOBODY | {
        "rows": rows,
        "pickers": pickers,
        "carriers": chances.randint(1, 14),
        "row_length": float(chances.choice([24, 30, 40, 70, 90])),
        "picking_speed": chances.choice([1.0, 0.5, 0.2, 0.08]),
        "route": chances.choice(["one-way", "two-way"]),
        "dispatch": chances.choice(POLICIES),
        "rows_to_pickers": chances.choice(["manual", "balanced", "balanced-ends"]),
        "order_in_row": chances.choice(["onward", "outward"]),
        "seed": chances.randint(1, 1000),
    }
    if chances.random() < 0.4:
        values["metres_per_bin"] = float(chances.choice([11, 17.5, 22, 55, 100]))
    if values["picking_speed"] < 1.0 and chances.random() < 0.5:
        values["picking"] = {"spread": {"distribution": "gamma", "cv": 0.3}}
    return values
