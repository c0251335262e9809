"""Carriers that are sent before a bin is full, and the forecasts by which they are sent.

Such a carrier must not drive into the lane before its picker has left the bin there: it would shut
the picker in. So it holds (stands) at a line on the road before the lane.
"""

import pytest
from local_runs import local_hash
from stage import Stage, Standing, small_orchard

from orchard import (
    Scenario,
    draw,
)
from orchard.plans import route
from orchard.plans.forecast import Forecast, Ripening
from orchard.sim.lookahead import CheckedHolds


def test_no_agent_of_an_early_harvest_holds_too_long(caplog):
    """Here a hold is the time for which an agent says that its velocity stands (docs/protocol.md).
    `CheckedHolds` asks each agent all the same, and logs where the velocity differs.
    """
    local_hash(small_orchard("predictive", rows=3, picking_speed=0.7), 2500, holds=CheckedHolds)
    assert "holds wrongly" not in caplog.text


def too_early() -> Stage:
    """Return a stage whose policy sends a carrier as soon as there is a bin."""
    return Stage(
        small_orchard("own_policies.AtOnce", rows=3, pickers=2, carriers=2, picking_speed=0.5)
    )


def test_an_early_carrier_holds_until_the_bin_is_left():
    stage = too_early()
    # y of the line at which it holds; it comes from the north.
    hold = stage.world.layout.lane(1).y + route.OneWay.HOLD
    stage.run_until(lambda: stage.pose("carrier_01")[1] < hold + 1e-6, 100)
    stage.run(20)
    stage.assert_at("carrier_01", y=hold, heading="SOUTH")
    assert stage.local.actions["carrier_01"].waits_for == stage.bin_of("picker_01"), (
        "it says for which bin it waits"
    )
    stage.run_until(lambda: not stage.bin_of("picker_01"), 120)
    stage.assert_at("carrier_01", y=hold)
    stage.run_to_the_end()
    assert stage.world.delivered == 3


def test_without_that_hold_the_early_carrier_shuts_the_picker_in(monkeypatch):
    """A mistake is planted: the carrier drives into the lane at once."""
    monkeypatch.setattr(route, "_once_left", lambda approach, full_bin, place: approach)
    stage = too_early()
    stage.run(400)
    assert stage.world.delivered == 0
    assert stage.local.actions["picker_01"].waits_for == "carrier_01"
    assert stage.local.actions["carrier_01"].waits_for == "picker_01"


def test_a_picker_that_stays_in_its_row_jams_with_its_bin_named(soon_jammed):
    """A carrier has left for the bin, and waits for a picker that never comes."""
    stage = Stage(small_orchard("predictive", rows=3))

    def jobs() -> list:
        memories = stage.local.memories.values()
        return [memory.job for memory in memories if getattr(memory, "job", None)]

    stage.run_until(lambda: len(jobs()) > 0, 100)
    job = jobs()[0]
    stage.local.agents[job.picker] = Standing()
    stage.local.engine.wake([job.picker])
    stage.run_until(lambda: bool(stage.account.jam), 3000)
    assert any(f"waits for {job.bin}" in line for line in stage.account.jam), stage.account.jam
    assert stage.local.engine.violations() == []


def test_a_forecast_comes_true():
    """A forecast says where and when the bin of a picker will be full.

    It is made from the time at which the picker faces its row, also while it still drives up to
    it; in the first row and in the next one.
    """
    stage = Stage(small_orchard("predictive", picking_speed=0.5))
    forecast = Forecast(stage.world.layout)
    for lane, side in ((1, "east"), (2, "west")):
        forecasts = forecasts_until_full(stage, forecast)
        # A row of 70 m takes 140 s at 0.5 m/s: 1400 ticks, and a forecast at most of them.
        assert len(forecasts) > 1300
        for ripening, foreseen_seconds in forecasts:
            assert ripening.lane == lane
            assert ripening.side == side
            # Two ticks and a half: a bin is full at the end of a tick.
            assert abs(foreseen_seconds - stage.seconds) < 0.25
        stage.run_until(lambda: not stage.bin_of("picker_01"))


def forecasts_until_full(stage: Stage, forecast: Forecast) -> list[tuple[Ripening, float]]:
    """Run until the bin of picker_01 is full. Return of each tick that has one the forecast, and
    when the bin will be full by it, s since the start.
    """
    forecasts = []
    bin_name = ""
    while not bin_name or not stage.is_full(bin_name):
        stage.tick()
        bin_name = stage.bin_of("picker_01")
        if not bin_name:
            continue
        # 0.5 m/s is the picking speed.
        seen = stage.local.engine.observe()[bin_name]
        ripening = forecast.of(seen, seen.hitch, 0.5)
        if ripening is not None:
            forecasts.append((ripening, stage.seconds + ripening.seconds))
    return forecasts


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(40))
def test_soak_carriers_that_leave_too_early_never_lock(seed):
    """In random orchards some robots are stopped for a while; those that wait then go on."""

    def drawn(name: str, low: int, high: int) -> int:
        """Draw an integer from `low` to `high`."""
        return low + int(draw(seed, f"early carriers, {name}", 0)[0] * (high + 1 - low))

    early_policies = ["own_policies.AtOnce", "predictive", "predictive-farthest"]
    rows = drawn("rows", 3, 12)
    scenario = Scenario(
        rows=rows,
        pickers=drawn("pickers", 2, rows),
        carriers=drawn("carriers", 1, 20),
        picking_speed=drawn("speed", 3, 10) / 10,
        row_width=float(drawn("width", 5, 9)),
        seed=seed,
        dispatch=early_policies[drawn("policy", 0, 2)],
    )
    stage = Stage(scenario)
    for number in range(6):
        stage.run(drawn(f"go {number}", 10, 60))
        picker = drawn(f"picker {number}", 1, scenario.pickers)
        stage.local.engine.stop([f"picker_{picker:02d}"])
        stage.run(drawn(f"stand {number}", 5, 60))
        stage.local.engine.reset()
    stage.run_until(lambda: stage.local.engine.over or bool(stage.account.jam), 20_000)
    assert stage.account.jam == []
    assert stage.local.engine.violations() == []
    assert stage.world.delivered == rows
