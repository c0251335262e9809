"""Harvests never jam: how places are granted, and how robots meet that need them.

A place is a part of the roads, such as "D/2", which one robot has at a time, or a picker and its
carrier together (partners). A robot sends a claim to the traffic desk: the places that it keeps and
those that it wants. docs/traffic.md has the proof; here are the rules of the desk, and harvests.
"""

import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from stage import Driven, Stage, Standing, empty_orchard

from orchard.behaviour.traffic import ReservationTable, grant, note
from orchard.contract.messages import Claim
from orchard.field.geometry import Twist
from orchard.field.layout import lay_out
from orchard.field.queue import MOST_CARRIERS, ONE_WAY, TWO_WAY, queue_of
from orchard.field.rows import Block
from orchard.field.scenario import (
    DISPATCH_POLICIES,
    NEAREST,
    ROW_RULES,
    Animals,
    LaserSettings,
    People,
    Scenario,
)
from orchard.plans.routes import route_of
from orchard.plans.steps import DriveTo, Need
from orchard.report.bounds import Bounds

FARTHEST = "examples.seams.farthest_first.FarthestFirst"
# Places on the roads. A claim: a robot, the numbers of places that it keeps, places that it wants.
PLACES = st.lists(st.sampled_from(["D/1", "D/2", "F/1", "F/2"]), max_size=3, unique=True)
CLAIMS = st.lists(
    st.tuples(st.sampled_from(["a", "b", "c", "d"]), st.sets(st.integers(0, 3)), PLACES),
    max_size=40,
)


@given(CLAIMS)
def test_no_place_is_ever_reserved_for_two_that_are_not_partners(claims):
    table = ReservationTable()
    for tick, (name, kept, want) in enumerate(claims):
        reserved = table.reserved.get(name, [])
        keep = [place for number, place in enumerate(reserved) if number in kept]
        note(table, name, Claim(keep=keep, want=want, beside=""), tick)
        grant(table)
        all_reserved = [place for places in table.reserved.values() for place in places]
        assert len(all_reserved) == len(set(all_reserved))


def test_places_are_given_all_together_or_not_at_all():
    table = ReservationTable()
    note(table, "a", Claim([], ["D/1"], ""), 0)
    grant(table)
    note(table, "b", Claim([], ["F/1", "D/1"], ""), 1)
    grant(table)
    assert table.reserved == {"a": ["D/1"], "b": []}


def test_the_first_to_ask_is_served_first_and_ties_go_by_name():
    """Four robots want one place. Each in turn gives it back."""
    table = ReservationTable()
    for name, tick in (("a", 0), ("c", 1), ("b", 1), ("d", 2)):
        note(table, name, Claim([], ["D/1"], ""), tick)
        grant(table)
    served = ["a"]
    while table.wishes:
        note(table, served[-1], Claim([], [], ""), 3)
        grant(table)
        served += [name for name, places in table.reserved.items() if places]
    assert served == ["a", "b", "c", "d"]


def test_a_partner_joins_at_once_although_others_stand_in_line():
    table = ReservationTable()
    note(table, "carrier", Claim([], ["D/1"], ""), 0)
    grant(table)
    note(table, "other", Claim([], ["D/1"], ""), 1)
    note(table, "picker", Claim([], ["D/1"], "carrier"), 2)
    grant(table)
    assert table.reserved == {"carrier": ["D/1"], "other": [], "picker": ["D/1"]}


# Rows, pickers, carriers (None: as many as suit), width of rows in m, and other values.
ORCHARDS = [
    (3, 2, None, 5.0, {}),
    (5, 2, None, 5.0, {"row_length": 30.0}),
    (5, 5, None, 5.0, {"row_length": 30.0}),
    (4, 4, 1, 6.3, {"row_length": 30.0}),
    (4, 3, 3, 5.0, {"row_length": 20.0}),
    (5, 3, 4, 5.0, {"row_length": 45.5, "bay": 12.5}),
    (4, 3, 3, 5.0, {"row_length": 20.0, "route": TWO_WAY}),
    (5, 5, 10, 5.0, {"row_length": 30.0, "route": TWO_WAY}),
    (6, 4, 6, 6.3, {"row_length": 40.0, "bay": 5.0, "route": TWO_WAY, "dispatch": FARTHEST}),
    (5, 5, 8, 3.15, {"row_length": 30.0, "route": TWO_WAY}),
    (4, 2, 4, 3.15, {"row_length": 30.0}),
    # Carriers leave all ten lines of the queue, and come back to them.
    pytest.param(12, 12, 120, 5.0, {}, marks=pytest.mark.soak),
    pytest.param(12, 12, 120, 5.0, {"route": TWO_WAY}, marks=pytest.mark.soak),
    pytest.param(6, 2, 14, 12.0, {}, marks=pytest.mark.soak),
    pytest.param(
        6, 2, 40, 12.0, {"row_length": 200.0, "bay": 60.0, "route": TWO_WAY}, marks=pytest.mark.soak
    ),
]


@pytest.mark.parametrize(("rows", "pickers", "carriers", "row_width", "more"), ORCHARDS)
def test_a_harvest_ends_without_a_collision(rows, pickers, carriers, row_width, more):
    """The tractor on its driveway is not in the way of carriers that unload."""
    stage = Stage(
        empty_orchard(
            rows=rows, pickers=pickers, carriers=carriers, row_width=row_width, tractor=True, **more
        )
    )
    stage.run_to_the_end()
    assert stage.world.delivered == rows
    stage.assert_no_collisions()
    assert stage.world.refused.sum() == 0


@pytest.mark.parametrize(
    "pickers", [8, *(pytest.param(many, marks=pytest.mark.soak) for many in (12, 20))]
)
def test_all_pickers_call_at_once_and_all_are_served(pickers):
    """Each has one row. Each unloading is an event of its own."""
    stage = Stage(empty_orchard(rows=pickers, pickers=pickers, dispatch=NEAREST))
    # All rows, of 70 m at 1 m/s, are picked at the same time.
    stage.run_until(lambda: bool((stage.world.row_picked >= 70.0).all()), 75)
    stage.run_to_the_end()
    assert stage.world.delivered == pickers
    unloaded = stage.happened("unloaded")
    assert len(unloaded) == pickers
    assert len({(event.tick, event.who) for event in unloaded}) == pickers
    stage.assert_no_collisions()


# Rows, pickers, seed, route, and length of rows in m.
WITH_GUESTS = [
    (3, 2, 1, ONE_WAY, 70.0),
    (5, 5, 1, ONE_WAY, 30.0),
    (5, 2, 1, ONE_WAY, 30.0),
    (6, 4, 1, TWO_WAY, 30.0),
    pytest.param(8, 3, 1, ONE_WAY, 70.0, marks=pytest.mark.soak),
    pytest.param(5, 2, 1, TWO_WAY, 70.0, marks=pytest.mark.soak),
    pytest.param(5, 2, 3, ONE_WAY, 70.0, marks=pytest.mark.soak),
    pytest.param(5, 2, 3, TWO_WAY, 70.0, marks=pytest.mark.soak),
    pytest.param(12, 6, 1, ONE_WAY, 70.0, marks=pytest.mark.soak),
    pytest.param(12, 6, 1, TWO_WAY, 70.0, marks=pytest.mark.soak),
    pytest.param(20, 10, 1, ONE_WAY, 70.0, marks=pytest.mark.soak),
    pytest.param(20, 10, 1, TWO_WAY, 70.0, marks=pytest.mark.soak),
    pytest.param(20, 20, 1, ONE_WAY, 70.0, marks=pytest.mark.soak),
    pytest.param(20, 20, 1, TWO_WAY, 70.0, marks=pytest.mark.soak),
]


@pytest.mark.parametrize(("rows", "pickers", "seed", "route", "row_length"), WITH_GUESTS)
def test_a_harvest_among_people_ends_without_a_collision(rows, pickers, seed, route, row_length):
    stage = Stage(
        Scenario(rows=rows, pickers=pickers, seed=seed, route=route, row_length=row_length)
    )
    stage.run_to_the_end()
    assert stage.world.delivered == rows
    stage.assert_no_collisions()


# The seed of the scenarios that the soak draws; any number would do.
RANDOM_SEED = 20260


@pytest.mark.soak
@pytest.mark.parametrize("size", ["any", "large"])
@pytest.mark.parametrize("number", range(200))
def test_soak_a_random_legal_scenario_delivers_all_bins(number, size):
    scenario = random_scenario(number) if size == "any" else large_scenario(number)
    print(f"scenario {number} of seed {RANDOM_SEED}: {scenario}")
    stage = Stage(scenario)
    # Three times what picking alone takes, and 20 minutes for the carriers of each row.
    metres = scenario.row_length * scenario.rows / scenario.pickers
    picking_seconds = metres / scenario.mean_picking_speed
    stage.run_to_the_end(seconds=3 * picking_seconds + 1200 * scenario.rows)
    assert stage.world.delivered == scenario.rows
    stage.assert_no_collisions()


def random_scenario(number: int) -> Scenario:
    """Return a random valid scenario.

    Its picking speed is high enough that a run does not take hours.
    """
    chance = random.Random(f"{RANDOM_SEED}/{number}")
    rows = chance.randint(3, 20)
    route = chance.choice([ONE_WAY, TWO_WAY])
    length = chance.choice([70.0, round(chance.uniform(20.0, 200.0), 1)])
    bay = chance.choice([0.0, round(chance.uniform(0.0, 60.0), 1)])
    possible = [carriers for carriers in range(1, 41) if queue_of(route, length, bay, carriers)]
    if not possible:
        # There is no room for a queue. Another one is drawn, of a number that no test has.
        return random_scenario(number + 1000)
    return Scenario(
        rows=rows,
        pickers=chance.randint(2, rows),
        row_width=round(chance.choice([chance.uniform(3.15, 5.0), chance.uniform(5.0, 12.0)]), 2),
        carriers=chance.choice(possible),
        row_length=length,
        bay=bay,
        route=route,
        dispatch=chance.choice([*DISPATCH_POLICIES, FARTHEST]),
        rows_to_pickers=chance.choice(ROW_RULES),
        picking_speed=round(chance.uniform(0.2, 1.0), 3),
        seed=chance.randint(0, 10**6),
        people=People(workers=chance.randint(0, 25), visitors=chance.randint(0, 25)),
        animals=Animals(dogs=chance.randint(0, 10), cats=chance.randint(0, 10)),
        weeds=chance.randint(0, 50),
        tractor=chance.random() < 0.8,
        laser=LaserSettings(noise=chance.choice([0.0, 0.0, 0.01, 0.02])),
    )


def large_scenario(number: int) -> Scenario:
    """Return a random scenario beyond the manual's sizes.

    Pickers are fast, so that a run takes minutes at most.
    """
    chance = random.Random(f"{RANDOM_SEED}/large/{number}")
    rows = chance.randint(21, chance.choice([30, 45, 100]))
    route = chance.choice([ONE_WAY, TWO_WAY])
    length = chance.randint(30, 110)
    most = 0
    for carriers in range(1, MOST_CARRIERS + 1):
        if queue_of(route, length, bay=0.0, carriers=carriers):
            most = carriers
    return Scenario(
        rows=rows,
        pickers=chance.randint(10, min(rows, 60)),
        row_width=chance.choice([5.0, 3.15, round(chance.uniform(3.15, 12.0), 2)]),
        carriers=min(chance.randint(rows // 4, MOST_CARRIERS), most),
        row_length=length,
        route=route,
        dispatch=chance.choice(DISPATCH_POLICIES),
        rows_to_pickers=chance.choice(ROW_RULES),
        picking_speed=chance.choice([0.5, 1.0]),
        seed=chance.randint(0, 10**6),
        people=People(workers=chance.randint(0, 25), visitors=chance.randint(0, 25)),
        tractor=chance.random() < 0.8,
    )


def test_a_full_queue_closes_up_and_serves_from_its_head():
    """Thirty carriers stand in ten lines of three. Three of them fetch the three bins."""
    stage = Stage(empty_orchard(rows=3, pickers=3, carriers=30, row_length=30.0, dispatch=NEAREST))
    stage.run_until(lambda: len(stage.happened("row picked")) == 3, 80)
    stage.run_to_the_end()
    uncoupled = stage.happened("uncoupled")
    sent = {event.who for event in uncoupled if event.who.startswith("carrier")}
    assert len(sent) == 3

    # Each of the ten lines has closed up to its head.
    head_x = stage.world.layout.row_east + 0.9
    carriers = [name for name in stage.world.layout.names if name.startswith("carrier")]
    at_heads = [name for name in carriers if abs(stage.pose(name)[0] - head_x) < 1e-6]
    assert len(at_heads) == 10


def test_a_person_standing_in_a_row_holds_up_only_that_row():
    stage = Stage(
        empty_orchard(rows=4, pickers=2, people=People(workers=1, visitors=0)), worker_01=Standing()
    )
    stage.put("worker_01", 10.0, stage.world.layout.lane(1).y, "NORTH")
    stage.run_until(lambda: bool((stage.world.row_picked[2:] >= 70.0).all()), 800)
    # The person covers x from 9.5 m on. The picker goes in steps of 0.1 m from x = -35.5 m on, and
    # stops when its front, 1.25 m ahead of its middle, is within 0.8 m of the person: its middle is
    # then at 7.5 m, or a step before.
    assert 42.9 < stage.world.row_picked[0] <= 43.0 + 1e-6
    stage.local.agents["worker_01"] = Driven(Twist(x=1.0))
    stage.run_until(lambda: stage.world.row_picked[0] == 70.0, 60)


def test_a_crossing_animal_is_not_run_over():
    """A dog walks east in row 1, at y = 10.9 m, from x = 20 m on, and then across the roads."""
    stage = Stage(empty_orchard(animals=Animals(dogs=1, cats=0)), dog_01=Driven(Twist(x=0.6)))
    stage.put("dog_01", 20.0, 10.9, "EAST")
    stage.run_until(lambda: stage.world.delivered == 1, 600)
    stage.assert_no_collisions()


# Route -> road -> metres before and past the middle of a lane, in the direction of the drive, in
# which other robots turn, cross and deliver: a carrier there must have the lane's place.
NEEDED_BY_OTHERS = {
    ONE_WAY: {"D": (2.6, 3.0), "F": (2.6, 3.0)},
    TWO_WAY: {"D": (2.6, 1.2), "F": (2.9, 1.2)},
}


def lanes_touched(stage: Stage, carrier: str) -> list[tuple[str, str, int]]:
    """Return where a carrier or its bin is on the roads now: (side, road, lane) of each place.

    Only while it drives along a road; on no road the list is empty.
    """
    layout = stage.world.layout
    x, y, heading = stage.pose(carrier)
    route = route_of(layout)
    if y > layout.tree_lines[0]:
        return []
    # m ahead of its centre: its own ends, or the end of the bin, which is 1.9 m behind.
    front = 0.9
    tail = -2.4 if stage.bin_of(carrier) else -0.9
    touched = []
    for side in route.sides.values():
        for road, road_x in (("D", route.D_ROAD), ("F", route.F_ROAD)):
            # +1: carriers drive north there; -1: south.
            direction = side.south if road == "F" and route.QUEUE == TWO_WAY else -side.south
            is_on_road = abs(x - side.x(road_x)) <= 0.01
            drives_along = abs(heading - direction * np.pi / 2) <= 0.1
            if not is_on_road or not drives_along:
                continue
            before, past = NEEDED_BY_OTHERS[layout.scenario.route][road]
            for lane in layout.lanes:
                metres_past = direction * (y - lane.y)
                if metres_past + front > -before and metres_past + tail < past:
                    touched.append((side.name, road, lane.number))
    return touched


@pytest.mark.parametrize(
    ("rows", "pickers", "row_width", "route"),
    [(5, 3, 5.0, ONE_WAY), (4, 2, 9.0, ONE_WAY), (5, 3, 5.0, TWO_WAY)],
)
def test_a_carrier_on_a_road_has_every_place_it_is_in(rows, pickers, row_width, route):
    """It is looked at in each tick of a harvest. A place is named SIDE/ROAD/LANE."""
    stage = Stage(
        empty_orchard(rows=rows, pickers=pickers, row_width=row_width, carriers=4, route=route)
    )
    carriers = [f"carrier_{i + 1:02d}" for i in range(4)]
    while not stage.local.engine.over:
        stage.tick()
        for carrier in carriers:
            reserved = stage.local.memories[carrier].reserved
            for side, road, lane in lanes_touched(stage, carrier):
                place = f"{side}/{road}/{lane}"
                assert place in reserved, (
                    f"{carrier} at {stage.pose(carrier)} is in {place} and holds {reserved}"
                )


@pytest.mark.parametrize(("width", "route"), [(5.0, TWO_WAY), (3.15, TWO_WAY), (3.15, ONE_WAY)])
def test_robots_ask_for_one_place_after_the_other(width, route):
    """A place that a robot only waits for keeps no robot from another place.

    The proof in docs/traffic.md rests on it, for two-way roads and for close rows.
    """
    layout = lay_out(empty_orchard(rows=6, pickers=3, carriers=40, row_width=width, route=route))
    route = route_of(layout)
    claims = []
    for pass_ in layout.passes(Block(tuple(range(1, 6)))):
        side = route.sides[pass_.end]
        # One carrier of each of four lines.
        for carrier in (1, 11, 21, 31):
            claims += places_asked(route.fetch(carrier, pass_.row, side, "picker_01", "bin_01"))
    claims += places_asked(route.harvest(Block(tuple(range(1, 7)))))
    assert len(claims) > 200, "or the assertion below says nothing"
    # Both places of the south-west corner are beyond all lanes.
    corner = ["corner/south-west", "turn/south-west"]
    assert all(len(places) == 1 or places == corner for places in claims)


def places_asked(steps):
    """Return the places of each claim that steps make."""
    claims = []
    for step in steps:
        if isinstance(step, Need):
            claims.append(step.places)
        elif isinstance(step, DriveTo):
            claims += [gate.places for gate in step.needs]
    return claims


def test_the_mean_round_of_two_way_is_at_least_a_third_shorter():
    """A round is the way of a carrier from the queue to a bin, the bay, and back."""
    seconds = {}
    for route in (ONE_WAY, TWO_WAY):
        layout = lay_out(empty_orchard(rows=20, pickers=10, carriers=10, route=route))
        seconds[route] = Bounds(layout).cycle_seconds
    assert seconds[TWO_WAY] <= 0.65 * seconds[ONE_WAY]
