"""Small orchards drawn at random, in which machines drive and handle bins fast or slowly.

They are quiet: without people, animals, weeds and tractor.
"""

from collections.abc import Iterator
from random import Random
from typing import Any

from quiet import NOBODY, laid_out

from orchard.field.layout import Layout

# m/s and degrees/s that a scenario allows at most.
FASTEST = 2.5
FASTEST_TURN = 60.0
POLICIES = ("nearest", "predictive", "rolling", "assignment")


def drawn_machines(seed: int, count: int) -> Iterator[Layout]:
    """Yield so many layouts. Values that cannot be built together are drawn again."""
    chances = Random(f"machines {seed}")
    return laid_out(lambda: _orchard(chances) | drawn_values(chances), count)


def _orchard(chances: Random) -> dict[str, Any]:
    rows = chances.randint(4, 6)
    return NOBODY | {
        "rows": rows,
        "row_length": float(chances.randint(20, 30)),
        "row_width": chances.choice([5.0, 5.0, 3.2, 4.0, 8.0]),
        "pickers": chances.randint(2, 4),
        "carriers": chances.randint(1, 6),
        "picking_speed": chances.choice([0.4, 0.2, 0.08]),
        "route": chances.choice(["one-way", "two-way"]),
        "dispatch": chances.choice(POLICIES),
        "seed": chances.randint(1, 1000),
    }


def drawn_values(chances: Random) -> dict[str, Any]:
    """Return the sections of a scenario that say how fast machines drive, turn and handle bins.

    Speeds are in m/s, turning in degrees/s, times in s. 22.5 degrees/s is the default. The first
    value of each `handling` is both the default and the least.
    """
    return {
        "picking": {
            "driving_speed": _often_fastest(chances, 0.5, FASTEST),
            "turning": round(chances.choice([22.5, _often_fastest(chances, 5, FASTEST_TURN)]), 1),
        },
        "carrying": {
            "speed": _often_fastest(chances, 0.5, FASTEST),
            "turning": round(chances.choice([22.5, _often_fastest(chances, 5, FASTEST_TURN)]), 1),
        },
        "handling": {
            "coupling": round(chances.choice([0.2, chances.uniform(0.2, 120)]), 1),
            "uncoupling": round(chances.choice([0.4, chances.uniform(0.4, 120)]), 1),
            "exchange": round(chances.choice([0.0, chances.uniform(0, 120)]), 1),
            "unloading": round(chances.choice([5.0, chances.uniform(5, 300)]), 1),
        },
    }


def _often_fastest(chances: Random, slowest: float, fastest: float) -> float:
    """Return a value between two limits. In one of four draws it is the upper one."""
    beyond = fastest + (fastest - slowest) / 3
    return min(fastest, round(chances.uniform(slowest, beyond), 2))
