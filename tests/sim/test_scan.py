"""What bodies observe: the laser is exact, does not see weeds or its own body, and has repeatable
noise.

Ranges are compared with those of a slow raycaster (tests/support/raycaster.py). A wall is (x, y,
half length, half width), m. A laser that looks forward has 180 beams, pi / 179 apart, from the
right (0) to the left (179). It is at the front edge of its body: 1.25 m ahead of the centre of a
picker, 0.275 m of a worker. A bin or a weed looks around with 60 beams, from straight ahead on,
counter-clockwise.
"""

import math

import numpy as np
import pytest
from bare_world import picker_with_bin
from hypothesis import given, settings
from hypothesis import strategies as st
from raycaster import bounds_of, world_of

from orchard.field.geometry import NORTH, Pose, Twist
from orchard.field.kinds import KINDS, LASER_RANGE
from orchard.field.layout import lay_out
from orchard.field.scenario import LaserSettings, Scenario
from orchard.sim.scan import Scanner, observe
from orchard.sim.world import NONE, World

# m; a beam that passes a corner this near may hit or miss it.
EXACT = 1e-9
# Of the beams of a laser that looks forward, the first left of straight ahead; 89 is the first
# right of it.
AHEAD = 90

coordinates = st.one_of(st.integers(-12, 12).map(float), st.floats(-12.0, 12.0))
yaws = st.one_of(
    st.integers(-3, 4).map(lambda quarter: quarter * math.pi / 2), st.floats(-math.pi, math.pi)
)
poses = st.builds(Pose, coordinates, coordinates, yaws)
field_poses = st.builds(Pose, st.floats(-55.0, 55.0), st.floats(-45.0, 40.0), yaws)
bodies = st.lists(st.tuples(st.sampled_from(sorted(KINDS)), poses), min_size=1, max_size=7)
sizes = st.one_of(st.just(0.25), st.floats(0.1, 6.0))
walls = st.lists(st.tuples(coordinates, coordinates, sizes, sizes), min_size=1, max_size=5)


def scan_of(world, i: int = 0) -> np.ndarray:
    return Scanner(world).scan(world)[i]


def assert_agrees_with_raycaster(world) -> None:
    """Assert that each range is right to EXACT, for boxes whose places are right to EXACT."""
    ends = np.cumsum([KINDS[start.kind].laser.beams for start in world.layout.starts])
    for i, ranges in enumerate(np.split(Scanner(world).ranges(world), ends[:-1])):
        least, most = bounds_of(world, i, EXACT)
        wrong = ~((least <= ranges) & (ranges <= most))
        assert not wrong.any(), (
            world.layout.names[i],
            np.flatnonzero(wrong),
            least[wrong],
            ranges[wrong],
            most[wrong],
        )


@given(bodies, walls)
def test_every_beam_is_exact_against_any_boxes(bodies, walls):
    assert_agrees_with_raycaster(world_of(*bodies, walls=walls))


@settings(max_examples=25)
@given(st.lists(st.tuples(st.sampled_from(sorted(KINDS)), field_poses), min_size=1, max_size=6))
def test_every_beam_is_exact_anywhere(bodies):
    """The bodies stand anywhere in an orchard, or just outside."""
    assert_agrees_with_raycaster(world_of(*bodies, walls=lay_out(Scenario()).walls.tolist()))


def test_the_start_is_seen_as_the_raycaster_sees_it():
    assert_agrees_with_raycaster(World(lay_out(Scenario(rows=6, pickers=3, carriers=14))))


def test_a_forward_laser_has_180_beams_and_a_bin_60():
    world = world_of(("picker", Pose(0, 0, 0)), ("bin", Pose(-5, 0, 0)), ("weed", Pose(5, 5, 0)))
    scans = Scanner(world).scan(world)
    assert [len(scan) for scan in scans] == [180, 60, 60]
    assert all(scan.dtype == np.float32 for scan in scans)


def test_a_fence_3_m_ahead_is_seen_at_3_m():
    """The range counts from the front edge, and a beam that is askew measures more."""
    fence = (1.25 + 3.0 + 0.5, 0.0, 0.5, 20.0)
    world = world_of(("picker", Pose(0, 0, 0)), walls=[fence])
    scan = scan_of(world)
    for beam in (30, 89, 90, 150):
        angle = -math.pi / 2 + beam * math.pi / 179
        assert scan[beam] == pytest.approx(3.0 / math.cos(angle), abs=1e-6)


def test_ranges_count_counter_clockwise_from_the_right():
    # The worker faces north, and the wall is east of it.
    world = world_of(("worker", Pose(0, 0, math.pi / 2)), walls=[(3.0, 0.275, 1.0, 1.0)])
    assert scan_of(world)[0] == pytest.approx(2.0, abs=1e-6)
    assert np.isinf(scan_of(world)[90:]).all()


def test_a_bin_looks_all_around():
    world = world_of(
        ("bin", Pose(0, 0, 0)),
        walls=[(x, y, 0.5, 0.5) for x, y in ((3, 0), (0, 4), (-5, 0), (0, -6))],
    )
    assert scan_of(world)[[0, 15, 30, 45]] == pytest.approx([2.5, 3.5, 4.5, 5.5], abs=1e-6)


def test_no_body_sees_a_weed_and_a_weed_sees_all_bodies():
    world = world_of(("worker", Pose(0, 0, 0)), ("weed", Pose(2, 0, 0)))
    worker, weed = Scanner(world).scan(world)
    assert np.isinf(worker).all()
    assert weed[30] == pytest.approx(2.0 - 0.275, abs=1e-6)


def test_a_flattened_weed_sees_nothing():
    world = world_of(("worker", Pose(0, 0, 0)), ("weed", Pose(2, 0, 0)))
    world.alive[1] = False
    assert np.isinf(scan_of(world, 1)).all()


def test_a_laser_that_touches_a_box_measures_0():
    touching = world_of(("worker", Pose(0, 0, 0)), walls=[(0.275 + 1.0, 0, 1.0, 1.0)])
    assert scan_of(touching)[AHEAD] == 0.0
    inside = world_of(("worker", Pose(0, 0, 0)), walls=[(0.275, 0, 1.0, 2.0)])
    assert scan_of(inside)[0] == pytest.approx(2.0, abs=1e-6)
    # The beam is half an increment, of pi / 179, left of straight ahead.
    assert scan_of(inside)[AHEAD] == pytest.approx(1.0 / math.cos(math.pi / 358), abs=1e-6)


def test_a_scan_that_was_kept_does_not_change():
    world = world_of(("worker", Pose(0, 0, 0)), walls=[(5.0, 0, 1.0, 1.0)])
    scanner = Scanner(world)
    kept = scanner.scan(world)[0]
    before = kept.copy()
    world.pose[0, 0] = 1.0
    assert not np.array_equal(scanner.scan(world)[0], before)
    assert np.array_equal(kept, before)


def noisy(seed: int = 1, noise: float = 0.02, tick: int = 0):
    """Return the scans of two workers, with noise."""
    workers = ("worker", Pose(0, 0, 0)), ("worker", Pose(0, 1.5, 0))
    world = world_of(
        *workers, walls=[(8.0, 0, 1.0, 90.0)], seed=seed, laser=LaserSettings(noise=noise)
    )
    world.tick = tick
    return Scanner(world).scan(world)


def test_noise_follows_from_seed_name_and_tick():
    """With the same three the noise is the same; with another one of them it differs."""
    assert np.array_equal(noisy()[0], noisy()[0])
    for other in (noisy(seed=2)[0], noisy(tick=1)[0], noisy()[1]):
        assert (other[60:120] != noisy()[0][60:120]).all()


def test_noise_has_the_set_deviation_and_no_bias():
    """The deviation is 2 cm. The mean of more than 3,000 errors is then right to 0.04 cm."""
    clean = noisy(noise=0.0)[0]
    # Noise of these beams is not cut off at the range of 10 m.
    sure = clean < 9.0
    errors = np.concatenate([noisy(tick=tick)[0][sure] - clean[sure] for tick in range(40)])
    assert len(errors) > 3000
    assert abs(errors.mean()) < 0.002
    assert errors.std() == pytest.approx(0.02, rel=0.05)
    # The share of a normal distribution that is within its deviation.
    assert np.mean(np.abs(errors) < 0.02) == pytest.approx(0.683, abs=0.03)


def test_noise_stays_within_the_range():
    """A beam without a return gets no noise."""
    clean = noisy(noise=0.0)[0]
    for tick in range(20):
        scan = noisy(noise=0.02, tick=tick)[0]
        assert np.isinf(scan[np.isinf(clean)]).all()
        assert np.isfinite(scan[clean < LASER_RANGE - 0.2]).all()
        assert (scan[np.isfinite(scan)] <= LASER_RANGE).all()
        assert (scan >= 0.0).all()


def test_a_range_beyond_ten_metres_is_no_return():
    """A wall is 9.99 m ahead, and noise is 2 cm: so some ranges would be longer than 10 m."""
    scans = [
        scan_of(
            world_of(
                ("picker", Pose(0, 0, 0)),
                walls=[(1.25 + 9.99 + 1.0, 0, 1.0, 30.0)],
                seed=seed,
                laser=LaserSettings(noise=0.02),
            )
        )
        for seed in range(20)
    ]
    ahead = np.array([scan[88:92] for scan in scans])
    assert np.isinf(ahead).any()
    assert np.isfinite(ahead).any()
    assert not (ahead == LASER_RANGE).any(), "a range that is too long is not cut to 10 m"


def test_each_body_is_told_its_place_and_its_hitch():
    with_bin = picker_with_bin(yaw=NORTH)
    with_bin.world.fill[1] = 70.0
    with_bin.drive(1, picker_01=Twist(0.3))
    scans = Scanner(with_bin.world).scan(with_bin.world)
    seen = observe(with_bin.world, scans)
    picker = seen["picker_01"]
    bin_ = seen["bin_02"]
    assert picker.pose == pytest.approx(with_bin.pose("picker_01"), abs=1e-15)
    assert picker.tick == 1
    assert picker.twist == (0.3, 0.0, 0.0)
    assert not picker.full
    assert picker.hitch.name == "bin_02"
    assert picker.hitch.scan.tobytes() == scans[1].tobytes()
    assert picker.scan.tobytes() == scans[0].tobytes()
    assert picker.hitch.pose == pytest.approx(with_bin.pose("bin_02"), abs=1e-15)
    assert bin_.hitch.name == "picker_01"
    assert bin_.hitch.scan is None
    assert bin_.hitch.twist == (0.3, 0.0, 0.0)
    assert bin_.fill == 70.0
    assert bin_.full
    with_bin.world.coupled[:] = NONE
    assert observe(with_bin.world, scans)["picker_01"].hitch is None
