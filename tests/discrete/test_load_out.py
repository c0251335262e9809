"""A load-out: carriers that have unloaded, or trailers that are full, are away for a time, in the
simulator and in the event model alike.

The load-out is a place beyond the orchard, to which bins are hauled. The time away is given
(`seconds_away`), or follows from the way there: twice `metres` at `speed`, and `seconds` there.
"""

from collections.abc import Iterator
from itertools import pairwise
from random import Random
from statistics import fmean
from typing import Any

import pytest
from local_runs import start_afresh
from quiet import NOBODY, laid_out, small_harvest

from orchard.discrete.harvest import DiscreteHarvest
from orchard.event_model.begun.begin import begin_at
from orchard.event_model.begun.moment import RunMoment
from orchard.field.kinds import HAULERS, kind_of
from orchard.field.layout import Layout, lay_out
from orchard.field.problems import ScenarioError
from orchard.field.scenario import Scenario, parse
from orchard.local import Local
from orchard.plans.steps import Charge, Haul
from orchard.report.bounds import Bounds, proven_seconds
from orchard.report.losses import lost_seconds

SMALL: dict[str, Any] = NOBODY | {
    "rows": 4,
    "pickers": 2,
    "carriers": 2,
    "row_length": 24.0,
    "dispatch": "nearest",
}
AWAY = {"seconds_away": 100.0}


def small(**values: Any) -> Layout:
    """Return a layout of a small orchard, with these values in its scenario."""
    return lay_out(Scenario.model_validate(SMALL | values))


def harvested(layout: Layout) -> Local:
    """Harvest in the simulator. No robot collides, and none jams."""
    run = Local(layout.scenario)
    while not run.ended:
        run.tick()
    assert run.ended == "harvested", run.jam
    collided = zip(layout.names, run.engine.world.collisions.tolist(), strict=True)
    assert not [name for name, count in collided if count and kind_of(name) in HAULERS]
    return run


def simulated(layout: Layout) -> float:
    """Return how long a harvest takes in the simulator, s."""
    return harvested(layout).engine.world.seconds


def modelled(layout: Layout) -> float:
    """Return how long a harvest takes in the event model, s."""
    return DiscreteHarvest(layout).run().seconds


def run_until_away(layout: Layout) -> Local:
    """Return a run in which a carrier has just begun to be away."""
    run = Local(layout.scenario)
    while "away at the load-out" not in doings(run):
        run.tick()
        assert not run.ended
    return run


def doings(run: Local) -> list[str]:
    """Return what the carriers of a run do now."""
    return [run.actions[name].doing for name in run.actions if kind_of(name) == "carrier"]


# -- both models


def load_outs(seed: int, count: int) -> Iterator[Layout]:
    """Yield small orchards with load-outs, drawn at random."""
    chances = Random(f"load-out {seed}")

    def drawn() -> dict[str, Any]:
        time_away: dict[str, Any] = {"seconds_away": float(chances.randint(0, 400))}
        if chances.random() < 0.5:
            time_away = {
                "metres": float(chances.randint(1, 800)),
                "speed": round(chances.uniform(1.0, 8.0), 1),
                "seconds": float(chances.randint(0, 90)),
            }
        if chances.random() < 0.5:
            time_away["trailers"] = {
                "count": chances.randint(1, 3),
                "bins": chances.randint(1, 4),
            }
        return small_harvest(chances, (3, 5), time_away)

    return laid_out(drawn, count)


def errors(seed: int, count: int) -> list[float]:
    """Return by which share the event model differs in each of some drawn harvests.

    No harvest is shorter than is proven to be possible, or brings more than its limit.
    """
    shares = []
    for layout in load_outs(seed, count):
        run = harvested(layout)
        world = run.engine.world
        proven = proven_seconds(layout)
        assert proven is not None
        assert proven <= world.seconds
        rate = world.delivered / world.seconds
        assert rate <= Bounds(layout).bins_per_hour / 3600.0
        shares.append(abs(modelled(layout) / world.seconds - 1.0))
    return shares


def test_both_models_agree_about_load_outs() -> None:
    assert fmean(errors(1, 5)) <= 0.005


@pytest.mark.soak
def test_soak_both_models_agree_about_thirty_load_outs() -> None:
    shares = errors(2, 30)
    print(f"mean {fmean(shares):.5f}, most {max(shares):.5f}")
    assert fmean(shares) <= 0.005


@pytest.mark.parametrize("chargers", [1, 2])
def test_both_models_agree_about_batteries_and_a_load_out(chargers: int) -> None:
    """Carriers use their batteries on the way to the load-out, so they charge often."""
    layout = small(
        rows=6,
        pickers=3,
        carriers=3,
        chargers=chargers,
        carrying={"battery": {"hours": 0.25, "hours_to_charge": 0.05}},
        load_out={"metres": 150.0, "speed": 5.0, "seconds": 60.0},
    )
    assert modelled(layout) == pytest.approx(simulated(layout), rel=0.01)


# -- carriers that go there


def test_a_harvest_ends_when_the_last_carrier_is_back() -> None:
    """There is a carrier for each bin, so no bin waits for one.

    The harvest is longer by the time that the last carrier is away. If that carrier has moved up
    its line meanwhile, it is there when it is back.
    """
    usual = small(rows=3, pickers=3, carriers=3)
    away = small(rows=3, pickers=3, carriers=3, load_out=AWAY)
    assert simulated(away) == pytest.approx(simulated(usual) + 100.0, abs=15.0)
    assert modelled(away) == pytest.approx(simulated(away), abs=1.0)


def test_a_carrier_that_is_away_takes_no_call() -> None:
    run = run_until_away(small(load_out=AWAY))
    away = next(
        name
        for name, action in run.actions.items()
        if kind_of(name) == "carrier" and action.doing == "away at the load-out"
    )
    begun = run.engine.tick
    while run.actions[away].doing == "away at the load-out":
        assert run.actions[away].state == "hauling"
        assert run.memories[away].job is not None
        run.tick()
    # 100 s.
    assert run.engine.tick - begun == pytest.approx(1000, abs=2)


def test_a_carrier_that_is_away_is_busy_and_no_jam() -> None:
    """All robots wait for the only carrier, which is away for 700 s with each of three bins: longer
    than the 600 s of a jam.
    """
    layout = small(rows=3, carriers=1, load_out={"seconds_away": 700.0})
    run = harvested(layout)
    run.engine.account()
    assert run.engine.world.seconds > 2100.0
    model = DiscreteHarvest(layout).run()
    assert model.seconds == pytest.approx(run.engine.world.seconds, rel=0.002)
    assert model.carrier_utilisation() > 0.95


def test_a_way_to_the_load_out_uses_the_battery() -> None:
    """The carrier drives 2 * 90 m at 3 m/s, for 60 s, and stands for 100 s at a fifth of the power.

    It does so with four bins. A battery lasts for 2 h, 7,200 s, of driving.
    """
    values = {"carriers": 1, "carrying": {"battery": {"hours": 2.0}}}
    near = harvested(small(**values)).engine.world
    far = harvested(
        small(**values, load_out={"metres": 90.0, "speed": 3.0, "seconds": 100.0})
    ).engine.world
    carrier = near.fixed.carriers[0]
    used = near.charge[carrier] - far.charge[carrier]
    assert used * 7200.0 == pytest.approx(4 * (60.0 + 0.2 * 100.0), abs=0.5)


def test_limit_and_losses_know_the_load_out() -> None:
    usual = small()
    away = small(load_out=AWAY)
    # A round is longer by the 100 s away, less what it takes to drive up to the head of the line,
    # which a carrier saves that has been away.
    longer = Bounds(away).cycle_seconds - Bounds(usual).cycle_seconds
    assert 80.0 < longer <= 100.0
    seconds = simulated(away)
    parts = lost_seconds(away, seconds)
    assert sum(parts.values()) == pytest.approx(seconds, abs=0.5)
    # The time away is a part of the shortest possible harvest, and no traffic.
    assert parts["optimum"] > lost_seconds(usual, simulated(usual))["optimum"] + 90.0
    assert parts["traffic"] < 0.1 * seconds


def test_time_at_the_load_out_is_charged_as_standing() -> None:
    """A battery that loses nothing while its carrier stands loses nothing there, however long."""
    battery = {"hours": 2.0, "hours_to_charge": 1.0, "standing": 0.0}
    charging = []
    # Time to charge for each bin, of both pickers: first with a short stay there, then with a long.
    for seconds in (60.0, 160.0):
        away = {"metres": 400.0, "speed": 4.0, "seconds": seconds}
        layout = small(load_out=away, carrying={"battery": battery}, chargers=1)
        charging += [times.charging for times in Bounds(layout).of_pickers.values()]
    assert charging[:2] == pytest.approx(charging[2:])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{metres: 400}", "load_out.metres = 400.0, load_out.speed = None: must be set together"),
        ("{speed: 4}", "must be set together: the way to the load-out and the speed on it"),
        ("{metres: 400, speed: 4, seconds_away: 260}", "at most one of both can be set: metres"),
        ("{seconds: 60}", "has no effect without metres and speed; seconds_away is the whole"),
        ("{seconds_away: 8000}", "from 0.0 to 7200.0"),
        ("{metres: 400, speed: 100}", "from 0.5 to 15.0"),
        ("{seconds_away: 9, trailers: {count: 2}}", "load_out.trailers.bins = None: must be set"),
        ("{trailers: {count: 2, bins: 3}}", "have no way to drive: set metres and speed, or"),
        ("{seconds_away: 9, trailers: {count: 1, bins: 9}}", "a trailer never fills: a harvest"),
    ],
)
def test_half_a_load_out_or_two_of_them_are_refused(text: str, words: str) -> None:
    with pytest.raises(ScenarioError, match="load_out") as refusal:
        parse(f"load_out: {text}")
    assert words in str(refusal.value)


def test_a_way_that_empties_a_battery_is_refused() -> None:
    with pytest.raises(ScenarioError, match=r"uses 1.1 of a battery; must be less than 0\.8"):
        parse("{load_out: {seconds_away: 400}, carrying: {battery: {hours: 0.1}}}")


# -- trailers


def with_trailers(count: int, bins: int, **values: Any) -> Layout:
    """Return a layout with trailers that are away for 150 s."""
    trailers = {"count": count, "bins": bins}
    return small(**values, load_out={"seconds_away": 150.0, "trailers": trailers})


def test_a_carrier_waits_while_no_trailer_stands_at_the_bay() -> None:
    """There is one trailer, for one bin.

    It is away after each bin, so three of the four carriers wait for it.
    """
    layout = with_trailers(1, 1)
    times = unloadings(layout)
    assert len(times) == 4
    assert min(later - earlier for earlier, later in pairwise(times)) >= 150.0
    assert simulated(layout) == pytest.approx(times[-1] + 150.0, abs=0.2)
    assert modelled(layout) == pytest.approx(simulated(layout), abs=0.3)


def unloadings(layout: Layout) -> list[float]:
    """Return when bins were unloaded in the simulator, s."""
    run = Local(layout.scenario)
    times = []
    while not run.ended:
        times += [run.engine.world.seconds for event in run.tick() if event.what == "unloaded"]
    return times


def test_a_larger_trailer_or_a_second_one_brings_more() -> None:
    """A trailer leaves when it is full, or with the last bin, so the harvest ends sooner."""
    one_trailer = simulated(with_trailers(1, 1))
    two = simulated(with_trailers(2, 1))
    larger = simulated(with_trailers(1, 3))
    endless = simulated(with_trailers(4, 1))
    assert endless <= two < one_trailer - 100.0
    assert larger < one_trailer - 100.0
    assert endless == pytest.approx(simulated(small()) + 150.0, abs=20.0)


def test_trailers_limit_the_rate() -> None:
    """One trailer for one bin brings a bin every 150 s and the 5 s in which it is loaded."""
    few = Bounds(with_trailers(1, 1, picking_speed=1.0, carriers=6))
    assert few.bottleneck == "trailers"
    assert few.bins_per_hour == pytest.approx(3600.0 / 155.0)
    assert Bounds(with_trailers(3, 4)).bottleneck != "trailers"


def test_carriers_use_no_battery_for_trailers() -> None:
    values = {"carriers": 1, "carrying": {"battery": {"hours": 2.0, "standing": 0.0}}}
    near = harvested(small(**values)).engine.world
    far = harvested(with_trailers(1, 4, **values)).engine.world
    carrier = near.fixed.carriers[0]
    assert far.charge[carrier] == near.charge[carrier]


def test_a_run_goes_on_equally_while_a_trailer_is_away() -> None:
    """A fork may shorten the time away, but not change the trailers: bins stand on them."""
    run = Local(with_trailers(1, 2).scenario)
    # Column 1 is the tick at which the trailer is back; 0: it has not left yet.
    while not run.engine.world.trailers[0, 1]:
        run.tick()
    again = Local.resume(run.snapshot())
    start_afresh(again)
    forked = run.fork(**{"load_out.seconds_away": 60.0})
    for each in (run, again, forked):
        while not each.ended:
            each.tick()
    assert again.engine.hash == run.engine.hash
    assert forked.engine.tick < run.engine.tick - 500
    with pytest.raises(ScenarioError, match=r"load_out\.trailers.*bins stand on the trailers"):
        again.fork(**{"load_out.trailers.count": 2})


# -- moments of a run


def test_a_run_goes_on_equally_from_the_middle_of_a_haul() -> None:
    run = run_until_away(small(load_out=AWAY))
    for _ in range(300):
        run.tick()
    again = Local.resume(run.snapshot())
    start_afresh(again)
    while not run.ended:
        run.tick()
        again.tick()
        assert again.engine.hash == run.engine.hash
    assert again.ended == run.ended


def test_a_fork_in_the_middle_of_a_haul_takes_the_other_time() -> None:
    """The carrier has been away for 30 s of 100. In the fork it should be away for 20 s only, so it
    is back at once.
    """
    run = run_until_away(small(load_out=AWAY))
    for _ in range(300):
        run.tick()
    away = next(
        name
        for name, action in run.actions.items()
        if action.doing == "away at the load-out"
        and run.engine.tick - run.memories[name].since > 200
    )
    sooner = run.fork(**{"load_out.seconds_away": 20.0})
    for _ in range(2):
        sooner.tick()
    assert sooner.actions[away].doing == "waiting in the queue"
    again = Local.resume(sooner.snapshot())
    while not sooner.ended:
        sooner.tick()
        again.tick()
    assert again.engine.hash == sooner.engine.hash
    while not run.ended:
        run.tick()
    assert sooner.engine.tick < run.engine.tick - 500


def test_a_fork_cannot_add_a_load_out() -> None:
    run = Local(small().scenario)
    run.tick()
    with pytest.raises(ScenarioError, match=r"load_out\.seconds_away.*cannot change under way"):
        run.fork(**{"load_out.seconds_away": 20.0})


def test_the_event_model_goes_on_from_the_middle_of_a_haul() -> None:
    """Begun at any tick of the run, also during a haul, the event model ends as the run does."""
    run = run_until_away(small(load_out=AWAY))
    models = []
    while not run.ended:
        # Every 37.1 s: the moments are of different kinds.
        if run.engine.tick % 371 == 0:
            moment = RunMoment(run.engine.world, run.memories, run.post.written)
            models.append(begin_at(moment).run().seconds)
        run.tick()
    assert len(models) > 8
    assert models == pytest.approx([run.engine.world.seconds] * len(models), abs=1.0)


@pytest.mark.parametrize("route", ["one-way", "two-way"])
def test_a_carrier_that_is_back_on_its_way_up_its_line_is_free(route: str) -> None:
    """The haul ends before the carrier has come to the head of its line."""
    layout = small(load_out={"seconds_away": 2.0}, route=route)
    assert simulated(layout) == pytest.approx(modelled(layout), rel=0.005)


def test_a_carrier_that_gets_flat_before_its_haul_is_a_jam() -> None:
    """The carrier stands between bay and queue for ever, and its haul never begins."""
    layout = small(
        carriers=1,
        row_length=60.0,
        picking_speed=1.0,
        # Found by trial: enough for the way to the bay, and not for the way home.
        carrying={"battery": {"hours": 0.0552}},
        load_out={"seconds_away": 20.0},
    )
    run = Local(layout.scenario, is_hashed=False)
    while not run.ended and run.engine.tick < 12_000:
        run.tick()
    assert run.ended == "jammed"


def test_the_event_model_goes_on_from_a_haul_before_charging() -> None:
    """A carrier whose battery is low charges when it is back from the load-out."""
    battery = {"hours": 0.2, "hours_to_charge": 0.05, "reserve": 0.5}
    away = {"metres": 150.0, "speed": 5.0, "seconds": 60.0}
    layout = small(rows=6, chargers=1, carrying={"battery": battery}, load_out=away)
    run = Local(layout.scenario, is_hashed=False)
    lengths = []
    while not run.ended:
        if run.engine.tick % 211 == 0 and is_any_away_before_charging(run):
            moment = RunMoment(run.engine.world, run.memories, run.post.written)
            lengths.append(begin_at(moment).run().seconds)
        run.tick()
    assert len(lengths) > 4
    assert lengths == pytest.approx([run.engine.world.seconds] * len(lengths), abs=1.6)


def is_any_away_before_charging(run: Local) -> bool:
    """Whether a carrier is at the load-out, and charges after that."""
    carriers = [run.memories[name] for name in run.memories if kind_of(name) == "carrier"]
    return any(
        isinstance(memory.plan[0], Haul) and any(isinstance(step, Charge) for step in memory.plan)
        for memory in carriers
        if memory.plan
    )
