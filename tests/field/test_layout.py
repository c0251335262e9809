"""Where everything stands at the beginning: nothing overlaps in any legal scenario, and the default
orchard has the figures of the manual of 2015 (docs/manual.md).

Coordinates are in the frame of the orchard, m. In the default orchard, 100 m wide, the fences are
1 m thick around x = -50 and 50, so their inner sides are at -49.5 and 49.5.
"""

import math
import time
from collections.abc import Sequence

import numpy as np
import pytest
from bare_world import overlapping_starts
from hypothesis import example, given, settings
from hypothesis import strategies as st

from orchard.field import layout as layouts
from orchard.field import placement
from orchard.field.geometry import HEADINGS, WEST, Pose, from_frame
from orchard.field.kinds import ANIMALS, KINDS, PEOPLE, kind_of, name_of
from orchard.field.lanes import ROW_WEST
from orchard.field.layout import BAY, DRIVEWAY, Layout, lay_out
from orchard.field.placement import Start
from orchard.field.scenario import Animals, People, Scenario

CROWD = {
    "people": People(workers=25, visitors=25),
    "animals": Animals(dogs=25, cats=25),
    "weeds": 50,
}
ONE_WAY = Scenario(carriers=40, route="one-way")
BIGGEST = Scenario(rows=100, pickers=60, row_width=12.0, carriers=120, **CROWD)
# As many bodies on the smallest ground.
FULLEST = BIGGEST.model_copy(update={"rows": 3, "pickers": 3, "row_width": 5.0})


@st.composite
def scenarios(draw: st.DrawFn) -> Scenario:
    """Draw any legal scenario."""
    rows = draw(st.integers(3, 20) | st.just(100))
    workers = draw(st.integers(0, 50))
    dogs = draw(st.integers(0, 50))
    return Scenario(
        rows=rows,
        pickers=draw(st.integers(2, min(rows, 60))),
        row_width=draw(st.floats(5.0, 12.0)),
        carriers=draw(st.none() | st.integers(1, 120)),
        seed=draw(st.integers(0, 2**63 - 1)),
        people=People(workers=workers, visitors=draw(st.integers(0, 50 - workers))),
        animals=Animals(dogs=dogs, cats=draw(st.integers(0, 50 - dogs))),
        weeds=draw(st.integers(0, 50)),
        tractor=draw(st.booleans()),
        route=draw(st.sampled_from(["one-way", "two-way"])),
        rows_to_pickers=draw(st.sampled_from(["balanced", "balanced-ends"])),
    )


def box(start: Start) -> np.ndarray:
    """Return the corners of a body, (4, 2) m."""
    ahead = KINDS[start.kind].length / 2
    left = KINDS[start.kind].width / 2
    return np.array(
        [
            from_frame(start.pose, i * ahead, j * left)
            for i, j in ((1, 1), (-1, 1), (-1, -1), (1, -1))
        ]
    )


def of(layout: Layout, *kinds: str) -> list[Start]:
    """Return the bodies of some kinds."""
    return [start for start in layout.starts if start.kind in kinds]


def strictly_in(points: np.ndarray, *areas: Sequence[float]) -> bool:
    """Whether the middle or a corner of a box is in one of the areas (west, south, east, north).

    That is enough for bodies, which are smaller than the areas. `points`: the corners, (4, 2) m.
    """
    # Points along the second axis, areas along the first one.
    x, y = np.vstack([points, points.mean(axis=0)]).T
    west, south, east, north = np.array(areas).T[..., None]
    return bool(np.any((west < x) & (x < east) & (south < y) & (y < north)))


@settings(max_examples=40)
@given(scenarios())
@example(BIGGEST)
@example(FULLEST)
@example(Scenario())
def test_every_legal_scenario_lays_out(scenario: Scenario) -> None:
    layout = lay_out(scenario)
    assert overlapping_starts(layout) == []
    assert all(inside_the_fences(layout, start) for start in layout.starts)
    assert len(set(layout.names)) == len(layout.names)
    assert all(kind_of(start.name) == start.kind for start in layout.starts)
    assert {type(value) for start in layout.starts for value in start.pose} == {float}, (
        "plain numbers"
    )
    assert_counts(layout)
    assert_people_keep_off(layout)
    assert_weeds_in_their_strips(layout)


def inside_the_fences(layout: Layout, start: Start) -> bool:
    """Whether all of a body is inside the fences."""
    low = box(start).min(axis=0)
    high = box(start).max(axis=0)
    return bool(
        np.all(low >= (-49.5, layout.bottom + 0.5)) and np.all(high <= (49.5, layout.top - 0.5))
    )


def assert_counts(layout: Layout) -> None:
    """Assert that there are as many bodies of each kind as the scenario says."""
    scenario = layout.scenario
    wanted = {
        "picker": scenario.pickers,
        "carrier": scenario.carrier_count,
        "bin": scenario.pickers + scenario.carrier_count,
        "tractor": int(scenario.tractor),
        "worker": scenario.people.workers,
        "visitor": scenario.people.visitors,
        "dog": scenario.animals.dogs,
        "cat": scenario.animals.cats,
        "weed": scenario.weeds,
    }
    for kind, count in wanted.items():
        assert sorted(start.name for start in of(layout, kind)) == sorted(
            name_of(kind, i + 1) for i in range(count)
        )


def assert_people_keep_off(layout: Layout) -> None:
    """Assert that no person stands in the rows, and no person or animal where robots drive off."""
    lines = layout.tree_lines
    for start in of(layout, *PEOPLE):
        assert not strictly_in(box(start), (ROW_WEST, lines[-1], layout.row_east, lines[0])), start
        assert start.pose.yaw in HEADINGS.values()
    # The 1.5 m before the front of each picker, which is 1.25 m ahead of its middle.
    ways = [
        (p.pose.x + 1.25, p.pose.y - 0.75, p.pose.x + 2.75, p.pose.y + 0.75)
        for p in of(layout, "picker")
    ]
    for start in of(layout, *PEOPLE, *ANIMALS):
        assert not strictly_in(
            box(start),
            layout.queue.in_use(layout.scenario.carrier_count),
            # The tractor's track.
            (-48.0, 26.0, -22.0, 32.0),
            *ways,
        ), start


def assert_weeds_in_their_strips(layout: Layout) -> None:
    """Assert that half of the weeds are north of all trees, and half south of them."""
    first = layout.tree_lines[0]
    last = layout.tree_lines[-1]
    above = [weed for weed in of(layout, "weed") if weed.pose.y >= first]
    below = [weed for weed in of(layout, "weed") if weed.pose.y <= last]
    assert len(above) + len(below) == layout.scenario.weeds
    assert 0 <= len(above) - len(below) <= 1


@settings(max_examples=10)
@given(scenarios())
def test_guests_are_clear_of_walls_and_machines_at_any_yaw(scenario: Scenario) -> None:
    """A guest may turn, so it is a circle here. It is 0.3 m or more from any box that stands."""
    layout = lay_out(scenario)
    machines = [start for start in layout.starts if KINDS[start.kind].robot]
    still = [tuple(wall) for wall in layout.walls] + [
        (m.pose.x, m.pose.y, KINDS[m.kind].length / 2, KINDS[m.kind].width / 2) for m in machines
    ]
    for start in of(layout, *PEOPLE, *ANIMALS):
        radius = math.hypot(KINDS[start.kind].length, KINDS[start.kind].width) / 2
        gaps = [
            math.hypot(max(abs(start.pose.x - x) - a, 0), max(abs(start.pose.y - y) - b, 0))
            for x, y, a, b in still
        ]
        assert min(gaps) - radius >= 0.3 - 1e-9, start


@settings(max_examples=10)
@given(scenarios())
def test_the_same_scenario_gives_the_same_layout(scenario: Scenario) -> None:
    first = lay_out(scenario)
    other = lay_out(scenario.model_copy())
    assert first.starts == other.starts
    assert np.array_equal(first.walls, other.walls)


def test_another_seed_moves_the_weeds_and_not_the_given_places() -> None:
    first = lay_out(Scenario(seed=1))
    other = lay_out(Scenario(seed=2))
    assert not {s.pose for s in of(first, "weed")} & {s.pose for s in of(other, "weed")}
    assert [s.pose[:2] for s in of(first, *PEOPLE, *ANIMALS)] == [
        s.pose[:2] for s in of(other, *PEOPLE, *ANIMALS)
    ]


def seconds_a_body(scenario: Scenario) -> float:
    """Return the least processor time of a few layouts, for each body, s.

    No layout is kept from before.
    """
    times = []
    for seed in range(101, 106):
        another = scenario.model_copy(update={"seed": seed})
        begin = time.process_time()
        layout = lay_out(another)
        times.append((time.process_time() - begin) / len(layout.starts))
    return min(times)


@pytest.mark.parametrize("scenario", [BIGGEST, FULLEST], ids=["biggest", "fullest"])
def test_a_body_costs_no_more_in_a_big_orchard(scenario: Scenario) -> None:
    """If each body were compared with each other one, it would cost 18 times as much.

    Both times are of one run, so the speed of the machine does not matter.
    """
    assert seconds_a_body(scenario) <= 4.0 * seconds_a_body(Scenario())


def places(scenario: Scenario) -> dict[str, tuple[float, float]]:
    """Return where each body starts, m."""
    return {start.name: (start.pose.x, start.pose.y) for start in lay_out(scenario).starts}


def test_guests_stand_where_the_manual_puts_them() -> None:
    """Guests are people and animals. Each has a place (x, y) in the manual, m."""
    manual = {
        "worker_01": (-20.0, 22.0),
        "worker_04": (-44.0, -15.0),
        "visitor_01": (-47.0, 8.0),
        "visitor_03": (44.0, 6.0),
    }
    manual |= {"dog_01": (20.0, -11.0), "dog_02": (20.0, 15.0), "cat_01": (-47.0, -11.0)}
    assert {name: places(Scenario())[name] for name in manual} == manual


@pytest.mark.parametrize(
    ("name", "given_place"),
    [("worker_02", (25.0, 25.0)), ("worker_03", (36.0, 18.0)), ("visitor_02", (-6.0, 22.0))],
)
def test_a_given_queue_place_gives_way_to_the_nearest_free_one(
    name: str, given_place: tuple[float, float]
) -> None:
    """In the one-way orchard, with 40 carriers, the queue reaches to these places of the manual. In
    the default orchard guests stand there, but for worker_02.
    """
    x, y = places(ONE_WAY)[name]
    assert places(Scenario())[name] == given_place or name == "worker_02", (
        "the lines that no carrier uses are not kept clear"
    )
    moved = math.dist((x, y), given_place)
    queue = lay_out(ONE_WAY).queue.area
    to_the_edge = min(
        queue.north - given_place[1], given_place[1] - queue.south, abs(queue.east - given_place[0])
    )
    # It must be out of the queue by half of its diagonal of 1.14 m. 0.5 m are two steps of the grid
    # on which free places are looked for.
    assert 0.0 < moved <= max(to_the_edge, 0.0) + 0.571 + 0.5


@pytest.mark.parametrize(
    "place",
    [(-33.0, 10.75), (-30.0, 29.0), (-23.0, 24.0)],
    ids=["ahead of a picker", "track", "queue"],
)
def test_a_dog_is_not_put_where_robots_drive_off(
    place: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """If such a place were given to the dog, it would be put less than 5 m aside."""
    monkeypatch.setitem(placement.GIVEN, "dog", (place,))
    # Layouts are kept: without this the test would get one that was made before.
    monkeypatch.setattr(layouts, "_laid_out", layouts._laid_out.__wrapped__)
    x, y = places(Scenario())["dog_01"]
    assert 0.0 < math.dist((x, y), place) < 5.0


def test_animals_may_stand_in_rows_but_not_in_trees() -> None:
    """In this orchard trees stand at the given place of dog_01, and it is put up to 2 m aside."""
    at = places(Scenario(rows=7, row_width=6.75))
    assert all(abs(at["dog_01"][i] - (20.0, -11.0)[i]) < 2.0 for i in (0, 1))


def test_the_given_places_are_kept_for_those_they_are_given_to() -> None:
    """More guests, whose places are drawn, take none of those of the manual."""
    crowded = Scenario(people=People(workers=40, visitors=10), animals=Animals(dogs=40, cats=10))
    few = places(Scenario())
    many = places(crowded)
    assert {name: many[name] for name in few if kind_of(name) in (*PEOPLE, *ANIMALS)} == {
        name: place for name, place in few.items() if kind_of(name) in (*PEOPLE, *ANIMALS)
    }


@settings(max_examples=30)
@given(rows=st.integers(3, 20), width=st.floats(5.0, 12.0))
def test_the_field_is_as_high_as_the_manual_says(rows: int, width: float) -> None:
    """Rows, lines of trees, and 41 m of free ground together. Its north end is at y = 34 m."""
    height = width * rows + 0.5 * (rows + 1) + 41.0
    assert lay_out(Scenario(rows=rows, row_width=width)).bottom == pytest.approx(34.0 - height)


@pytest.mark.parametrize(("rows", "width"), [(3, 5.0), (5, 5.0), (20, 12.0), (7, 6.4)])
def test_trees_and_lanes_lie_where_the_reference_puts_them(rows: int, width: float) -> None:
    """The first line of trees is at y = 13.5 m, the others follow to the south, with the width of a
    row and 0.5 m of trees from each to the next. 21 m are free south of the last one.
    """
    layout = lay_out(Scenario(rows=rows, row_width=width))
    lines = [13.5 - i * (width + 0.5) for i in range(rows + 1)]
    assert layout.tree_lines == pytest.approx(lines)
    assert [lane.number for lane in layout.lanes] == list(range(1, rows + 1))
    assert [lane.y for lane in layout.lanes] == pytest.approx(
        [y - (width + 0.5) / 2 for y in lines[:-1]]
    )
    assert lines[-1] - layout.bottom == pytest.approx(21.0)


def test_every_line_has_twelve_trees_and_eleven_posts() -> None:
    """They stand by turns, 3 m apart. Walls are boxes (x, y, half length, half width): those of
    trees and posts are half a metre long. Four rows have five lines, and there are four fences.
    """
    layout = lay_out(Scenario(rows=4))
    for y in layout.tree_lines:
        xs = sorted(
            wall[0] for wall in layout.walls if wall[1] == pytest.approx(y) and wall[2] == 0.25
        )
        assert xs == [-34.5 + 3.0 * i for i in range(23)]
    assert len(layout.walls) == 4 + 5 * 23


def test_fences_are_a_metre_thick_and_close_the_field() -> None:
    """The first four walls are the fences: boxes (x, y, half length, half width). The fences in the
    north and south reach over the ends of the other two.
    """
    layout = lay_out(Scenario())
    north, south, west, east = layout.walls[:4]
    assert north[1] - north[3] == 33.5
    assert south[1] + south[3] == layout.bottom + 0.5
    assert west[0] + west[2] == -49.5
    assert east[0] - east[2] == 49.5
    assert north[0] - north[2] == -50.5
    assert north[0] + north[2] == 50.5
    assert (west[1] + west[3], west[1] - west[3]) == pytest.approx((34.5, layout.bottom - 0.5))


def test_the_driveway_and_the_bay_are_in_the_top_left_corner() -> None:
    """The driveway is 30 m by 10 m, and its middle is where the manual says."""
    assert (DRIVEWAY.east - DRIVEWAY.west, DRIVEWAY.north - DRIVEWAY.south) == pytest.approx(
        (30.0, 10.0)
    )
    assert (
        (DRIVEWAY.east + DRIVEWAY.west) / 2,
        (DRIVEWAY.north + DRIVEWAY.south) / 2,
    ) == pytest.approx((-34.67, 28.51))
    assert DRIVEWAY.west <= BAY.west < BAY.east <= DRIVEWAY.east
    # Outside the tractor's sweep.
    assert BAY.north < 26.1


@settings(max_examples=15)
@given(scenarios())
# Its second picker starts in the east.
@example(Scenario(rows=4, pickers=2))
def test_robots_start_with_their_bins_behind_them(scenario: Scenario) -> None:
    """A picker starts at the west end of its first row, x = -35.5 m, or east of it, at 41 m."""
    layout = lay_out(scenario)
    for start in of(layout, "picker", "carrier"):
        behind = layout.starts[layout.index[start.bin]]
        ahead = 1.0 if start.pose.yaw == 0.0 else -1.0
        assert behind.pose == Pose(
            start.pose.x - ahead * KINDS[start.kind].tows, start.pose.y, start.pose.yaw
        )
    for picker in of(layout, "picker"):
        block = layout.blocks[picker.name]
        x, heading = (-35.5, 0.0) if block.start == "west" else (41.0, WEST)
        assert picker.pose == Pose(x, layout.lane(block.rows[0]).y, heading)
