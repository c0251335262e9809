"""Surveyed blocks of any outline: slanted, triangular, long, ragged, with missing rows. The event
model and the simulator harvest them alike, and no robots collide.
"""

from collections.abc import Callable
from random import Random
from statistics import fmean
from typing import Any

import pytest
from made_surveys import Row, orchard_of

from orchard.discrete.harvest import DiscreteHarvest
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario
from orchard.field.survey import WIDEST_GAP
from orchard.local import Local

# Blocks are numbered by their seeds: the first FEW are tested each time, the others in the soak.
FEW = 4
MANY = 60
# Ticks after which a harvest is given up: more than the longest of these harvests takes.
LONGEST = 80_000
# From west to east, m: start and end of the row that lies so far south.
Outline = Callable[[float], tuple[float, float]]


def drawn_block(random: Random) -> Scenario:
    """Draw a block of four to eight rows, and the robots that harvest it."""
    # m from row to row. A missing row leaves a gap of some spacings.
    spacing = random.choice([3.65, 4.57, 6.0, 9.0])
    souths = [0.0]
    for number in range(random.randint(3, 7)):
        is_missing = number > 0 and random.random() < 0.2
        gap = min(WIDEST_GAP, spacing * random.randint(2, 5)) if is_missing else spacing
        souths.append(round(souths[-1] + gap, 2))
    shape = random.choice(["slanted", "triangular", "long", "ragged"])
    outline = _outline(random, shape)
    ends = [outline(south) for south in souths]
    west = min(start for start, _ in ends)
    rows = []
    for south, (start, end) in zip(souths, ends, strict=True):
        rows.append(Row(south, round(start - west, 2), round(end - start, 2)))
    crew: dict[str, Any] = {
        "pickers": random.randint(2, 4),
        "carriers": random.randint(2, 6),
        "route": random.choice(["one-way", "two-way"]),
        "rows_to_pickers": random.choice(["balanced", "balanced-ends", "manual"]),
        "dispatch": random.choice(["nearest", "predictive"]),
        # A long row that fills many bins takes hours.
        "metres_per_bin": None if shape == "long" else random.choice([None, 55.0, 100.0]),
    }
    return orchard_of(rows, **crew)


def _outline(random: Random, shape: str) -> Outline:
    """Return where rows begin and end, by how far south they lie.

    `slope`: by how many metres a row begins further east for each metre that it lies further south.
    """
    length = random.choice([40.0, 70.0])
    slope = random.choice([-1.0, -0.5, 0.3, 1.0])
    if shape == "slanted":
        return lambda south: (slope * south, slope * south + length)
    if shape == "triangular":
        return lambda south: (0.0, length + 120.0 - abs(slope) * south)
    if shape == "long":
        return lambda south: (0.0, random.choice([250.0, 400.0]))
    return lambda south: (random.uniform(0.0, 60.0), random.uniform(80.0, 140.0))


def apart(seed: int) -> float:
    """Harvest a block in both models. Return by which share the lengths differ."""
    scenario = drawn_block(Random(seed))
    expected = DiscreteHarvest(lay_out(scenario)).run()
    assert expected.is_over
    run = Local(scenario, is_hashed=False)
    while not run.ended and run.engine.tick < LONGEST:
        run.tick()
    world = run.engine.world
    assert run.ended == "harvested"
    assert run.jam == []
    assert not world.collisions.any()
    return abs(expected.seconds / world.seconds - 1.0)


@pytest.mark.parametrize("seed", range(FEW))
def test_a_block_takes_as_long_in_both_models(seed: int) -> None:
    assert apart(seed) < 0.01


@pytest.mark.soak
def test_soak_blocks_take_as_long_in_both_models() -> None:
    shares = [apart(seed) for seed in range(FEW, MANY)]
    print(f"{100 * fmean(shares):.2f} % on average, {100 * max(shares):.2f} % at most")
    assert fmean(shares) < 0.005
    assert sum(share < 0.01 for share in shares) > 0.95 * len(shares)
