"""Machines whose speeds and times a scenario sets: they hold in the simulator and in the event
model alike.

Where both models are compared, 0.5 % of a harvest may differ: robots meet in other ticks.
"""

from statistics import fmean
from typing import Any

import pytest
from drawn_machines import drawn_machines
from quiet import NOBODY

from orchard.discrete.harvest import DiscreteHarvest
from orchard.field.kinds import HAULERS, kind_of
from orchard.field.layout import Layout, lay_out
from orchard.field.problems import ScenarioError
from orchard.field.queue import CLOSED_UP
from orchard.field.scenario import TIME_STEP, Scenario, parse
from orchard.local import Local
from orchard.plans.jobs import least_headway
from orchard.plans.steps import DriveTo
from orchard.report.bounds import Bounds

SMALL: dict[str, Any] = NOBODY | {
    "rows": 4,
    "pickers": 2,
    "carriers": 2,
    "row_length": 24.0,
    "dispatch": "nearest",
}


def small(**machines: Any) -> Layout:
    """Return a layout of a small orchard, with these machines."""
    return lay_out(Scenario.model_validate(SMALL | machines))


def simulated(layout: Layout) -> float:
    """Return how long a harvest takes in the simulator, s. No robot collides, and none jams."""
    run = Local(layout.scenario, is_hashed=False)
    while not run.ended:
        run.tick()
    assert run.ended == "harvested", run.jam
    world = run.engine.world
    collided = zip(layout.names, world.collisions.tolist(), strict=True)
    assert not [name for name, count in collided if count and kind_of(name) in HAULERS]
    return world.seconds


def modelled(layout: Layout) -> float:
    """Return how long a harvest takes in the event model, s."""
    return DiscreteHarvest(layout).run().seconds


def errors(seed: int, count: int) -> list[float]:
    """Return by which share the event model is longer or shorter in each of some drawn harvests."""
    shares = []
    for layout in drawn_machines(seed, count):
        seconds = simulated(layout)
        shares.append(abs(modelled(layout) / seconds - 1.0))
    return shares


def test_both_models_agree_about_any_machines() -> None:
    assert fmean(errors(1, 6)) <= 0.005


@pytest.mark.soak
def test_soak_both_models_agree_about_a_hundred_machines() -> None:
    shares = sorted(errors(2, 100))
    assert fmean(shares) <= 0.005
    # In 95 of the 100 harvests at most 1 %.
    assert shares[94] <= 0.01


def test_no_carrier_asks_before_the_one_in_front_of_it() -> None:
    """Carriers stand 4.1 m apart in a line.

    A carrier that asks from further away could get a place before the one in front of it, which
    needs that place first.
    """
    drive = DriveTo(x=0.0)
    fastest = small(carrying={"speed": 2.5}).machines["carrier"]
    assert drive.asks_before(fastest) < CLOSED_UP
    # m: 3 s of its way.
    slowest = small(carrying={"speed": 0.5}).machines["carrier"]
    assert drive.asks_before(slowest) == 1.5


def test_carriers_stop_behind_each_other_as_queues_have_room() -> None:
    """A carrier stops by whole steps, so up to a step further back than it must."""
    carrier = small().machines["carrier"]
    step = carrier.speed * TIME_STEP
    assert least_headway(carrier) + step == pytest.approx(CLOSED_UP)


@pytest.mark.parametrize("route", ["one-way", "two-way"])
def test_many_fast_carriers_do_not_jam(route: str) -> None:
    crowd = small(rows=5, pickers=5, carriers=10, route=route, carrying={"speed": 2.5})
    assert modelled(crowd) == pytest.approx(simulated(crowd), rel=0.01)


def test_slow_carriers_drive_at_their_speed() -> None:
    usual = small()
    slow = small(carrying={"speed": 0.5})
    assert simulated(slow) > 1.2 * simulated(usual)
    assert modelled(slow) == pytest.approx(simulated(slow), rel=0.005)
    assert Bounds(slow).cycle_seconds > 1.5 * Bounds(usual).cycle_seconds


def test_a_carrier_faster_than_its_bin_can_follow_is_refused() -> None:
    with pytest.raises(
        ScenarioError, match=r"from 0\.5 to 2\.5 .* a bin cannot follow a faster one"
    ):
        parse("carrying: {speed: 3}")


def test_a_run_goes_on_with_other_carriers() -> None:
    """Plans have no speeds in them, so in a fork other speeds hold from the next drive on."""
    run = Local(small().scenario, is_hashed=False)
    while run.engine.tick < 300:
        run.tick()
    faster = run.fork(**{"carrying.speed": 2.0, "handling.unloading": 20.0})
    while not faster.ended:
        faster.tick()
    while not run.ended:
        run.tick()
    assert faster.ended == "harvested"
    assert faster.engine.tick < run.engine.tick


def test_slow_pickers_drive_at_their_speed() -> None:
    """Each has two rows. Outside of them it drives at half the usual speed of 1 m/s."""
    usual = small(picking_speed=0.4)
    slow = small(picking_speed=0.4, picking={"driving_speed": 0.5})
    assert simulated(slow) > simulated(usual) + 15.0
    assert modelled(slow) == pytest.approx(simulated(slow), rel=0.005)
    assert Bounds(slow).crossing_seconds > 1.5 * Bounds(usual).crossing_seconds


def test_a_picker_picks_as_fast_as_it_drives_at_most() -> None:
    """The default picking speed follows the driving speed. One that is named must not be faster."""
    slow = {"picking": {"driving_speed": 0.6}}
    assert Scenario.model_validate(slow).mean_picking_speed == 0.6
    assert small(**slow).lane(1).picking_speed == 0.6
    for too_fast in ("picking_speed: 0.8", "picking_rate: 40"):
        with pytest.raises(ScenarioError, match=r"picking_(speed|rate) = .* 0\.6 m/s"):
            parse(f"{{{too_fast}, picking: {{driving_speed: 0.6}}}}")


@pytest.mark.parametrize(
    ("machines", "seconds"),
    # `seconds`: by which one exchange of bins takes longer at least, for its picker. By default
    # coupling takes 0.2 s, uncoupling 0.4 s; a bin is uncoupled twice, by picker and by carrier. To
    # turn by a right angle takes 10 s at 9 degrees/s, and 4 s at the default of 22.5.
    [
        ({"handling": {"coupling": 20.2}}, 20.0),
        ({"handling": {"uncoupling": 20.4}}, 40.0),
        ({"handling": {"exchange": 20.0}}, 20.0),
        ({"picking": {"turning": 9.0}}, 2 * 6.0),
        ({"carrying": {"turning": 9.0}}, 6.0),
    ],
    ids=["coupling", "uncoupling", "exchange", "pickers turn", "carriers turn"],
)
def test_time_for_a_bin_and_for_a_turn_is_taken(machines: dict[str, Any], seconds: float) -> None:
    """Each of two slow pickers picks two rows. The second one ends at least an exchange later."""
    usual = small(picking_speed=0.1)
    longer = small(picking_speed=0.1, **machines)
    assert simulated(longer) > simulated(usual) + 0.9 * seconds
    assert modelled(longer) == pytest.approx(simulated(longer), rel=0.005)
    before = Bounds(usual)
    after = Bounds(longer)
    assert after.bin_seconds + after.cycle_seconds > before.bin_seconds + before.cycle_seconds


def test_a_bay_that_takes_longer_brings_fewer_bins() -> None:
    """It takes 120 s for each of four bins, not 5 s."""
    fast = small()
    slow = small(handling={"unloading": 120.0})
    assert simulated(slow) > simulated(fast) + 200.0
    assert modelled(slow) == pytest.approx(simulated(slow), rel=0.005)
    assert Bounds(slow).bay_seconds == pytest.approx(Bounds(fast).bay_seconds + 115.0, abs=0.5)
