"""Empty bins that run out at the bay, and come back with trailers or a truck, in both models.

A carrier that brings a full bin to the bay takes an empty one from the stock there, `empty_bins`.
Without one the bay does not take its bin, and it waits. A truck takes full bins from the bay, and
brings as many empty ones; trailers do so when they are back.
"""

from collections.abc import Iterator
from itertools import pairwise
from random import Random
from typing import Any, NamedTuple

import pytest
from local_runs import start_afresh
from quiet import NOBODY, laid_out, small_harvest

from orchard.discrete.harvest import DiscreteHarvest
from orchard.event_model.begun.begin import begin_at
from orchard.event_model.begun.moment import RunMoment
from orchard.event_model.harvest import EventHarvest
from orchard.field.layout import Layout, lay_out
from orchard.field.problems import ScenarioError
from orchard.field.scenario import Scenario, parse
from orchard.local import Local
from orchard.report.bounds import Bounds
from orchard.report.metrics import HarvestFigures, harvest_figures
from orchard.sim import stock
from orchard.sim.frames import FrameBuilder
from orchard.wire.codec import frame_of, picture_of

SMALL: dict[str, Any] = NOBODY | {
    "rows": 6,
    "pickers": 2,
    "carriers": 3,
    "row_length": 24.0,
    "dispatch": "nearest",
}
# A truck that comes every 5 minutes for two bins; and two trailers, for two bins each, that are
# away for 150 s.
TRUCK = {"truck": {"every": 300.0, "bins": 2}, "empty_bins": 2}
TRAILERS = {"seconds_away": 150.0, "trailers": {"count": 2, "bins": 2}, "empty_bins": 3}


def with_load_out(load_out: dict[str, Any], **values: Any) -> Layout:
    """Return a layout of a small orchard with this load-out."""
    return lay_out(Scenario.model_validate(SMALL | values | {"load_out": load_out}))


class Harvest(NamedTuple):
    """A harvest of the simulator that is done."""

    run: Local
    #: The ticks at which bins were unloaded.
    ticks: list[int]
    #: For how long the bay did not take a bin that stood there.
    bay_waiting_seconds: float


def harvested(layout: Layout) -> Harvest:
    """Harvest a layout in the simulator. Its stock of empty bins never falls below 0."""
    run = Local(layout.scenario, is_hashed=False)
    figures = HarvestFigures()
    ticks = []
    while not run.ended:
        events = run.tick()
        ticks += [event.tick for event in events if event.what == "unloaded"]
        figures.update(run.engine.world, events, run.engine.answers)
        assert stock.empty_bins(run.engine.world) >= 0
    assert run.ended == "harvested", run.jam
    waited = harvest_figures(run.engine.world, figures)["bay_waiting_seconds"]
    return Harvest(run, ticks, waited)


def modelled(layout: Layout) -> list[float]:
    """Return when bins are unloaded in the event model, s, and when its harvest is over."""
    harvest = DiscreteHarvest(layout).run()
    assert harvest.is_over
    return [*harvest.deliveries, harvest.seconds]


# -- both models


def stocks(seed: int, count: int) -> Iterator[Layout]:
    """Yield small orchards whose empty bins can run out, drawn at random."""
    chances = Random(f"empty bins {seed}")

    def drawn() -> dict[str, Any]:
        bins = chances.randint(1, 3)
        load_out: dict[str, Any] = {"empty_bins": bins + chances.randint(0, 3)}
        if chances.random() < 0.5:
            load_out["truck"] = {"every": float(chances.randint(60, 500)), "bins": bins}
        else:
            load_out["seconds_away"] = float(chances.randint(0, 400))
            load_out["trailers"] = {"count": chances.randint(1, 3), "bins": bins}
        return small_harvest(chances, (4, 6), load_out)

    return laid_out(drawn, count)


def assert_models_agree(seed: int, count: int) -> None:
    """Compare both models in so many drawn orchards: when bins are unloaded, and the end."""
    for layout in stocks(seed, count):
        run, ticks, _ = harvested(layout)
        simulated = [*(tick / 10.0 for tick in ticks), run.engine.world.seconds]
        assert modelled(layout) == pytest.approx(simulated, rel=0.005, abs=1.0)


def test_both_models_agree_about_empty_bins() -> None:
    assert_models_agree(1, 3)


@pytest.mark.soak
def test_soak_both_models_agree_about_thirty_stocks() -> None:
    assert_models_agree(2, 30)


@pytest.mark.parametrize("load_out", [TRUCK, TRAILERS])
def test_the_event_model_goes_on_with_a_stock_in_use(load_out: dict[str, Any]) -> None:
    """It goes on, too, while a carrier waits in the bay and while a bin is unloaded."""
    run = Local(with_load_out(load_out).scenario, is_hashed=False)
    lengths = []
    while not run.ended:
        # Moments of all kinds, and more of those in which a bin is unloaded.
        is_in_bay = run.engine.world.bay_ticks.any()
        if run.engine.tick % 211 == 0 or (is_in_bay and run.engine.tick % 5 == 0):
            moment = RunMoment(run.engine.world, run.memories, run.post.written)
            lengths.append(begin_at(moment).run().seconds)
        run.tick()
    assert len(lengths) > 40
    assert lengths == pytest.approx([run.engine.world.seconds] * len(lengths), abs=0.3)


# -- what happens


def test_the_bay_waits_for_the_truck_while_bins_are_out() -> None:
    """Of six bins the first two get the empty bins of the stock. The truck brings two at 300 s and
    at 600 s. To unload a bin then takes 5 s. The last two wait at the bay when the harvest ends.
    """
    run, ticks, waited = harvested(with_load_out(TRUCK))
    first, *others = [tick / 10.0 for tick in ticks]
    assert first < others[0] < 300.0
    assert 304.0 < others[1] < others[2] < 600.0 + 5.0
    assert 604.0 < others[3] < others[4] < run.engine.world.seconds
    assert run.engine.world.waiting_bins == 2
    assert waited > 100.0


def test_a_stock_for_the_whole_harvest_changes_nothing() -> None:
    """With so many empty bins a truck makes no difference, and the bay never waits."""
    usual = harvested(lay_out(Scenario.model_validate(SMALL)))
    truck = {"every": 600.0, "bins": 3}
    supplied = harvested(with_load_out({"truck": truck, "empty_bins": 6}))
    assert supplied.ticks == usual.ticks
    assert supplied.run.engine.tick == usual.run.engine.tick
    assert supplied.bay_waiting_seconds == 0.0


def test_a_truck_takes_no_more_than_its_bins() -> None:
    """Four full bins wait when the truck comes for two, at 400 s, tick 4,000."""
    layout = with_load_out({"truck": {"every": 400.0, "bins": 2}, "empty_bins": 4})
    run = Local(layout.scenario)
    world = run.engine.world
    waiting = []
    while not run.ended:
        before = world.waiting_bins
        run.tick()
        if world.waiting_bins < before:
            waiting.append((world.tick, before, world.waiting_bins))
    assert waiting[0] == (4001, 4, 2)


def test_a_bay_that_waits_long_for_its_truck_is_no_jam() -> None:
    """For longer than makes a jam, nothing happens: the truck comes every 800 s for one bin."""
    layout = with_load_out({"truck": {"every": 800.0, "bins": 1}, "empty_bins": 1}, rows=3)
    run, ticks, _ = harvested(layout)
    assert [tick // 8000 for tick in ticks] == [0, 1, 2]
    assert modelled(layout)[-1] == pytest.approx(run.engine.world.seconds, abs=1.0)


def test_a_carrier_that_gets_flat_in_the_bay_is_unloaded() -> None:
    """The truck takes its bin in both models.

    Then nothing more comes, and the run ends as jammed.
    """
    battery = {"hours": 0.2, "hours_to_charge": 0.1, "reserve": 0.3, "standing": 0.5}
    layout = with_load_out(
        {"truck": {"every": 3000.0, "bins": 1}, "empty_bins": 1},
        rows=4,
        row_length=30.0,
        carriers=2,
        picking_speed=0.8,
        carrying={"battery": battery},
    )
    run = Local(layout.scenario, is_hashed=False)
    ticks = []
    while not run.ended:
        ticks += [event.tick for event in run.tick() if event.what == "unloaded"]
    assert run.ended == "jammed"
    assert "carrier_02 (standing with a flat battery)" in run.jam
    assert ticks[-1] > 30_000, "with the first truck, at 3,000 s"
    # After 600 s in which nothing happens a run is jammed.
    assert run.engine.tick < ticks[-1] + 6_100, "and not with the next truck"
    harvest = EventHarvest(layout)
    harvest.run()
    assert not harvest.is_over
    assert [10.0 * seconds for seconds in harvest.deliveries] == pytest.approx(ticks, abs=1.0)


def test_fewer_empty_bins_let_fewer_trailers_be_away() -> None:
    """With three empty bins only one of two trailers, of two bins each, can be full.

    With two, a trailer leaves only when the one before is back, after 150 s, and the bay has worked
    for 5 s at least to load it.
    """
    enough = harvested(with_load_out(TRAILERS | {"empty_bins": 40})).ticks
    few = harvested(with_load_out(TRAILERS)).ticks
    assert few[-1] > enough[-1] + 300
    fewest = harvested(with_load_out(TRAILERS | {"empty_bins": 2})).ticks
    between_departures = [later - earlier for earlier, later in pairwise(fewest[1::2])]
    assert min(between_departures) >= 1550


# -- limit, words, forks


def test_truck_and_empty_bins_limit_the_rate() -> None:
    """Terms of a limit are bins a second. Trailers are away for 150 s; a bin is unloaded in 5 s."""
    few = Bounds(with_load_out(TRUCK))
    assert few.bottleneck == "truck"
    assert few.bins_per_hour == pytest.approx(3600.0 * 2 / 300.0)
    # One trailer of two at a time, and the first bin of the next one is put on it meanwhile.
    fewer = Bounds(with_load_out(TRAILERS))
    assert fewer.terms["trailers"] == pytest.approx(2 / (150.0 + 5.0))
    # Four empty bins fill both trailers, of two bins each.
    enough = Bounds(with_load_out(TRAILERS | {"empty_bins": 4}))
    assert enough.terms["trailers"] == pytest.approx(4 / (150.0 + 10.0))


def test_a_run_goes_on_equally_while_bins_wait() -> None:
    """A fork may have a truck that comes sooner, but no other number of empty bins."""
    run = Local(with_load_out(TRUCK).scenario)
    while run.engine.world.waiting_bins < 2:
        run.tick()
    again = Local.resume(run.snapshot())
    start_afresh(again)
    forked = run.fork(**{"load_out.truck.every": 240.0})
    for each in (run, again, forked):
        while not each.ended:
            each.tick()
    assert again.engine.hash == run.engine.hash
    assert forked.engine.tick < run.engine.tick - 300
    with pytest.raises(ScenarioError, match=r"load_out\.empty_bins.*all these bins are at the bay"):
        again.fork(**{"load_out.empty_bins": 3})


# -- what is refused


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{empty_bins: 9}", "run out, and none comes back: set truck.every and truck.bins, or"),
        ("{truck: {every: 2400}, empty_bins: 9}", "load_out.truck.bins = None: must be set togeth"),
        ("{truck: {every: 2400, bins: 9}}", "has no effect while there are always empty bins"),
        ("{truck: {every: 9, bins: 9}, empty_bins: 9}", "from 60.0 to 86400.0"),
        ("{truck: {every: 600, bins: 12}, empty_bins: 9}", "never fills: must be at most empty_bi"),
        (
            "{seconds_away: 60, trailers: {count: 1, bins: 3}, empty_bins: 2}",
            "never fills: must be at most empty_bins",
        ),
        (
            "{seconds_away: 60, truck: {every: 600, bins: 3}, empty_bins: 3}",
            "at most one of both can be set: a truck fetches the bins from the bay, or",
        ),
    ],
)
def test_bins_that_do_not_come_back_are_refused(text: str, words: str) -> None:
    with pytest.raises(ScenarioError, match="load_out") as refusal:
        parse(f"load_out: {text}")
    assert words in str(refusal.value)


# -- the picture


@pytest.mark.parametrize("load_out", [TRUCK, TRAILERS])
def test_frames_tell_of_the_load_out(load_out: dict[str, Any]) -> None:
    """They come over the wire as they were sent, each with what has changed."""
    run = Local(with_load_out(load_out).scenario, is_hashed=False)
    world = run.engine.world
    builder = FrameBuilder(run.engine)
    shown = world.trailers.tolist()
    while not world.waiting_bins and not world.trailers[:, 1].any():
        events = run.tick()
        sent = builder.frame(events)
        frame = frame_of(picture_of("run", sent), run.engine.layout)
        if frame.trailers is not None:
            shown = frame.trailers.tolist()
        assert shown == world.trailers.tolist()
        assert frame.waiting_bins == world.waiting_bins
