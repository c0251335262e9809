"""The traffic plan: each place where a robot or a bin may stand is clear of each drive and turn
there, and turns are of each other.

`walks_of` (tests/support/walks.py) drives each plan without an obstacle. It gives the rectangles in
which robots and bins may stand, those that a drive must find free, and the turns: each an `Area`,
(x, y, half its size in x, half its size in y, ...), m.
"""

from collections.abc import Iterable
from itertools import product

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from made_surveys import Row, orchard_of, rows
from stage import Stage, Standing, empty_orchard
from walks import Area, outline, train, walks_of

from orchard.behaviour.tractor import EAST_END, WEST_END
from orchard.field.geometry import EAST, HEADINGS, SOUTH, WEST, angle_between
from orchard.field.kinds import KINDS
from orchard.field.layout import Layout, lay_out
from orchard.field.queue import MOST_CARRIERS, ONE_WAY, TWO_WAY, queue_of
from orchard.field.rows import RULES
from orchard.field.scenario import NEAREST, Scenario
from orchard.field.survey import CLOSEST
from orchard.plans.route import OneWay
from orchard.plans.sense import SIDE_MARGIN, TURN_MARGIN

COUPLING = OneWay.COUPLING
D_ROAD = OneWay.D_ROAD
F_ROAD = OneWay.F_ROAD
FULL_BIN = OneWay.FULL_BIN
STOP = OneWay.STOP
WAITING = OneWay.WAITING
# A rule by which all pickers begin in the east.
FROM_THE_EAST = "examples.seams.from_the_east.from_the_east"
# m, at the narrowest rows.
PITCH = 5.5
# rad.
QUARTER = np.pi / 2


def swept(shape: np.ndarray, x: float, y: float, start: float, turn: float) -> np.ndarray:
    """Return all points that a shape passes while it turns on the spot at (x, y), (181 k, 2) m.

    `shape`: points of its outline in the robot's frame, (k, 2) m. `start`: its yaw, rad; `turn`: by
    how much it turns, at most pi. So a step of 180 is a degree at most.
    """
    angles = start + np.linspace(0.0, turn, 181)
    cosines = np.cos(angles)[:, None]
    sines = np.sin(angles)[:, None]
    ahead = shape[:, 0]
    aside = shape[:, 1]
    swept_x = x + cosines * ahead - sines * aside
    swept_y = y + sines * ahead + cosines * aside
    return np.stack([swept_x, swept_y], axis=-1).reshape(-1, 2)


def gap(points: np.ndarray, others: np.ndarray) -> float:
    """Return the least distance between points of two sets, each (n, 2) m.

    The distance between every twentieth point of both is a bound from above. Points that are
    further from all others than this bound need not be compared.
    """
    most = least(points[::20], others[::20])
    return least(facing(points, others, most), facing(others, points, most))


def facing(points: np.ndarray, others: np.ndarray, most: float) -> np.ndarray:
    """Return those points that may be as near as `most`, m, to one of the others.

    They are near the circle around all others.
    """
    centre = (others.min(axis=0) + others.max(axis=0)) / 2
    radius = np.hypot(*(others - centre).T).max()
    return points[np.hypot(*(points - centre).T) <= radius + most]


def least(points: np.ndarray, others: np.ndarray) -> float:
    """Return the least distance between points of two sets, m, by comparing all of them."""
    return float(min(np.hypot(*(others - point).T).min() for point in points))


def test_what_turns_sweep_is_what_the_plan_says():
    """A robot, or a robot with its bin, sweeps a circle of this radius, m, where it turns.

    The figures of `OneWay` and docs/traffic.md are derived from these.
    """
    for shape, radius in (
        (outline("carrier"), 1.17),
        (train("carrier"), 2.45),
        (train("picker"), 2.80),
    ):
        assert np.hypot(*shape.T).max() == pytest.approx(radius, abs=0.005)


def test_a_carriers_turn_stays_clear_of_the_pickers_exit_turn():
    """The carrier turns at its stop, and the next picker, at the narrowest rows, leaves its row.

    28 cm are between what they sweep.
    """
    carrier = swept(outline("carrier"), D_ROAD, -STOP, SOUTH, -QUARTER)
    picker = swept(train("picker"), WAITING, -PITCH, EAST, -QUARTER)
    assert gap(carrier, picker) == pytest.approx(0.28, abs=0.01)


# m between a turn on the loop and the full or the empty bin, at least.
LEAST_TO_BINS = 0.22


@pytest.mark.parametrize(
    ("x", "y", "start"),
    [(D_ROAD, -STOP, SOUTH), (COUPLING, -STOP, WEST), (COUPLING, 0.0, QUARTER)],
    ids=["at its stop", "beside the full bin", "before the full bin"],
)
def test_a_carriers_turns_on_its_loop_stay_clear_of_both_bins(x, y, start):
    """The lane is at y = 0. The full bin stands in its mouth, and the empty one on the delivery
    road.
    """
    turn = swept(outline("carrier"), x, y, start, -QUARTER)
    bins = [outline("bin", at) for at in (FULL_BIN, D_ROAD)]
    assert min(gap(turn, points) for points in bins) >= LEAST_TO_BINS


def test_a_carrier_with_the_full_bin_stays_off_deliveries():
    """It turns on the full-bin road, and stays 10 cm off a carrier on the delivery road, which is
    1.5 m wide.
    """
    turn = swept(train("carrier"), F_ROAD, 0.0, EAST, -QUARTER)
    assert turn[:, 1].max() < 2.8, "no robot waits nearer than that"
    assert turn[:, 0].max() < D_ROAD - 0.75 - 0.1


# m between a robot or bin and what a drive needs free: far more than a range of the laser can be
# off, which is a float32, exact to a micrometre.
LEAST_GAP = 0.01
# m: coordinates that differ by less count as the same.
SAME = 1e-6


def may_meet(drive: Area, stand: Area) -> bool:
    """Whether a robot may drive in `drive` while another robot or bin is in `stand`.

    They never meet if both need one place on the roads, or if the order of the work keeps them
    apart. Left out, too, are the bins and the picker to which a carrier is blind because it works
    for them, and a carrier that another one follows on its road: lasers keep their distance.
    """
    if drive.robot == stand.robot or drive.places & stand.places or follows(drive, stand):
        return False
    for box in drive.blind_to:
        if abs(stand.x - box.x) < SAME and abs(stand.y - box.y) < SAME:
            return False
    if is_of_picker(drive):
        return not is_before(drive, stand)
    return not (is_of_picker(stand) and is_before(stand, drive))


def is_of_picker(area: Area) -> bool:
    """Whether it is an area of a picker, and not of a carrier that works for one."""
    return area.robot == area.picker


def is_before(of_picker: Area, of_job: Area) -> bool:
    """Whether a picker is there before the job of a carrier for that picker begins."""
    return of_picker.picker == of_job.picker and of_picker.stage < of_job.stage


def follows(drive: Area, stand: Area) -> bool:
    """Whether the other carrier is ahead on the same road, straight on or round the next corner."""
    # A bin that was left has no heading.
    are_robots = bool(stand.heading) and bool(drive.heading)
    if not are_robots or is_of_picker(drive) or is_of_picker(stand):
        return False
    end_x, end_y = drive.end
    if is_along_x(stand):
        return abs(stand.y - end_y) < SAME
    return abs(stand.x - end_x) < SAME


def is_along_x(area: Area) -> bool:
    """Whether a robot stands there along a road that leads east and west."""
    return area.heading in ("EAST", "WEST")


def too_near(layout: Layout) -> list[tuple[Area, Area]]:
    """Return each drive with each robot or bin that may stand nearer to it than LEAST_GAP."""
    walks = list(walks_of(layout))
    drives = [area for walk in walks for area in walk.drives]
    stands = [area for walk in walks for area in walk.stands]
    # (drives, 1, 4) and (1, stands, 4): x, y and half the size in x and y, m.
    driven = np.array([area[:4] for area in drives])[:, None]
    standing = np.array([area[:4] for area in stands])[None]
    # (drives, stands, 2): the gap in x and in y; negative where they overlap.
    apart = np.abs(driven[..., :2] - standing[..., :2]) - driven[..., 2:] - standing[..., 2:]
    near = np.argwhere((apart < LEAST_GAP).all(axis=-1))
    return [(drives[i], stands[j]) for i, j in near if may_meet(drives[i], stands[j])]


def is_on_its_road(turn: Area, heading: str, stand: Area) -> bool:
    """Whether the laser of a robot that turns keeps it off another robot on its road.

    The other robot stands on the road from which the first comes, or on the one to which it turns.
    On the latter the first sees it only if it is in the way of the drive up to the turn: what is
    beside the first is behind its laser. `heading`: the one to which it turns.
    """
    dx = abs(stand.x - turn.x)
    dy = abs(stand.y - turn.y)
    if is_along_x(stand):
        aside = dy
        ahead = dx - stand.half_x
    else:
        aside = dx
        ahead = dy - stand.half_y
    is_in_the_way = ahead < KINDS["carrier"].width / 2 + SIDE_MARGIN
    is_seen = stand.heading == turn.heading or is_in_the_way
    return stand.heading in (turn.heading, heading) and aside < SAME and is_seen


# m from the centre of a robot that turns to that of a robot which it may sweep: no pair of them is
# longer.
REACH = 4.5
# m: outlines are points that are 2 cm apart, so a corner may lie between two of them.
LEAST_APART = TURN_MARGIN - 0.02


def in_a_turn(layout: Layout) -> list[tuple[Area, Area]]:
    """Return each turn with each robot or bin that may stand in what it sweeps."""
    walks = list(walks_of(layout))
    stands = [area for walk in walks for area in walk.stands]
    middles = np.array([(area.x, area.y) for area in stands])
    too_near = []
    for walk in walks:
        for at, shape, heading in walk.turns:
            near = np.flatnonzero(np.abs(middles - (at.x, at.y)).max(axis=1) < REACH)
            candidates = []
            for stand in (stands[j] for j in near):
                if may_meet(at, stand) and not is_on_its_road(at, heading, stand):
                    candidates.append(stand)
            too_near += [(at, stand) for stand in swept_over(at, shape, heading, candidates)]
    return too_near


def swept_over(at: Area, shape: np.ndarray, heading: str, stands: list[Area]) -> list[Area]:
    """Return those of the robots and bins that a turn to a heading comes too near to."""
    if not stands:
        return []
    points = turn_of(at, shape, heading)
    # Several robots and bins may stand in the same box, at different times. It is measured once.
    apart = {}
    for box in {stand[:4] for stand in stands}:
        apart[box] = distance(points, box)
    return [stand for stand in stands if apart[stand[:4]] < LEAST_APART]


def turn_of(at: Area, shape: np.ndarray, heading: str) -> np.ndarray:
    """Return all points that a robot passes while it turns to a heading, (n, 2)."""
    start = HEADINGS[at.heading]
    return swept(shape, at.x, at.y, start, angle_between(start, HEADINGS[heading]))


def distance(points: np.ndarray, box: tuple[float, ...]) -> float:
    """Return the least distance of points from a box, m, as the larger of those in x and in y.

    It is negative if a point is inside. `box`: x and y of its middle, and half its size along both,
    m.
    """
    x, y, half_x, half_y = box
    along_x = np.abs(points[:, 0] - x) - half_x
    along_y = np.abs(points[:, 1] - y) - half_y
    return float(np.maximum(along_x, along_y).min())


@st.composite
def surveyed(draw: st.DrawFn) -> Scenario:
    """Draw an orchard of surveyed rows."""
    drawn = draw(rows(most=5))
    route = draw(st.sampled_from([ONE_WAY, TWO_WAY]))
    ends = draw(st.sampled_from([*RULES, FROM_THE_EAST]))
    pickers = draw(st.integers(2, len(drawn)))
    carriers = draw(st.integers(1, 8))
    return orchard_of(drawn, pickers=pickers, carriers=carriers, route=route, rows_to_pickers=ends)


@st.composite
def orchards(draw: st.DrawFn) -> Scenario:
    """Draw an orchard of equal rows."""
    rows = draw(st.integers(3, 20))
    route = draw(st.sampled_from([ONE_WAY, TWO_WAY]))
    length = draw(st.just(70.0) | st.floats(20.0, 200.0))
    bay = draw(st.just(0.0) | st.floats(0.0, 100.0))
    fitting = []
    for number in range(1, MOST_CARRIERS + 1):
        if queue_of(route, length, bay, number):
            fitting.append(number)
    assume(fitting)
    return empty_orchard(
        rows=rows,
        pickers=draw(st.integers(2, rows)),
        carriers=draw(st.sampled_from(fitting)),
        row_width=draw(st.floats(5.0, 12.0)),
        row_length=length,
        bay=bay,
        route=route,
        rows_to_pickers=draw(st.sampled_from([*RULES, FROM_THE_EAST])),
    )


LARGEST = {"rows": 20, "pickers": 20, "carriers": 40}


@settings(max_examples=15)
@given(orchards())
@example(empty_orchard(rows=4))
@example(empty_orchard(rows=4, route=TWO_WAY))
@example(empty_orchard(**LARGEST))
@example(empty_orchard(**LARGEST, route=TWO_WAY))
@example(empty_orchard(rows=20, pickers=10, carriers=40, rows_to_pickers="balanced-ends"))
@example(empty_orchard(**LARGEST, rows_to_pickers=FROM_THE_EAST))
@example(empty_orchard(**LARGEST, route=TWO_WAY, rows_to_pickers=FROM_THE_EAST))
@example(empty_orchard(rows=3, pickers=3, carriers=120))
@example(empty_orchard(rows=3, pickers=3, carriers=120, route=TWO_WAY))
@example(empty_orchard(carriers=2, row_length=20.0, route=TWO_WAY))
@example(empty_orchard(carriers=3, route=TWO_WAY, bay=50.75))
def test_what_stands_is_clear_of_every_drive_that_may_pass_it(scenario: Scenario) -> None:
    assert too_near(lay_out(scenario)) == []


# x of both ends of rows. The second row ends just before the place at which a picker waits.
ENDS = ((0.0, 64.0), (1.3, 63.1), (2.6, 62.6), (0.9, 63.9))
CLOSE = []
for number, (start, end) in enumerate(ENDS):
    CLOSE.append(Row(round(CLOSEST * number, 2), start, round(end - start, 2)))


@settings(max_examples=2)
@given(surveyed())
@example(orchard_of(CLOSE, pickers=4, carriers=4))
@example(orchard_of(CLOSE, pickers=4, carriers=4, route=TWO_WAY, rows_to_pickers=FROM_THE_EAST))
def test_what_stands_at_unequal_rows_is_clear_of_every_drive(scenario: Scenario) -> None:
    assert too_near(lay_out(scenario)) == []
    assert in_a_turn(lay_out(scenario)) == []


@pytest.mark.soak
@given(surveyed())
def test_soak_what_stands_at_unequal_rows_is_clear_of_drives(scenario: Scenario) -> None:
    assert too_near(lay_out(scenario)) == []
    assert in_a_turn(lay_out(scenario)) == []


@settings(max_examples=5)
@given(orchards())
@example(empty_orchard(rows=6, pickers=6, carriers=10, route=TWO_WAY))
@example(empty_orchard(rows=6, pickers=6, carriers=16))
@example(empty_orchard(rows=3, pickers=3, carriers=120))
@example(empty_orchard(rows=3, pickers=3, carriers=120, route=TWO_WAY))
@example(empty_orchard(rows=4, row_width=6.9))
def test_what_stands_is_clear_of_every_turn_beside_it(scenario: Scenario) -> None:
    """In the last example a bin before the last lane is beside the turn onto its road."""
    assert in_a_turn(lay_out(scenario)) == []


# y of the driveway of the tractor, m.
DRIVEWAY = 29.0


def from_the_tractor(points: np.ndarray) -> float:
    """Return the least distance of points, (n, 2) m, to what the tractor sweeps, m.

    The tractor sweeps its drive, and a circle at each end, where it turns.
    """
    shape = outline("tractor")
    x = points[:, 0]
    aside = np.abs(points[:, 1] - DRIVEWAY)
    radius = np.hypot(*shape.T).max()
    beyond = np.maximum(np.maximum(WEST_END - radius - x, x - EAST_END - radius), 0.0)
    drive = np.hypot(beyond, np.maximum(aside - shape[:, 1].max(), 0.0))
    turns = np.minimum(np.hypot(x - WEST_END, aside), np.hypot(x - EAST_END, aside)) - radius
    return float(np.minimum(drive, turns).min())


def nearest_to_the_tractor(layout: Layout) -> float:
    """Return how near a carrier or its bin comes to what the tractor sweeps, m, at most 9.

    Places where it stands, drives and turns count. What lies south of y = 15 m or east of x = -12 m
    is more than 9 m off, and is left out.
    """
    nearest = 9.0
    for walk in walks_of(layout):
        for area in walk.stands + walk.drives:
            north = area.y + area.half_y
            if area.x - area.half_x < -12.0 and north > 15.0:
                # The points of the northern edge, 5 cm apart. East of -11 m they are further off.
                most_east = min(area.x + area.half_x, -11.0)
                x = np.arange(area.x - area.half_x, most_east + 0.05, 0.05)
                edge = np.stack([x, np.full(len(x), north)], axis=1)
                nearest = min(nearest, from_the_tractor(edge))
        for at, shape, heading in walk.turns:
            if at.x < -12.0 and at.y > 15.0:
                radius = np.hypot(*shape.T).max()
                # If the circle around the turn is no nearer, neither is the turn.
                if from_the_tractor(np.array([[at.x, at.y]])) - radius < nearest:
                    nearest = min(nearest, from_the_tractor(turn_of(at, shape, heading)))
    return nearest


def near_the_tractor(
    route: str, numbers: Iterable[int], lengths: Iterable[float], bays: Iterable[float]
) -> list[tuple]:
    """Return the queues from which a carrier comes nearer than 0.6 m to what the tractor sweeps.

    A queue: the number of carriers, the length of the rows and the shift of the bay, m.
    """
    too_near = []
    for carriers, length, bay in product(numbers, lengths, bays):
        if queue_of(route, length, bay, carriers):
            orchard = empty_orchard(
                rows=3, pickers=2, carriers=carriers, row_length=length, bay=bay, route=route
            )
            if nearest_to_the_tractor(lay_out(orchard)) < 0.6:
                too_near.append((carriers, length, bay))
    return too_near


# Numbers of carriers, lengths of rows and shifts of the bay, m.
SOME = ((1, 2, 3, 9, 40, 120), (20.0, 28.0, 70.0), (0.0, 0.5, 1.0, 2.3, 4.3))
MANY = ((*range(1, 41), *range(45, 121, 5)), range(20, 201, 20), np.arange(0.0, 60.0, 0.7))


@pytest.mark.parametrize("route", [ONE_WAY, TWO_WAY])
@pytest.mark.parametrize(
    "queues", [SOME, pytest.param(MANY, marks=pytest.mark.soak)], ids=["some", "many"]
)
def test_no_carrier_comes_near_to_what_the_tractor_sweeps(route: str, queues: tuple) -> None:
    assert near_the_tractor(route, *queues) == []


@pytest.mark.parametrize("length", [28.0, 50.0, 105.0])
def test_the_only_carrier_works_beside_the_tractor(length: float) -> None:
    stage = Stage(
        empty_orchard(rows=3, pickers=2, carriers=1, row_length=length, route=TWO_WAY, tractor=True)
    )
    stage.run_until(lambda: stage.world.delivered == 3, 4000)
    stage.assert_no_collisions()


@pytest.mark.parametrize("stands", ["picker_01", "picker_02"])
def test_a_picker_that_is_stopped_at_its_start_stands_in_no_way(stands: str) -> None:
    """The other picker has two rows, and both of its bins are delivered."""
    stage = Stage(Scenario(rows=4, pickers=2, row_length=30.0, dispatch="nearest"))
    stage.local.engine.stop([stands])
    stage.run_until(lambda: stage.world.delivered == 2, 700)
    stage.assert_no_collisions()


def test_a_picker_that_stays_in_the_east_stands_in_no_way() -> None:
    """picker_02 never leaves its start in the east. Both bins of picker_01 are delivered."""
    stage = Stage(Scenario(rows=4, pickers=2, row_length=30.0), picker_02=Standing())
    stage.run_until(lambda: stage.world.delivered == 2, 700)
    stage.assert_no_collisions()


@pytest.mark.soak
@pytest.mark.parametrize(
    ("rows", "pickers", "carriers", "width"),
    [(6, 3, 2, 5.0), (8, 4, 14, 5.0), (5, 5, None, 5.0), (7, 2, 1, 9.3)],
)
def test_soak_no_picker_that_stands_is_in_the_way_of_the_others(
    rows: int, pickers: int, carriers: int | None, width: float
) -> None:
    """Each picker in turn never leaves its start, and the bins of all other rows are delivered."""
    scenario = empty_orchard(rows=rows, pickers=pickers, carriers=carriers, row_width=width)
    for picker, block in lay_out(scenario).blocks.items():
        stage = Stage(scenario, **{picker: Standing()})
        stage.run_until(lambda: stage.world.delivered == rows - len(block.rows), 4000)  # noqa: B023 - run at once


@pytest.mark.soak
def test_soak_half_of_the_pickers_stand_in_no_way() -> None:
    """Half of the pickers of the largest orchard never leave their starts.

    Bins call when they are full: with an early policy carriers would wait for the pickers that
    stand, in the way of others.
    """
    pickers = [f"picker_{number:02d}" for number in range(1, 21)]
    stage = Stage(
        empty_orchard(rows=20, pickers=20, dispatch=NEAREST),
        **{picker: Standing() for picker in pickers[::2]},
    )
    stage.run_until(lambda: stage.world.delivered == 10, 4000)
    stage.assert_no_collisions()
