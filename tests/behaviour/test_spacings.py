"""Harvests of the simulator in rows of any spacing: no robots collide, and none jam."""

from random import Random

import pytest
from stage import Stage

from orchard.field.queue import queue_of
from orchard.field.scenario import DISPATCH_POLICIES, ROW_RULES, Animals, People, Scenario
from orchard.field.survey import row_width_of

ROUTES = ("one-way", "two-way")
HARVESTS = 500
# One harvest in so many is dense with people and animals.
DENSE = 5
# Spacings from lane to lane, in units of STEP: 3.65 to 12.5 m.
STEPS = range(73, 251)
STEP = 0.05  # m


def spaced(number: int) -> Scenario:
    """Return a random scenario at a random spacing, with many carriers for its rows, or few."""
    chance = Random(f"spacings/{number}")
    route = ROUTES[number % 2]
    length = float(chance.randint(20, 60))
    # Numbers of carriers for which the route has a queue.
    possible = []
    for carriers in range(1, 41):
        if queue_of(route, length, bay=0.0, carriers=carriers):
            possible.append(carriers)
    rows = chance.randint(3, 9)
    people = People(workers=0, visitors=0)
    animals = Animals(dogs=0, cats=0)
    if number % DENSE == 0:
        people = People(workers=chance.randint(8, 25), visitors=chance.randint(8, 25))
        animals = Animals(dogs=chance.randint(0, 8), cats=chance.randint(0, 8))
    return Scenario(
        rows=rows,
        pickers=chance.randint(2, rows),
        row_width=row_width_of(chance.choice(STEPS) * STEP),
        carriers=chance.choice(possible),
        row_length=length,
        route=route,
        dispatch=chance.choice(DISPATCH_POLICIES),
        rows_to_pickers=chance.choice(ROW_RULES),
        picking_speed=chance.choice([0.3, 0.6, 1.0]),
        seed=chance.randint(0, 10**6),
        people=people,
        animals=animals,
        tractor=chance.random() < 0.8,
    )


def harvest_to_the_end(number: int) -> None:
    """Harvest one of the drawn scenarios without a collision."""
    scenario = spaced(number)
    print(f"harvest {number}: {scenario}")
    stage = Stage(scenario)
    # Three times what picking alone takes, and 20 minutes for the carriers of each row.
    metres = scenario.row_length * scenario.rows / scenario.pickers
    picking_seconds = metres / scenario.mean_picking_speed
    stage.run_to_the_end(seconds=3 * picking_seconds + 1200 * scenario.rows)
    assert stage.world.delivered == scenario.rows
    stage.assert_no_collisions()


@pytest.mark.parametrize("number", [1, 2])
def test_a_harvest_at_any_spacing_ends(number: int) -> None:
    harvest_to_the_end(number)


@pytest.mark.soak
@pytest.mark.parametrize("number", range(HARVESTS))
def test_soak_a_harvest_at_any_spacing_ends(number: int) -> None:
    """One in five of these orchards is dense with people."""
    harvest_to_the_end(number)
