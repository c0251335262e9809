"""Carriers with batteries in small harvests: they go to charge, and share the chargers."""

from functools import cache

import pytest
from fleet import wait_for
from local_runs import local_hash, played
from stage import Stage, empty_orchard

from orchard import Local, Scenario
from orchard.contract.messages import pack, unpack
from orchard.field.layout import lay_out
from orchard.field.problems import ScenarioError
from orchard.field.scenario import check
from orchard.report.bounds import Bounds
from orchard.report.long_run import long_run
from orchard.sim.lookahead import CheckedHolds, IgnoredHolds, Lookahead
from orchard.sim.snapshot import Snapshot

# It lasts 7.2 min, is charged in 2.4 min, and a carrier goes to charge with less than 80 %: so
# carriers of a small orchard charge soon.
BATTERY = {"hours": 0.12, "hours_to_charge": 0.04, "reserve": 0.8}
# 250 s: by then a carrier has charged.
TICKS = 2500


def charging(battery: dict | None = None, **changes) -> Scenario:
    """Return a small scenario whose carriers have this battery."""
    own = {"route": "two-way", "carrying": {"battery": BATTERY | (battery or {})}}
    return empty_orchard(
        **{"rows": 4, "pickers": 3, "carriers": 2, "row_length": 30.0, **own, **changes}
    )


@pytest.mark.parametrize("route", ["one-way", "two-way"])
@pytest.mark.parametrize("dispatch", ["nearest", "predictive"])
def test_carriers_charge_after_their_job_and_share_the_charger(route, dispatch):
    """There are two carriers, one charger and four bins."""
    stage = Stage(charging(route=route, dispatch=dispatch))
    carriers = stage.world.fixed.carriers
    most_plugged = 0
    least_charge = 1.0
    while not stage.local.engine.over:
        assert stage.world.tick < 40_000, stage.who_is_where()
        stage.tick()
        most_plugged = max(most_plugged, int(stage.world.plugged.sum()))
        least_charge = min(least_charge, stage.world.charge[carriers].min())
        for name in ("carrier_01", "carrier_02"):
            if stage.doing(name) in ("charging", "driving to the chargers"):
                assert stage.local.memories[name].job, "it counts as busy, and gets no bin"
    assert stage.local.engine.violations() == []
    assert most_plugged == 1
    assert stage.world.delivered == 4
    # A carrier charges when it has less than the reserve of 0.8, and no job may take 0.6.
    assert 0.2 < least_charge < 0.8
    assert len(stage.happened("charging")) >= 2
    assert stage.account.figures()["charging_seconds"] > 60.0
    assert not stage.happened("flat")
    stage.assert_no_collisions()


def test_a_battery_is_used_outside_the_queue_and_charged_fully():
    """A battery that lasts an hour of driving loses 1/3600 a second, half as much while its carrier
    stands, and nothing in the queue.
    """
    stage = Stage(charging({"hours": 1.0, "standing": 0.5}, carriers=1, dispatch="nearest"))
    stage.run(3)
    assert stage.world.charge[stage.world.fixed.carriers] == 1.0, "in the queue it is off"
    stage.run_until(lambda: "bringing" in stage.doing("carrier_01"), 100)
    stage.world.charge[stage.world.fixed.carriers] = 0.3
    took = stage.run_until(lambda: bool(stage.happened("charging")), 400)
    before = stage.world.charge[stage.world.fixed.carriers][0]
    # If it had only driven, and if it had only stood.
    assert 0.3 - took / 3600.0 < before < 0.3 - 0.5 * took / 3600.0
    took = stage.run_until(lambda: bool(stage.happened("charged")), 200)
    assert took == pytest.approx((1.0 - before) * 0.04 * 3600.0, abs=5.0), (
        "it also moves up to the head of its line"
    )
    assert stage.local.engine.observe()["carrier_01"].charge == 1.0


def test_a_flat_carrier_jams_the_run(soon_jammed):
    """The carrier goes flat and stands. That is an event, and the run ends as jammed."""
    stage = Stage(charging({"hours": 0.05, "standing": 1.0, "reserve": 0.0}, carriers=1))
    lasted = stage.run_until(lambda: bool(stage.happened("flat")), 300)
    at = stage.pose("carrier_01")
    stage.run_until(lambda: bool(stage.account.jam), 1000)
    assert stage.pose("carrier_01") == at
    assert "carrier_01 (standing with a flat battery)" in stage.account.jam
    assert stage.doing("carrier_01") == "standing with a flat battery"
    assert stage.local.actions["carrier_01"].state == "failed"
    assert stage.account.figures()["flat_seconds"] == pytest.approx(stage.seconds - lasted, abs=0.5)
    assert len(stage.happened("flat")) == 1


@pytest.mark.parametrize("holds", [Lookahead, CheckedHolds, IgnoredHolds])
def test_a_carrier_that_goes_flat_in_its_charging_line_charges(holds):
    """Carriers charge in a line, and drive to its head as others leave. One that goes flat on that
    way stands, and charges there; then it drives on to the head.
    """
    battery = {"hours": 1.0, "hours_to_charge": 0.05, "standing": 1.0, "reserve": 0.9}
    stage = Stage(charging(battery, carriers=6, route="one-way", row_length=70.0), holds=holds)
    carrier = stage.world.index["carrier_01"]
    stage.run(1)
    stage.run_until(lambda: "bringing" in stage.doing("carrier_01"), 100)
    stage.world.charge[carrier] = 0.5
    stage.run_until(lambda: stage.doing("carrier_01") == "charging", 400)
    west = stage.world.layout.queue.area.west
    stage.run_until(lambda: stage.pose("carrier_01")[0] > west + 0.5, 10)
    # Enough for 0.18 s of an hour.
    stage.world.charge[carrier] = 0.00005
    stage.run_until(lambda: bool(stage.happened("flat")), 10)
    at = stage.pose("carrier_01")
    assert at[0] < stage.world.layout.queue.head - 10.0, "it was on its way to the head"
    stage.run(2)
    assert stage.doing("carrier_01") == "charging a flat battery"
    stage.run_until(lambda: bool(stage.happened("charged")), 200)
    assert stage.pose("carrier_01") == at
    stage.run_until(lambda: stage.pose("carrier_01")[0] > at[0] + 10.0, 30)
    assert len(stage.happened("flat")) == 1
    assert stage.local.engine.violations() == []


@cache
def expected_hash() -> str:
    """Return the hash of a run without interruption."""
    return local_hash(charging(), TICKS)


@cache
def before_charging() -> Snapshot:
    """Return a run shortly before its first carrier drives to the charger.

    `test_holds_change_nothing_when_carriers_charge` asserts that tick 1,400 is before it.
    """
    return played(charging(), 1400).snapshot()


def test_holds_change_nothing_when_carriers_charge(caplog):
    """A hold is the time for which an agent says that its velocity stands. Agents that are asked at
    each tick all the same give the same hash, and none is found to hold wrongly.
    """
    for holds in (CheckedHolds, IgnoredHolds):
        local = Local.resume(before_charging(), holds=holds)
        assert "driving to the chargers" not in {
            action.doing for action in played(local, 1401).actions.values()
        }
        assert played(local, TICKS).engine.hash == expected_hash()
    assert "holds wrongly" not in caplog.text


@cache
def while_charging() -> Snapshot:
    """Return a snapshot 10 s after the first carrier has begun to charge."""
    local = Local.resume(before_charging())
    while not local.engine.world.plugged.any():
        assert local.engine.tick < TICKS
        local.tick()
    return unpack(pack(played(local, local.engine.tick + 100).snapshot()), Snapshot)


def test_a_run_resumed_while_charging_has_the_same_hash():
    local = Local.resume(while_charging())
    assert local.engine.world.plugged.any()
    assert played(local, TICKS).engine.hash == expected_hash()


def test_kills_during_a_charge_leave_the_hash_of_local_mode(fleet, tmp_path):
    """A host is killed, and then physics."""
    pace = ("--speed", "30", "--duration", str(TICKS / 10))
    run = (*pace, "--snapshots", str(tmp_path / "snapshots"), "--snapshot-every", "1")
    fleet.physics(charging(), *run)
    fleet.share(2)
    clock = fleet.client().hear("orchard/clock")
    wait_for(clock, lambda message: message["tick"] >= while_charging().tick)
    fleet.hosts.pop(0).kill()
    fleet.host("--share", "0/2")
    fleet.world.kill()
    fleet.physics(charging(), *run, "--resume", "--run", fleet.run, "--listen", fleet.endpoint)
    assert fleet.end() == expected_hash()


def test_more_chargers_deliver_more_until_they_suffice():
    """However many chargers there are, the rate of a long run stays below its limit."""
    battery = {"hours_to_charge": 0.2}
    rates = {}
    bottlenecks = {}
    for chargers in (1, 2, 4):
        layout = lay_out(charging(battery, rows=8, pickers=4, carriers=4, chargers=chargers))
        bounds = Bounds(layout)
        rates[chargers] = long_run(layout).bins_per_hour
        bottlenecks[chargers] = bounds.bottleneck
        assert rates[chargers] <= bounds.bins_per_hour
    # The second charger adds more than a tenth.
    assert rates[1] < 0.9 * rates[2] < rates[4]
    assert bottlenecks[1] == "chargers"
    assert bottlenecks[4] == "carriers"


def test_spare_carriers_are_off_in_the_queue():
    battery = {"hours": 0.3, "hours_to_charge": 0.2, "reserve": 0.5, "standing": 1.0}
    layout = lay_out(charging(battery, rows=6, pickers=2, carriers=6, picking_speed=0.012))
    # If spare carriers lost charge in the queue, chargers would lower the rate.
    limit = Bounds(layout).bins_per_hour
    assert 0.96 * limit < long_run(layout).bins_per_hour <= limit


# What differs from `charging()`, and words of the error.
REFUSED = [
    (
        {"chargers": 0},
        (
            "chargers = 0, carrying.battery.hours = 0.12: must be 1 to 120 chargers for carriers"
            " with batteries"
        ),
    ),
    (
        {"carriers": 70},
        "for as many lines in which they charge: with rows of 30 m and the bay at 0 m it holds",
    ),
    ({"chargers": 121}, "must be a whole number from 0 to 120"),
]


@pytest.mark.parametrize(("changes", "words"), REFUSED)
def test_what_batteries_need_is_told(changes, words):
    with pytest.raises(ScenarioError) as error:
        check({**charging().model_dump(), **changes})
    assert words in str(error.value)


def test_each_line_has_a_charging_line_with_as_many_places():
    for route in ("one-way", "two-way"):
        for carriers in (1, 2, 5, 12, 13, 40):
            layout = lay_out(charging(route=route, carriers=carriers, row_length=100.0))
            first = layout.first_charging
            places = [layout.queue.place(first + number) for number in range(carriers)]
            assert {place.y for place in places} == set(layout.charging_lines)
            # No line is both a line of the queue and a charging line.
            assert not {*layout.queue.used(carriers)} & {*layout.charging_lines}
            # No two carriers have the same place.
            assert len({place[:2] for place in places}) == carriers
