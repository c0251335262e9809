"""The figures of a run, their course, the ideals beside them, and how a jam is told.

Beside the length of a harvest stand two ideals: its schedule, the length with the same policy on
free roads; and what is proven to be possible. A run is jammed after 600 s without progress; the
fixture `soon_jammed` makes that 120 s.
"""

import sys
import time
from functools import cache

import pytest
from stage import Stage, Standing, empty_orchard

from orchard.contract.agent import Action
from orchard.discrete.harvest import DiscreteHarvest
from orchard.field.geometry import EAST, Pose
from orchard.field.layout import lay_out
from orchard.field.scenario import NEAREST, People, Scenario
from orchard.plans.route import OneWay
from orchard.plans.routes import duration
from orchard.plans.steps import DriveTo, Face
from orchard.plans.two_way import TwoWay
from orchard.report import bounds, metrics
from orchard.report.bounds import Bounds, proven_seconds, schedule_seconds
from orchard.report.long_run import long_run
from orchard.report.losses import lost_seconds
from orchard.report.metrics import HarvestFigures, shares
from orchard.report.summary import as_table
from orchard.server.figures import RunFigures


def test_ten_minutes_of_nothing_are_a_jam_with_names():
    """The words of the jam say which robot waits for which."""
    idle = {f"carrier_0{i}": Standing() for i in (1, 2)}
    stage = Stage(empty_orchard(), **idle)
    took = stage.run_until(lambda: bool(stage.account.jam), 900)
    # The last thing that happens is that a picker comes to its waiting place, at 70 to 90 s.
    assert 600 + 70 < took < 600 + 90
    assert "picker_01 (waiting for an empty bin) waits for bin_01" in stage.account.jam
    assert any(
        line.startswith("bin_01 (full, calling) waits for a carrier") for line in stage.account.jam
    )


@pytest.mark.parametrize(
    ("stands", "x", "named"),
    [("worker_01", 38.75, "worker_01 ahead"), ("carrier_02", 41.0, "bin_04 of carrier_02 ahead")],
)
def test_a_jam_names_what_is_in_the_way(soon_jammed, stands, x, named):
    """A worker stands on the delivery road, or a carrier beside it whose bin reaches into it, 6 m
    north of the first row.
    """
    orchard = empty_orchard(people=People(workers=1, visitors=0), dispatch=NEAREST)
    stage = Stage(orchard, **{name: Standing() for name in ("worker_01", "carrier_02")})
    stage.put(stands, x, 17.0)
    stage.run_until(lambda: bool(stage.account.jam), 900)
    assert f"carrier_01 (bringing an empty bin to picker_01) waits for {named}" in stage.account.jam
    assert named in stage.account.message("run", {}).waits_for["carrier_01"]


def test_a_run_in_which_a_robot_works_is_not_jammed(soon_jammed):
    stage = Stage(empty_orchard(picking_speed=0.02))
    stage.run(140)
    assert stage.account.jam == []


def test_an_agent_that_is_silent_at_times_makes_no_progress():
    """A robot that stands, and whose process misses ticks, would keep a run from being jammed."""
    world = Stage(empty_orchard()).world
    figures = HarvestFigures()
    stands = Action(steps_done=3)
    figures.watch(world, {"carrier_01": stands})
    for action in (None, stands):
        world.tick += 1
        figures.watch(world, {"carrier_01": action})
    assert figures.progress_tick == 0
    figures.watch(world, {"carrier_01": Action(steps_done=4)})
    assert figures.progress_tick == 2


@pytest.mark.parametrize(("rows", "jams"), [(20, True), (100, False)])
def test_a_drive_home_of_more_than_ten_minutes_is_no_jam(rows, jams):
    """Robots that do nothing for 600 s jam. But a drive along 100 rows, 5.5 m apart, takes as
    long.
    """
    world = Stage(empty_orchard(rows=rows)).world
    world.tick = 6000
    assert HarvestFigures().jammed(world) == jams


@cache
def harvested(pickers, carriers):
    """Return a stage of 4 rows that is harvested to its end."""
    stage = Stage(empty_orchard(rows=4, pickers=pickers, carriers=carriers))
    stage.run_to_the_end()
    return stage


def test_the_figures_of_a_whole_harvest():
    stage = harvested(4, 4)
    figures = stage.account.figures()
    assert figures["rows_picked"] == 4
    assert figures["bins_delivered"] == 4
    # Each picker drives from x = -35.5 m, through its row, to where it parks.
    assert figures["distance_metres"]["picker"] == pytest.approx(4 * (OneWay.PARKED + 35.5))
    # An hour has 36,000 ticks.
    assert figures["bins_per_hour"] == pytest.approx(4 * 36_000 / stage.world.tick)
    assert len(stage.account.as_data()["harvest"]["waits"]) == 4
    assert figures["bins_per_hour"] <= figures["limit_bins_per_hour"]
    assert 0.5 < figures["carrier_utilisation"] <= 1.0


def test_the_duration_of_a_plan_is_its_drives_and_turns():
    plan = [DriveTo(x=10.0), Face("SOUTH"), DriveTo(y=-5.0, speed=0.5), Face("NORTH")]
    carrier = lay_out(Scenario()).machines["carrier"]
    # 10 m at 1 m/s, a quarter turn, 5 m at 0.5 m/s, and a half turn.
    assert duration(plan, Pose(0.0, 0.0, EAST), carrier) == pytest.approx(10 + 4 + 10 + 8)


# What differs from the default orchard, and the part that limits it.
BOTTLENECKS = [
    ({"rows": 10, "pickers": 10, "carriers": 7}, "carriers"),
    ({"rows": 10, "pickers": 2, "carriers": 20}, "pickers"),
    ({"rows": 20, "pickers": 20, "carriers": 40, "picking_speed": 0.02}, "pickers"),
]


@pytest.mark.parametrize(("changes", "bottleneck"), BOTTLENECKS)
def test_the_bottleneck_is_the_part_that_allows_least(changes, bottleneck):
    bounds = Bounds(lay_out(Scenario(**changes)))
    assert bounds.bottleneck == bottleneck
    assert bounds.bins_per_hour == pytest.approx(3600 * bounds.terms[bottleneck])


UNEQUAL_ROWS = {
    "picking": {"spread": {"distribution": "gamma", "cv": 0.3}},
    "dispatch": "predictive",
    "carriers": 8,
}
EARLY = {
    "pickers": 2,
    "carriers": 7,
    "row_length": 40.0,
    "picking_speed": 1.0,
    "route": "two-way",
    "rows_to_pickers": "balanced-ends",
}
# What differs from 4 rows, 4 pickers and 4 carriers, which pick at 0.1 m/s.
LIMITS = [
    # Pickers allow together what each allows.
    {"picking_speed": 0.05, "seed": 4, **UNEQUAL_ROWS},
    {"picking_speed": 0.05, "seed": 10, **UNEQUAL_ROWS},
    # A part-full last bin is no whole one.
    {"row_length": 40.0, "metres_per_bin": 200.0},
    {"metres_per_bin": 130.0},
    # Carriers leave when pickers drive into short rows.
    {"dispatch": "predictive", **EARLY},
]


@pytest.mark.parametrize("changes", LIMITS)
def test_the_long_run_comes_near_the_limit_and_keeps_to_it(changes):
    """A limit of more than 1/0.96 of the rate would leave out something that costs time."""
    values = {"rows": 4, "pickers": 4, "carriers": 4, "picking_speed": 0.1} | changes
    layout = lay_out(empty_orchard(**values))
    limit = Bounds(layout).bins_per_hour
    assert 0.96 * limit < long_run(layout).bins_per_hour <= limit


def test_only_drives_on_which_carriers_can_fail_cost_repairs():
    """On one-way roads carriers drive home along 54 m of queue, where none fails."""
    fails = {"carrying": {"failure": {"mean_between": 300.0, "mean_repair": 600.0}}}

    def cycle_seconds(**changes) -> float:
        return Bounds(lay_out(empty_orchard(rows=4, route="one-way", **changes))).cycle_seconds

    sound = cycle_seconds()
    failing = cycle_seconds(**fails)
    # A repair takes twice as long as the time between failures, so half of what repairs cost is
    # the time in which carriers can fail.
    assert 0.5 * sound < (failing - sound) / 2.0 < sound - 54.0


def test_an_unhindered_carrier_takes_its_closed_form_time():
    stage = Stage(empty_orchard(rows=3, pickers=3, carriers=1, dispatch=NEAREST))

    def has_job() -> bool:
        memory = stage.local.memories.get("carrier_01")
        return memory is not None and memory.job is not None

    def is_home() -> bool:
        """Whether the carrier is at the head of its line of the queue, north of all rows."""
        x, y, _ = stage.pose("carrier_01")
        return abs(x - stage.world.layout.queue.head) < 1e-6 and y > 24

    # The first bin calls when it is full, after 70 m at 1 m/s. `cycle_seconds` is a mean of all
    # rows, and the first row is up to 20 s off it.
    called = stage.run_until(has_job, 90)
    took = stage.run_until(lambda: stage.world.delivered == 1, 600)
    took += stage.run_until(is_home, 200)
    assert called > 70
    assert took == pytest.approx(Bounds(stage.world.layout).cycle_seconds, abs=20)


@pytest.mark.parametrize(
    ("pickers", "carriers", "traffic"), [(2, 1, 0.02), (4, 4, 0.15), (2, 6, 0.07)]
)
def test_a_harvest_takes_as_long_as_its_schedule_and_its_traffic(pickers, carriers, traffic):
    """`traffic`: by which share it may make the harvest longer, a bound that was measured once."""
    stage = harvested(pickers, carriers)
    scheduled = schedule_seconds(stage.world.layout)
    assert scheduled <= stage.seconds <= (1 + traffic) * scheduled


FAILS = {"picking_speed": 0.5, "picking": {"failure": {"mean_between": 60.0, "mean_repair": 300.0}}}
FROM_THE_EAST = {"rows_to_pickers": "balanced-ends", "dispatch": NEAREST}
VARIED = {"picking_speed": 0.2, "picking": {"spread": {"distribution": "lognormal", "cv": 0.2}}}


# What differs from 4 rows, 2 pickers and 2 carriers, and by which share traffic may make the
# harvest longer than its schedule.
SCHEDULES = [
    ({"row_length": 20.0, **FROM_THE_EAST}, 0.1),
    ({"row_length": 200.0, **FROM_THE_EAST}, 0.1),
    ({"carriers": 3, "route": "two-way", "rows_to_pickers": "balanced-ends"}, 0.05),
    ({"rows": 20, "pickers": 20, "route": "two-way", **VARIED}, 0.02),
    ({"seed": 1, **FAILS}, 0.05),
    ({"seed": 2, **FAILS}, 0.05),
]


@pytest.mark.parametrize(("changes", "traffic"), SCHEDULES)
def test_the_schedule_is_no_longer_than_the_harvest_with_traffic(changes, traffic):
    layout = lay_out(empty_orchard(**{"rows": 4, "pickers": 2, "carriers": 2} | changes))
    scheduled = schedule_seconds(layout)
    assert scheduled <= DiscreteHarvest(layout).run().seconds <= (1 + traffic) * scheduled


@pytest.mark.parametrize(
    "own",
    [
        {"agents": {"picker_01": "own_agents.Eastward"}},
        {"route": "examples.seams.signalled_route.SignalledRoute"},
    ],
)
def test_the_schedule_with_own_classes_is_the_built_in_one(own):
    values = {"rows": 4, "pickers": 2, "carriers": 2}
    with_own = schedule_seconds(lay_out(empty_orchard(**values, **own)))
    assert with_own == schedule_seconds(lay_out(empty_orchard(**values)))


def test_an_early_policy_shortens_waits_and_the_schedule():
    values = {"rows": 4, "pickers": 2, "carriers": 2}
    nearest = lay_out(empty_orchard(**values, dispatch="nearest"))
    early = lay_out(empty_orchard(**values, dispatch="predictive"))
    assert Bounds(early).wait_seconds < Bounds(nearest).wait_seconds
    assert Bounds(early).cycle_seconds == Bounds(nearest).cycle_seconds
    assert schedule_seconds(early) < schedule_seconds(nearest)


RTK = {"sensors": {"gnss": {"white": 0.01, "bias": 0.02}}}


@pytest.mark.parametrize(
    "changes",
    [
        {"dispatch": "nearest"},
        {"dispatch": "predictive"},
        {"people": People(workers=1, visitors=0)},
        RTK,
    ],
)
def test_what_a_harvest_lost_adds_up_to_its_length(changes):
    """A harvest of 700 s is longer than any ideal of this orchard.

    The part of people and animals is the rest. So it has what errors of sensors cost, too.
    """
    scenario = empty_orchard(rows=4, pickers=2, carriers=2, **changes)
    seconds = 700.0
    lost = lost_seconds(lay_out(scenario), seconds)
    assert sum(lost.values()) == pytest.approx(seconds, abs=0.3)
    assert (lost["people_and_animals"] > 0.0) == bool(
        scenario.people.workers or scenario.sensors.gnss.bias
    )
    assert min(lost["optimum"], lost["dispatch"], lost["traffic"]) > 0.0


def test_no_schedule_is_shorter_than_what_is_proven():
    """On free roads robots pass through each other, so a schedule may come out shorter than what is
    proven. Then what is proven counts, and nothing is lost to the policy.
    """
    lost = lost_seconds(
        lay_out(
            empty_orchard(rows=5, bins_per_row=2, carriers=5, route="two-way", dispatch="rolling")
        ),
        900.0,
    )
    assert lost["dispatch"] == 0.0
    assert sum(lost.values()) == pytest.approx(900.0, abs=0.3)


def test_what_batteries_cost_is_not_a_loss_to_the_policy():
    charged, endless = (
        empty_orchard(rows=8, pickers=2, carriers=1, carrying={"battery": battery})
        for battery in ({"hours": 0.2}, {})
    )
    lost, without = (lost_seconds(lay_out(scenario), 3000.0) for scenario in (charged, endless))
    assert max(lost["dispatch"], without["dispatch"]) < 60.0
    assert "charging" not in without
    assert lost["charging"] > 300.0
    assert 0.0 <= lost["traffic"] < 60.0
    assert sum(lost.values()) == pytest.approx(3000.0, abs=0.3)


def test_without_a_solver_the_parts_still_add_up(monkeypatch):
    layout = lay_out(empty_orchard(rows=5, pickers=2, carriers=2))
    with_solver = lost_seconds(layout, 700.0)
    # `_proven` keeps its answers. The function beneath it asks anew, and finds no solver.
    monkeypatch.setattr(bounds, "_proven", bounds._proven.__wrapped__)
    monkeypatch.setitem(sys.modules, "orchard.optimum.schedule", None)
    without = lost_seconds(layout, 700.0)
    assert without["schedule"] == pytest.approx(
        with_solver["optimum"] + with_solver["dispatch"], abs=0.1
    )
    assert without.keys() - with_solver.keys() == {"schedule"}
    assert proven_seconds(layout) is None


class NoTurns(TwoWay):
    """A route whose pickers ask for no places."""

    def cross(self, *_):
        return []


def test_nothing_is_proven_of_a_users_route_without_turns():
    """On such a route robots do not take turns at the places of the roads."""
    assert (
        proven_seconds(
            lay_out(empty_orchard(rows=5, pickers=2, carriers=2, route="test_metrics.NoTurns"))
        )
        is None
    )


def test_what_a_harvest_with_a_users_agent_lost_is_not_told():
    assert (
        lost_seconds(lay_out(empty_orchard(agents={"picker_01": "own_agents.Eastward"})), 700.0)
        == {}
    )


def test_the_course_of_a_harvest_ends_with_its_figures():
    summary = harvested(2, 1).account.summary()
    course = summary["history"]
    seconds = summary["sim_seconds"]
    assert course["bins_delivered"][-1] == 4
    assert course["bins_delivered"] == sorted(course["bins_delivered"])
    assert course["seconds"] == [*(10.0 * n for n in range(1, len(course["seconds"]))), seconds]
    waited = summary["state_seconds"]["picker"]
    assert course["pickers_waited_seconds"][-1] == pytest.approx(
        waited["waiting"] + waited.get("calling", 0.0)
    )
    assert course["carriers_busy_seconds"][-1] == pytest.approx(
        summary["carrier_utilisation"] * seconds, abs=0.1
    )
    assert all(0.0 <= share <= 1.01 for share in shares(course, "pickers_waited_seconds", 2))
    assert sum(shares(course, "carriers_busy_seconds", 1)) > 0
    assert summary["scenario"]["rows"] == 4
    assert not {"history", "scenario"} & set(as_table(summary).columns[0].cells)


def test_a_long_run_has_few_samples_also_when_resumed(monkeypatch):
    """A sample is taken every 10 s. Of more than 8 samples every second one is dropped: from then
    on one is taken every 20 s. The last one is that of the end.
    """
    monkeypatch.setattr(metrics, "MOST_SAMPLES", 8)
    stage = Stage(empty_orchard(rows=4, pickers=2, carriers=2))
    stage.run(100.0)
    assert stage.account.summary()["history"]["seconds"] == [20.0, 40.0, 60.0, 80.0, 100.0]
    stage.account = RunFigures(stage.local.engine, time.monotonic, stage.account.as_data())
    stage.run(25.0)
    assert stage.account.summary()["history"]["seconds"] == [
        20.0,
        40.0,
        60.0,
        80.0,
        100.0,
        120.0,
        125.0,
    ]
