"""Nothing jams: the ledger of places, and the meetings for which it is there."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from stage import Driven, Stage, Standing, empty_orchard

from orchard.agents.traffic import Ledger, grant, note
from orchard.config import Animals, People, Scenario
from orchard.geometry import Twist
from orchard.messages import Claim

PLACES = st.lists(st.sampled_from(["D/1", "D/2", "F/1", "F/2"]), max_size=3, unique=True)
CLAIMS = st.lists(st.tuples(st.sampled_from(["a", "b", "c", "d"]), st.sets(st.integers(0, 3)), PLACES), max_size=40)


@given(CLAIMS)
def test_no_place_is_ever_held_by_two_that_are_not_partners(claims):
    ledger = Ledger()
    for tick, (name, kept, want) in enumerate(claims):
        held = ledger.holds.get(name, [])
        note(ledger, name, Claim(keep=[p for i, p in enumerate(held) if i in kept], want=want, beside=""), tick)
        grant(ledger)
        everything = [place for places in ledger.holds.values() for place in places]
        assert len(everything) == len(set(everything))


def test_places_are_given_all_together_or_not_at_all():
    ledger = Ledger()
    note(ledger, "a", Claim([], ["D/1"], ""), 0)
    grant(ledger)
    note(ledger, "b", Claim([], ["F/1", "D/1"], ""), 1)
    grant(ledger)
    assert ledger.holds == {"a": ["D/1"], "b": []}


def test_who_asked_first_is_served_first_and_ties_go_by_name():
    ledger = Ledger()
    for name, tick in (("a", 0), ("c", 1), ("b", 1), ("d", 2)):
        note(ledger, name, Claim([], ["D/1"], ""), tick)
        grant(ledger)
    served = ["a"]
    while ledger.wishes:
        note(ledger, served[-1], Claim([], [], ""), 3)
        grant(ledger)
        served += [name for name, places in ledger.holds.items() if places]
    assert served == ["a", "b", "c", "d"]


def test_a_partner_joins_at_once_although_others_stand_in_line():
    ledger = Ledger()
    note(ledger, "carrier", Claim([], ["D/1"], ""), 0)
    grant(ledger)
    note(ledger, "other", Claim([], ["D/1"], ""), 1)
    note(ledger, "picker", Claim([], ["D/1"], "carrier"), 2)
    grant(ledger)
    assert ledger.holds == {"carrier": ["D/1"], "other": [], "picker": ["D/1"]}


# -- whole harvests, with nobody about and with everybody


@pytest.mark.parametrize(
    ("rows", "pickers", "carriers", "row_width"),
    [(3, 2, None, 5.0), (5, 2, None, 5.0), (5, 5, None, 5.0), (6, 2, 14, 12.0), (4, 4, 1, 6.3)],
)
def test_a_harvest_ends_without_a_collision(rows, pickers, carriers, row_width):
    stage = Stage(empty_orchard(rows=rows, pickers=pickers, carriers=carriers, row_width=row_width, tractor=True))
    stage.run_to_the_end()
    assert stage.world.delivered == rows
    stage.assert_no_collisions()
    assert stage.world.held.sum() == 0


def test_all_of_twenty_pickers_call_at_once_and_all_are_served():
    stage = Stage(empty_orchard(rows=20, pickers=20))
    stage.run_until(lambda: bool((stage.world.row_picked >= 70.0).all()), 75)
    stage.run_to_the_end()
    assert stage.world.delivered == 20
    assert len(stage.happened("unloaded")) == len({(event.tick, event.who) for event in stage.happened("unloaded")}) == 20
    stage.assert_no_collisions()


@pytest.mark.parametrize("seed", [1, 2])
def test_a_harvest_among_people_and_animals_ends(seed):
    stage = Stage(Scenario(rows=5, pickers=3, seed=seed))
    stage.run_to_the_end()
    assert stage.world.delivered == 5
    robots = [e for e in stage.happened("collision") if e.who.startswith(("picker", "carrier", "bin"))]
    assert len(robots) <= 2, "only what comes from where no laser looks"


# -- meetings


def test_a_full_queue_closes_up_and_serves_from_its_head():
    stage = Stage(empty_orchard(rows=3, pickers=3, carriers=40))
    stage.run_until(lambda: len(stage.happened("row picked")) == 3, 80)
    stage.run_to_the_end()
    left = {event.who for event in stage.happened("uncoupled") if event.who.startswith("carrier")}
    assert len(left) == 3
    heads = [name for name in stage.world.layout.names if name.startswith("carrier") and abs(stage.pose(name)[0] - 35.4) < 1e-6]
    assert len(heads) == 4, "every line has closed up to its head"


def test_a_person_standing_in_a_row_holds_up_only_that_row():
    stage = Stage(empty_orchard(rows=4, pickers=2, people=People(workers=1, visitors=0)), worker_01=Standing())
    stage.put("worker_01", 10.0, stage.world.layout.lane(1).y, "NORTH")
    stage.run_until(lambda: bool((stage.world.row_picked[2:] >= 70.0).all()), 800)
    assert 42.9 < stage.world.row_picked[0] <= 43.0 + 1e-6, "0.8 m before the person, less at most one step"
    stage.local.agents["worker_01"] = Driven(Twist(x=1.0))
    stage.run_until(lambda: stage.world.row_picked[0] == 70.0, 60)


def test_an_animal_that_crosses_in_front_of_a_carrier_is_not_run_over():
    stage = Stage(empty_orchard(animals=Animals(dogs=1, cats=0)), dog_01=Driven(Twist(x=0.6)))
    stage.put("dog_01", 20.0, 10.9, "EAST")
    stage.run_until(lambda: stage.world.delivered == 1, 600)
    stage.assert_no_collisions()


def test_the_tractor_on_its_driveway_is_not_in_the_way_of_unloading():
    stage = Stage(empty_orchard(rows=5, pickers=5, tractor=True))
    stage.run_to_the_end()
    stage.assert_no_collisions()


def test_two_carriers_that_meet_at_neighbouring_lanes_both_get_through():
    stage = Stage(empty_orchard(rows=3, pickers=3, carriers=2))
    stage.run_until(lambda: len([e for e in stage.happened("uncoupled") if e.who.startswith("carrier")]) == 2, 200)
    both_at_work = [stage.pose(name)[1] for name in ("carrier_01", "carrier_02")]
    assert abs(both_at_work[0] - both_at_work[1]) < 15, "they are at neighbouring lanes at the same time"
    stage.run_until(lambda: stage.world.delivered == 2, 400)
    stage.assert_no_collisions()
