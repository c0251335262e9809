"""Several places at the bay: so many carriers unload at a time, in both models alike."""

from collections.abc import Iterator
from random import Random
from typing import Any

import pytest
from quiet import NOBODY, laid_out

from orchard.behaviour.catalogue import check_plugins
from orchard.event_model.begun.begin import begin_at
from orchard.event_model.begun.moment import RunMoment
from orchard.event_model.harvest import EventHarvest
from orchard.field.kinds import HAULERS, kind_of
from orchard.field.layout import Layout, lay_out
from orchard.field.problems import ScenarioError
from orchard.field.scenario import TICKS_PER_SECOND, Scenario
from orchard.local import Local
from orchard.report.bounds import Bounds, proven_seconds
from orchard.sim.world import World

# Ticks by which each delivery may differ between the models: half a second.
NEAR = 5
# Six pickers and eight carriers for two places, each of which takes a minute for a bin.
BUSY: dict[str, Any] = NOBODY | {
    "rows": 6,
    "pickers": 6,
    "carriers": 8,
    "row_length": 24.0,
    "picking_speed": 1.0,
    "dispatch": "predictive",
    "bays": 2,
    "handling": {"unloading": 60.0},
}
BATTERY = {"hours": 0.3, "standing": 0.3, "hours_to_charge": 0.1, "reserve": 0.5}
# What differs from BUSY.
CASES: dict[str, dict[str, Any]] = {
    "two places": {},
    "three places, one-way": {
        "bays": 3,
        "route": "one-way",
        "handling": {"unloading": 120.0},
    },
    "fast carriers": {"bays": 3, "carrying": {"speed": 2.5}},
    "trailers of one bin": {
        "load_out": {"seconds_away": 100.0, "trailers": {"count": 2, "bins": 1}},
    },
    "few empty bins for trailers": {
        "bays": 3,
        "load_out": {"seconds_away": 90.0, "trailers": {"count": 2, "bins": 2}, "empty_bins": 3},
    },
    "a truck": {
        "bays": 3,
        "handling": {"unloading": 20.0},
        "load_out": {"empty_bins": 3, "truck": {"every": 90.0, "bins": 2}},
    },
    "batteries": {
        "carriers": 6,
        "row_length": 30.0,
        "carrying": {"battery": BATTERY},
        "chargers": 2,
    },
}


def busy(**values: Any) -> Layout:
    """Return a scenario with more than one place at the bay, and carriers that need them."""
    return lay_out(Scenario.model_validate(BUSY | values))


def assert_good(run: Local) -> None:
    """Check that a run is a whole harvest, and that no robot collided in it."""
    assert run.ended == "harvested", run.jam
    layout = run.engine.layout
    collided = zip(layout.names, run.engine.world.collisions.tolist(), strict=True)
    assert not [name for name, count in collided if count and kind_of(name) in HAULERS]


def delivered(run: Local) -> list[int]:
    """Return the ticks of all deliveries of a run, which is done in the simulator."""
    ticks: list[int] = []
    while not run.ended:
        before = run.engine.world.delivered
        run.tick()
        ticks += [run.engine.tick] * (run.engine.world.delivered - before)
    assert_good(run)
    return ticks


def deliveries(harvest: EventHarvest) -> list[int]:
    """Return what a harvest of the event model tells of its deliveries."""
    return [round(TICKS_PER_SECOND * seconds) for seconds in harvest.run().deliveries]


def moment_of(run: Local) -> RunMoment:
    """Return a moment of a run, from which the event model goes on."""
    return RunMoment(run.engine.world, run.memories, run.post.written)


def unloading(world: World) -> int:
    """Return how many bins are unloaded in a tick."""
    return int((world.bay_ticks > 0).sum())


@pytest.mark.parametrize("name", CASES)
def test_both_models_deliver_in_the_same_ticks(name: str) -> None:
    """The ticks are equal, or nearly so, and no harvest beats its limit or its proof."""
    layout = busy(**CASES[name])
    run = Local(layout.scenario, is_hashed=False)
    ticks = delivered(run)
    assert deliveries(EventHarvest(layout)) == pytest.approx(ticks, abs=NEAR)
    proven = proven_seconds(layout)
    assert proven is not None
    assert proven <= run.engine.world.seconds
    # With a truck or batteries the limit is one of the long run; a short harvest may begin with
    # empty bins and full batteries, and beat it.
    if not layout.scenario.load_out.has_truck and "battery" not in CASES[name].get("carrying", {}):
        rate = len(ticks) / run.engine.world.seconds
        assert rate <= Bounds(layout).bins_per_hour / 3600.0


@pytest.mark.parametrize("bays", [1, 2, 3])
def test_as_many_bins_are_unloaded_at_a_time(bays: int) -> None:
    run = Local(busy(bays=bays).scenario, is_hashed=False)
    most = 0
    while not run.ended:
        run.tick()
        most = max(most, unloading(run.engine.world))
    assert most == bays
    assert_good(run)


def test_a_carrier_stays_until_its_bin_is_empty() -> None:
    """The carrier ahead leaves first. The one behind does not move up, and the time so far counts.

    `bay_ticks`: for how many ticks each bin has been unloaded; 0 if it is not in the bay, or empty.
    """
    run = Local(busy().scenario, is_hashed=False)
    world = run.engine.world
    needed = run.engine.layout.machines["carrier"].unloading_ticks
    has_stayed_behind = False
    while not run.ended:
        ticks_before = world.bay_ticks.copy()
        delivered_before = world.delivered
        run.tick()
        begun = (ticks_before > 0).nonzero()[0]
        for bin_ in begun.tolist():
            expected = ticks_before[bin_] + 1
            if expected == needed:
                expected = 0
            assert world.bay_ticks[bin_] == expected
        is_other_still_there = unloading(world) > 0
        has_stayed_behind |= world.delivered > delivered_before and is_other_still_there
    assert has_stayed_behind, "or the harvest says nothing"


def test_the_bay_begins_no_bin_for_which_a_trailer_lacks_room() -> None:
    run = Local(busy(**CASES["trailers of one bin"]).scenario, is_hashed=False)
    world = run.engine.world
    while not run.ended:
        run.tick()
        # Column 1 of a trailer is the tick at which it is back. Each has room for one bin.
        there = int((world.trailers[:, 1] <= world.tick).sum())
        assert unloading(world) <= there
    assert_good(run)


def test_more_places_make_a_busy_harvest_shorter() -> None:
    seconds = [EventHarvest(busy(bays=bays)).run().seconds for bays in (1, 2, 3)]
    assert seconds[1] < 0.8 * seconds[0]
    assert seconds[2] < seconds[1]


@pytest.mark.parametrize("name", ["two places", "few empty bins for trailers"])
def test_a_harvest_goes_on_from_a_moment_at_the_bay(name: str) -> None:
    """At each of five moments two carriers or more unload."""
    run = Local(busy(**CASES[name]).scenario, is_hashed=False)
    world = run.engine.world
    begun = []
    ticks: list[int] = []
    while len(begun) < 5:
        before = world.delivered
        run.tick()
        ticks += [run.engine.tick] * (world.delivered - before)
        # Every 7 s, so that the moments differ.
        if unloading(world) > 1 and run.engine.tick % 70 == 0:
            begun.append(begin_at(moment_of(run)))
    ticks += delivered(run)
    for harvest in begun:
        later = deliveries(harvest)
        assert later == pytest.approx(ticks[-len(later) :], abs=NEAR)


# -- no collision, no jam


def crowded(seed: int, count: int) -> Iterator[Layout]:
    """Yield orchards with many carriers for their places at the bay, some with people about."""
    chances = Random(f"bays {seed}")

    def drawn() -> dict[str, Any]:
        """Draw the values of one. In seven of ten nobody and nothing is about."""
        rows = chances.randint(5, 12)
        values: dict[str, Any] = {
            "rows": rows,
            "row_length": float(chances.choice([20, 30])),
            "row_width": chances.choice([5.0, 4.1, 3.2]),
            "pickers": chances.randint(3, min(10, rows)),
            "carriers": chances.randint(8, 30),
            "picking_speed": 1.0,
            "bays": chances.randint(2, 3),
            "bay": chances.choice([0.0, 5.0]),
            "route": chances.choice(["one-way", "two-way"]),
            "dispatch": chances.choice(["nearest", "predictive", "assignment"]),
            "carrying": {"speed": chances.choice([1.0, 2.5])},
            "handling": {"unloading": float(chances.choice([5, 30, 60]))},
            "seed": chances.randint(1, 1000),
        }
        is_quiet = chances.random() < 0.7
        return values | NOBODY if is_quiet else values

    return laid_out(drawn, count)


def assert_all_good(seed: int, count: int) -> None:
    """Harvest some crowded orchards in the simulator."""
    for layout in crowded(seed, count):
        delivered(Local(layout.scenario, is_hashed=False))


def test_no_robot_collides_or_jams_at_a_crowded_bay() -> None:
    assert_all_good(seed=1, count=3)


@pytest.mark.soak
def test_soak_no_robot_collides_or_jams_at_forty_crowded_bays() -> None:
    assert_all_good(seed=2, count=40)


# -- what is refused


@pytest.mark.parametrize("bays", [0, 4])
def test_a_bay_has_one_to_three_places(bays: int) -> None:
    with pytest.raises(ValueError, match="bays"):
        busy(bays=bays)


def test_a_run_keeps_its_places() -> None:
    run = Local(busy().scenario)
    run.tick()
    with pytest.raises(ScenarioError, match="bays"):
        run.fork(bays=3)


def test_a_route_that_knows_one_place_is_refused() -> None:
    """With such a route the further places would have no effect."""
    layout = busy(route="own_routes.OnePlace")
    with pytest.raises(ScenarioError, match="bays has no effect"):
        check_plugins(layout)
