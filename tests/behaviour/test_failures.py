"""Pickers and carriers that fail while they work, and rows that take their own time.

`failure(seed, robot, number, mean_between, mean_repair)` draws, as the robots do, for how many
seconds of work a robot goes before its failure of this number, and how many its repair takes.
"""

from functools import cache

import pytest
from local_runs import local_hash, start_afresh
from stage import EMPTY_SCENE, Stage, empty_orchard, meadow

from orchard import Local, Scenario
from orchard.field.picking import failure
from orchard.plans.robot import Gate
from orchard.plans.steps import DriveTo, MayFail
from orchard.report.metrics import JAM_SECONDS
from orchard.sim.lookahead import CheckedHolds, IgnoredHolds, Lookahead

VARIED = {
    "spread": {"distribution": "lognormal", "cv": 0.3},
    "failure": {"mean_between": 60.0, "mean_repair": 20.0},
}
OFTEN = {"failure": {"mean_between": 60.0, "mean_repair": 20.0}}
# 1,100 ticks are 110 s, in which rows are picked, pickers fail, and bins are exchanged.
SHORT = 1100


def varied(seed: int = 1, **changes) -> Scenario:
    """Return a small scenario whose rows vary, and whose pickers and carriers fail."""
    values = {
        "rows": 3,
        "row_length": 40.0,
        "picking_speed": 0.6,
        "seed": seed,
        "picking": VARIED,
        "carrying": OFTEN,
    }
    return Scenario(**{**values, "tractor": False, **EMPTY_SCENE, **changes})


@cache
def harvest(seed: int) -> Stage:
    """Return the stage of a whole harvest with this seed."""
    stage = Stage(varied(seed))
    stage.run_to_the_end(2000)
    return stage


def test_a_picker_fails_as_drawn_and_goes_on_when_repaired():
    """At its failure the picker has picked for as long as was drawn."""
    stage = Stage(
        empty_orchard(
            picking_speed=0.5, picking={"failure": {"mean_between": 60.0, "mean_repair": 1800.0}}
        )
    )
    sound, repair = failure(1, "picker_01", 0, 60.0, 1800.0)
    assert sound < 140.0, "else it fails in a later row: 70 m at 0.5 m/s take 140 s"
    stage.tick()
    stage.run_until(lambda: stage.doing("picker_01") == "failed, is repaired", sound + 0.5)
    assert stage.seconds == pytest.approx(sound, abs=0.2)
    assert stage.world.row_picked[0] == pytest.approx(0.5 * sound, abs=1e-6)
    assert stage.local.actions["picker_01"].state == "failed"
    took = stage.run_until(lambda: stage.doing("picker_01") == "picking row 1", repair + 0.5)
    assert took == pytest.approx(repair, abs=0.2)
    assert stage.account.figures()["state_seconds"]["picker"]["failed"] >= took - 0.2


@pytest.mark.parametrize("route", ["one-way", "two-way"])
def test_a_carrier_fails_after_the_drawn_drive_and_goes_on(route):
    """It has driven for as long as was drawn. When it is repaired, it goes on with its job."""
    stage = Stage(
        empty_orchard(
            route=route,
            carriers=1,
            dispatch="nearest",
            carrying={"failure": {"mean_between": 60.0}},
        )
    )
    sound, repair = failure(1, "carrier_01", 0, 60.0, 300.0)
    stage.run_until(lambda: failed(stage), 300)
    # It drives at 1 m/s, so the metres are the seconds of its drives. It fails in drives only.
    driven = stage.world.distance[stage.world.index["carrier_01"]]
    assert driven == pytest.approx(sound, abs=0.01)
    job = stage.local.memories["carrier_01"].job
    took = stage.run_until(lambda: not failed(stage), repair + 0.5)
    assert took == pytest.approx(repair, abs=0.2)
    assert stage.doing("carrier_01").startswith(("bringing an empty bin", "taking"))
    assert stage.local.memories["carrier_01"].job == job


def failed(stage: Stage) -> bool:
    """Whether carrier_01 has failed and is not repaired yet."""
    return stage.world.tick > 0 and stage.local.actions["carrier_01"].state == "failed"


def test_an_overdue_failure_strikes_on_the_next_drive():
    """After a fork with another seed, a robot may have worked longer than is now drawn.

    The first drive has no length, and a failure strikes there, too.
    """
    stage = meadow()
    stage.put("carrier_01", 0.0, 20.0)
    fails = MayFail(seed=1, mean_between=60.0, mean_repair=30.0)
    stage.give("carrier_01", [fails, DriveTo(x=0.0), fails, DriveTo(x=5.0)], worked=3600.0)
    stage.run_until(lambda: failed(stage), seconds=2)
    stage.assert_at("carrier_01", x=0.0)
    stage.run_until(lambda: not stage.local.memories["carrier_01"].plan)
    stage.assert_at("carrier_01", x=5.0)


def test_a_carrier_that_fails_behind_a_place_keeps_it():
    """It gives a place back at a gate of its drive. It fails after 6 s, at x = 6 m: it is past the
    gate of the first place by 5 m, but by only 1 m past that of the second.
    """
    stage = meadow(carrying={"failure": {"mean_between": 60.0, "mean_repair": 30.0}})
    stage.put("carrier_01", 0.0, 20.0)
    sound, _ = failure(1, "carrier_01", 0, 60.0, 30.0)
    drive = DriveTo(x=12.0, frees=[Gate(["first"], 1.0), Gate(["second"], 5.0)])
    stage.give(
        "carrier_01",
        [MayFail(1, 60.0, 30.0), drive],
        worked=sound - 6.0,
        reserved=["first", "second"],
    )
    stage.run_until(lambda: failed(stage))
    stage.assert_at("carrier_01", x=6.0)
    assert stage.local.memories["carrier_01"].reserved == ["second"], "another one may turn there"
    stage.run_until(lambda: not stage.local.memories["carrier_01"].reserved)
    assert not failed(stage)
    assert stage.pose("carrier_01")[0] < 6.2


def test_a_step_before_a_failure_is_not_the_picking_speed():
    """The last step before a failure is shorter, and a bin must not take it for the speed."""
    stage = Stage(
        empty_orchard(seed=4, picking={"failure": {"mean_between": 60.0, "mean_repair": 1800.0}})
    )
    stage.run_until(
        lambda: stage.world.tick > 0 and stage.local.actions["picker_01"].state == "failed", 10
    )
    # With seed 4 it fails after 7.439 s: 74 steps of 0.1 m, and the last one of 0.039 m.
    picked = stage.world.row_picked[0]
    assert picked == pytest.approx(7.439, abs=0.001)
    stage.run(3)
    report = stage.local.memories["dispatch"].bins[stage.bin_of("picker_01")]
    # At 1 m/s.
    assert report.seconds_to_full == pytest.approx(70.0 - picked, abs=0.1)


def test_a_picker_that_waits_long_for_its_repair_is_no_jam():
    """A repair takes two hours on average. One of the two takes longer than twice JAM_SECONDS."""
    stage = Stage(empty_orchard(picking={"failure": {"mean_between": 60.0, "mean_repair": 7200.0}}))
    repairs = [failure(1, f"picker_0{n}", 0, 60.0, 7200.0)[1] for n in (1, 2)]
    assert max(repairs) > 2 * JAM_SECONDS
    stage.run(2 * JAM_SECONDS)
    assert stage.account.jam == []


def test_a_picker_that_fails_before_the_roads_asks_for_no_place():
    """It would ask 3 s before its stop line; but it fails just before it is there."""
    # A seed with which it fails after 134.5 to 137.5 s, at 0.5 m/s from x = -35.5 m on: between
    # x = 31.75 m and 33.25 m.
    for seed in range(1000):
        sound, _ = failure(seed, "picker_01", 0, 60.0, 60.0)
        if 134.5 < sound < 137.5:
            break
    else:
        raise AssertionError("no such seed")
    stage = Stage(
        empty_orchard(
            seed=seed,
            picking_speed=0.5,
            picking={"failure": {"mean_between": 60.0, "mean_repair": 60.0}},
        )
    )
    stage.run_until(
        lambda: stage.world.tick > 1300 and stage.local.actions["picker_01"].state == "failed", 140
    )
    stage.run(2)
    assert 31.7 < stage.pose("picker_01")[0] < 33.3
    assert stage.local.memories["picker_01"].reserved == []


def test_with_spread_and_failures_the_seed_matters():
    first = harvest(1)
    second = harvest(2)
    assert abs(first.seconds - second.seconds) > 1.0
    for stage in (first, second):
        assert stage.world.delivered == 3
        assert stage.account.figures()["collisions"] == 0
    seconds = first.account.figures()["state_seconds"]
    assert "failed" in seconds["picker"]
    assert "failed" in seconds["carrier"]


def test_holds_change_nothing_when_robots_fail_and_rows_differ(caplog):
    """A hold is the time for which an agent says that its velocity stands. Agents that are asked at
    each tick all the same give the same hash, and none is found to hold wrongly.
    """
    scenario = varied(rows_to_pickers="balanced-ends")
    expected = local_hash(scenario, SHORT, holds=Lookahead)
    assert local_hash(scenario, SHORT, holds=CheckedHolds) == expected
    assert local_hash(scenario, SHORT, holds=IgnoredHolds) == expected
    assert "holds wrongly" not in caplog.text


def test_an_agent_made_anew_during_a_failure_changes_nothing():
    """All agents are made anew from their memories every second in which some robot has failed."""
    run = Local(varied())
    restarts = 0
    for tick in range(SHORT):
        run.tick()
        if tick % 10 == 0 and any(action.state == "failed" for action in run.actions.values()):
            start_afresh(run)
            restarts += 1
    assert restarts > 3
    assert any(run.memories[name].failures for name in run.memories if name.startswith("carrier"))
    assert run.engine.hash == local_hash(varied(), SHORT)


def test_lockstep_has_the_local_hash_with_failures(fleet):
    own = varied(rows_to_pickers="balanced-ends")
    fleet.physics(own, "--duration", str(SHORT / 10))
    fleet.share(2)
    assert fleet.end() == local_hash(own, SHORT)


def test_a_pickers_own_agent_is_no_faster_than_the_row():
    """In 5 s each of the first two rows is picked at the speed that was drawn for it."""
    stage = Stage(varied(picking={"spread": VARIED["spread"]}, rows_to_pickers="balanced"))
    stage.run(5)
    speeds = [lane.picking_speed for lane in stage.world.layout.lanes]
    assert stage.world.row_picked[:2] == pytest.approx([5 * speed for speed in speeds[:2]])
