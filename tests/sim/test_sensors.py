"""Sensors: errors of the size and the kind that the scenario sets, the same however a run is run;
and none without them.

A GNSS receiver has white errors, new at each tick, and a slow bias; both are deviations in m.
Odometry measures a longer or shorter way (`distance`, a share) and bends (`heading`, rad a metre).
"""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from code_blocks import block
from hypothesis import given, settings
from hypothesis import strategies as st
from local_runs import local_hash, played
from recorded_messages import KEYS, Run
from stage import Stage, empty_orchard

from orchard.behaviour.carrier import Job
from orchard.contract.agent import Observation, Scans
from orchard.field.geometry import Twist
from orchard.field.layout import lay_out
from orchard.field.problems import ScenarioError
from orchard.field.scenario import TIME_STEP, Scenario, parse, with_changes
from orchard.local import Local
from orchard.plans.estimate import GAIN, place_of
from orchard.plans.handling import SEARCH
from orchard.plans.steps import DriveTo, Fill, LeaveBin, TakeBin
from orchard.report.metrics import collisions
from orchard.sim.lookahead import CheckedHolds, IgnoredHolds
from orchard.sim.scan import observe
from orchard.sim.sensors import MOTION, Sensors, robots_of
from orchard.sim.world import NONE, World
from orchard.wire.codec import odometry_of
from orchard.wire.messages import Odometry, TickStateMessage, read

# The errors of a receiver with corrections, and of wheels. See docs/reference.md.
RTK = {"sensors.gnss.white": 0.01, "sensors.gnss.bias": 0.02}
DRIFT = {"sensors.odometry.distance": 0.02, "sensors.odometry.heading": 0.01}
TWO_WAY = {"route": "two-way", "tractor": True}
SEEDS = range(20)
# z and w of the orientation of a body that faces east.
FACES_EAST = (0.0, 1.0)


def erring(seed: int = 1, **changes: float) -> Scenario:
    """Return an orchard with many robots and these errors of sensors."""
    return with_changes(empty_orchard(seed=seed, carriers=10), **changes)


def world_of(scenario: Scenario) -> tuple[World, Scans]:
    """Return the world of a scenario at its start, and scans without a beam."""
    world = World(lay_out(scenario))
    return world, Scans(np.zeros(0, dtype=np.float32), [0] * (len(world.pose) + 1))


def errors(scenario: Scenario, ticks: Sequence[int]) -> np.ndarray:
    """Return the errors of x and y of standing robots at some ticks, m, (ticks, robots, 2)."""
    world, scans = world_of(scenario)
    sensors = Sensors(world)
    robots = list(robots_of(world.layout).values())
    errors_of_ticks = []
    while len(errors_of_ticks) < len(ticks):
        if world.tick in ticks:
            truth = observe(world, scans)
            differences = sensors.measured(truth).states - truth.states
            errors_of_ticks.append(differences[robots, :2])
        world.tick += 1
        sensors.advance()
    return np.array(errors_of_ticks)


def over_seeds(*ticks: int, **changes: float) -> np.ndarray:
    """Return the same for all SEEDS, (seeds, ticks, robots, 2)."""
    return np.array([errors(erring(seed, **changes), ticks) for seed in SEEDS])


@given(st.integers(0, 2**31), st.floats(1.0, 86400.0))
@settings(max_examples=3)
def test_sensors_without_errors_measure_the_truth(seed, bias_time):
    plain = empty_orchard(seed=seed)
    exact = played(with_changes(plain, **{"sensors.gnss.bias_time": bias_time}), 60)
    assert exact.engine.hash == local_hash(plain, 60)
    seen = exact.engine.observe()
    truth = exact.engine.truth()
    reckoned = exact.engine.odometry()
    assert seen.states.tobytes() == truth.states.tobytes()
    assert reckoned.states.tobytes() == truth.states.tobytes()
    assert seen["picker_01"].accuracy == 0.0


@pytest.mark.parametrize(("white", "bias"), [(0.02, 0.0), (0.0, 0.03), (0.01, 0.02)])
def test_errors_of_positions_have_the_set_deviation(white, bias):
    """The 480 errors of one tick are independent, so their deviation is right to some 3 %."""
    measured = over_seeds(0, **{"sensors.gnss.white": white, "sensors.gnss.bias": bias})
    deviation = math.hypot(white, bias)
    assert measured.std() == pytest.approx(deviation, rel=0.1)
    # Three deviations of a mean of so many errors.
    assert abs(measured.mean()) < 3 * deviation / math.sqrt(measured.size)

    # The errors of x and y are independent, and so are those of two robots.
    of_x = measured[..., 0].ravel()
    of_y = measured[..., 1].ravel()
    assert abs(np.corrcoef(of_x, of_y)[0, 1]) < 0.2
    of_first = measured[:, 0, 0].ravel()
    of_second = measured[:, 0, 1].ravel()
    assert abs(np.corrcoef(of_first, of_second)[0, 1]) < 0.3


def test_white_errors_are_new_and_slow_ones_fade():
    """A white error is new at each tick. A slow one is forgotten within its time."""
    slow = over_seeds(0, 5, 20, 40, **{"sensors.gnss.bias": 0.03, "sensors.gnss.bias_time": 2.0})
    white = over_seeds(0, 1, **{"sensors.gnss.white": 0.05})
    assert abs(correlation(white, 1)) < 0.15
    for i, ticks in enumerate((5, 20, 40), start=1):
        assert correlation(slow, i) == pytest.approx(math.exp(-ticks * TIME_STEP / 2.0), abs=0.12)
    # It is as large later as at the beginning.
    assert slow[:, 3].std() == pytest.approx(0.03, rel=0.1)


def correlation(measured: np.ndarray, later: int) -> float:
    """Return the correlation of the errors at the first tick and at a later one."""
    return float(np.corrcoef(measured[:, 0].ravel(), measured[:, later].ravel())[0, 1])


def test_only_robots_have_receivers_and_each_knows_its_accuracy():
    world, scans = world_of(with_changes(Scenario(rows=3), **RTK))
    truth = observe(world, scans)
    seen = Sensors(world).measured(truth)
    erring_bodies = set()
    for name, i in seen.names.items():
        if seen.states[i].tobytes() != truth.states[i].tobytes():
            erring_bodies.add(name)
    assert erring_bodies == {"picker_01", "picker_02", "carrier_01", "carrier_02", "tractor_01"}
    assert set(seen.accuracies) == erring_bodies
    assert set(seen.accuracies.values()) == {math.sqrt(0.01**2 + 0.02**2)}


def test_a_bar_measures_without_errors():
    """A robot sees its bin as far away as it is.

    The bin has no receiver, and sees the truth.
    """
    world, scans = world_of(erring(**RTK))
    truth = observe(world, scans)
    seen = Sensors(world).measured(truth)
    error = seen.states[seen.names["carrier_01"], :2] - truth.states[seen.names["carrier_01"], :2]
    bin_ = seen.hitches["carrier_01"]
    true_bin = truth.hitches["carrier_01"]
    assert (bin_.x - true_bin.x, bin_.y - true_bin.y) == pytest.approx(tuple(error), abs=1e-12)
    assert seen.hitches[bin_.name] == truth.hitches[bin_.name]


def test_odometry_drifts_by_its_constants():
    """A robot drives 50 m straight on: its odometry is longer or shorter by a share, and bends by
    an angle for each metre. While it stands, its odometry stands.
    """
    world, scans = world_of(
        erring(**{"sensors.odometry.distance": 0.02, "sensors.odometry.heading": 0.001})
    )
    sensors = Sensors(world)
    i = world.index["picker_01"]
    start = world.pose[i].copy()
    world.twist[i] = 1.0, 0.0, 0.0
    ahead, _, bend = sensors.measured(observe(world, scans)).states[i, MOTION].tolist()
    for _ in range(500):
        sensors.advance()
    x, y, yaw = (world.reckoned[i] - start).tolist()
    assert ahead != 1.0
    assert bend != 0.0
    assert yaw == pytest.approx(50.0 * bend)
    # The end of an arc of this radius and angle.
    assert (x, y) == pytest.approx(
        (ahead / bend * math.sin(yaw), ahead / bend * (1 - math.cos(yaw))), rel=1e-3
    )
    world.twist[i] = 0.0
    before = world.reckoned.copy()
    sensors.advance()
    assert (world.reckoned == before).all()
    velocity = sensors.measured(observe(world, scans)).states[i, MOTION]
    assert velocity.tolist() == [0.0, 0.0, 0.0]


def test_odometry_has_the_deviation_that_the_scenario_sets():
    velocities = []
    for seed in SEEDS:
        world, scans = world_of(erring(seed, **DRIFT))
        robots = list(robots_of(world.layout).values())
        world.twist[robots] = 1.0, 0.0, 0.0
        states = Sensors(world).measured(observe(world, scans)).states
        velocities.append(states[robots, MOTION])
    ahead, _, bend = np.concatenate(velocities).T
    assert (ahead - 1.0).std() == pytest.approx(0.02, rel=0.2)
    assert bend.std() == pytest.approx(0.01, rel=0.2)


def test_errors_are_the_same_without_holds_and_after_a_resume(caplog):
    scenario = with_changes(Scenario(rows=3), **RTK, **DRIFT)
    wanted = local_hash(scenario, 200)
    before = played(Local(scenario, holds=IgnoredHolds), 133)
    assert played(Local.resume(before.snapshot(), holds=IgnoredHolds), 200).engine.hash == wanted
    assert local_hash(scenario, 200, holds=CheckedHolds) == wanted
    assert not caplog.records
    assert local_hash(with_changes(scenario, seed=2), 200) != wanted


def test_the_wire_has_the_measured_pose_and_the_truth():
    """Processes send what `Local` has; the picture shows the truth."""
    scenario = with_changes(Scenario(rows=3), **RTK, **DRIFT)
    local = played(scenario, 30)
    run = Run(scenario, "run1", 31)
    assert run.to_the_end().hash == local_hash(scenario, 31)
    views = {
        "pose": local.engine.observe(),
        "truth": local.engine.truth(),
        "odometry": local.engine.odometry(),
    }
    for what, view in views.items():
        heard = [
            read(payload, Odometry)
            for key, payload in run.net.sent
            if key == KEYS.of(what, "picker_01")
        ]
        assert heard[30] == odometry_of("run1", view["picker_01"])
    xs = {what: view["picker_01"].x for what, view in views.items()}
    assert len(set(xs.values())) == 3
    assert max(xs.values()) - min(xs.values()) < 0.5
    pictures = [
        read(payload, TickStateMessage)
        for key, payload in run.net.sent
        if key == KEYS.of("picture")
    ]
    (picture,) = [picture for picture in pictures if picture.tick == 30]
    assert (
        np.frombuffer(picture.poses).reshape(-1, 3)[views["truth"].names["picker_01"], 0]
        == xs["truth"]
    )


def test_a_driving_robot_filters_errors_by_odometry():
    """Of white errors it keeps what any exponential smoothing keeps: see GAIN."""
    chance = np.random.default_rng(1)
    white = 0.05
    place = None
    found = []
    for tick in range(2000):
        true_x = 0.1 * tick
        x = true_x + chance.normal(0.0, white)
        y = chance.normal(0.0, white)
        seen = Observation("picker_01", tick, x, y, FACES_EAST, Twist(1.0), np.zeros(180))
        place = place_of(seen, place)
        found.append((place.x - true_x, place.y))
    # The first errors hang on the first position.
    settled = found[100:]
    assert np.std(settled) == pytest.approx(white * math.sqrt(GAIN / (2 - GAIN)), rel=0.1)


def test_a_robot_learns_by_which_share_its_odometry_is_wrong():
    """It drives at 1 m/s, and its odometry measures 1.3 m/s.

    If it did not learn, its estimate would gain 0.03 m in each tick, of which the position takes
    back a tenth of what it is ahead (GAIN). So it would stay 0.27 m ahead, and pass gates.
    """
    chance = np.random.default_rng(1)
    place = None
    for tick in range(200):
        x = 0.1 * tick + chance.normal(0.0, 0.02)
        seen = Observation("picker_01", tick, x, 0.0, FACES_EAST, Twist(1.3), np.zeros(180))
        place = place_of(seen, place)
    assert place.share == pytest.approx(1 / 1.3, abs=0.02)
    # Where it is at the last tick, 199.
    assert place.x == pytest.approx(19.9, abs=0.03)


def finishes(scenario: Scenario) -> None:
    """Harvest to the end without a collision."""
    local = Local(scenario)
    while not local.engine.over and local.engine.tick < 6_000 * scenario.rows:
        local.tick()
    assert local.engine.over
    assert local.engine.violations() == []
    assert collisions(local.engine.world) == 0


def test_our_agents_finish_a_harvest_with_rtk():
    finishes(with_changes(parse(block("docs/reference.md", "rtk")), route="two-way"))


# Harvests in which that was so once, found by random ones.
LIMITS = [
    {
        "rows": 3,
        "row_length": 40.0,
        "carriers": 1,
        "seed": 440002,
        "dispatch": "predictive-farthest",
        **TWO_WAY,
    },
    {"rows": 7, "row_length": 30.0, "carriers": 4, "seed": 250282},
]


@pytest.mark.parametrize("changes", LIMITS)
def test_a_harvest_finishes_with_odometry_at_its_limits(changes):
    """Carriers once passed gates without their places, and one turned into a bin many times."""
    sensors = {
        "gnss": {"white": 0.02, "bias": 0.02},
        "odometry": {"distance": 0.1, "heading": 0.05},
    }
    finishes(empty_orchard(sensors=sensors, **changes))


@pytest.mark.parametrize(
    ("what", "most"), [("gnss.white", 0.1), ("gnss.bias", 0.03), ("odometry.distance", 0.1)]
)
def test_errors_that_robots_cannot_master_are_refused(what, most):
    with pytest.raises(
        ScenarioError, match=f"sensors.{what} = .*: must be a number from 0.0 to {most}"
    ):
        with_changes(Scenario(), **{f"sensors.{what}": most + 0.01})


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(1, 6))
@pytest.mark.parametrize(
    ("route", "dispatch"),
    [("one-way", "predictive"), ("two-way", "nearest"), ("one-way", "longest-waiting")],
)
def test_our_agents_finish_with_rtk_on_each_route(route, dispatch, seed):
    finishes(with_changes(Scenario(route=route, dispatch=dispatch, seed=seed), **RTK, **DRIFT))


def test_a_picker_short_of_the_end_drives_on_until_full():
    """It takes itself to be at the row's end 8 cm before it, and its bin lacks so much.

    It begins 1.5 m before the end, with all before that in its bin.
    """
    stage = Stage(with_changes(erring(**RTK), dispatch="nearest"))
    lane = stage.world.layout.lane(1)
    picked = lane.length - 1.5
    stage.put("picker_01", lane.west + picked, lane.y)
    stage.world.row_ends[0, 0] = picked
    stage.world.fill[stage.world.index["bin_01"]] = picked
    short = DriveTo(x=lane.east - 0.08)
    stage.give("picker_01", [short, Fill(most=0.3, fill=lane.length), LeaveBin()])
    stage.run_until(lambda: stage.bin_of("picker_01") == "", 30.0)
    assert stage.is_full("bin_01")


@pytest.mark.parametrize(("x", "y"), [(0.13, 0.0), (-0.12, 0.05), (0.0, 0.13), (0.1, -0.2)])
def test_a_robot_searches_for_a_coupling_point_that_it_misses(x, y):
    """The bin is moved by `x`, `y`, m, from the place where the robot's plan has it."""
    stage = Stage(erring(**{"sensors.gnss.white": 0.005}))
    name = stage.bin_of("carrier_01")
    bin_ = stage.world.index[name]
    stage.world.coupled[[stage.world.index["carrier_01"], bin_]] = NONE
    stage.world.pose[bin_, :2] += x, y
    # The carrier has a job, so that no bin calls it away.
    stage.give("carrier_01", [TakeBin(bin=name)], job=Job(name, 1, "east", "picker_01"))
    stage.run_until(lambda: stage.bin_of("carrier_01") == name, 60.0)
    assert stage.happened("deed refused", "carrier_01")


def test_a_robot_that_has_tried_all_places_begins_again():
    stage = Stage(erring(**{"sensors.gnss.white": 0.005}))
    name = stage.bin_of("carrier_01")
    stage.world.coupled[[stage.world.index["carrier_01"], stage.world.index[name]]] = NONE
    job = Job(name, 1, "east", "picker_01")
    # It is about to couple at the last place of its search, 1.5 m ahead of where it can.
    stage.give(
        "carrier_01",
        [TakeBin(bin=name, tried=len(SEARCH) - 1, at=stage.pose("carrier_01")[:2])],
        job=job,
    )
    stage.world.pose[stage.world.index["carrier_01"], 0] += 1.5
    stage.run_until(lambda: stage.bin_of("carrier_01") == name, 60.0)
