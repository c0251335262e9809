"""What physics lets happen: movement, the bar, coupling, picking, unloading, weeds. The field is bare unless a test puts walls."""

import math
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from raycaster import world_of

from orchard import move_kernel
from orchard.boxes import overlap, place
from orchard.config import Scenario
from orchard.geometry import EAST, NORTH, Pose, Twist
from orchard.layout import BAY, ROW_EAST, ROW_WEST, lay_out
from orchard.messages import Couple, Deed, Flatten, Uncouple
from orchard.metrics import collisions, refused_moves
from orchard.observe import observe
from orchard.physics import harvest_is_over, is_full, step
from orchard.scan import Scanner
from orchard.world import NOBODY, World, new_world

LANE = 10.75  # y of row 1's centre line
AHEAD = Twist(1.0)
TURN_LEFT = Twist(yaw=math.pi / 8)


@dataclass
class Yard:
    """A world that is driven by hand."""

    world: World
    events: list = field(default_factory=list)

    def drive(self, ticks: int = 1, deeds: list[tuple[str, Deed]] = (), **twists: Twist) -> list:
        """Drive the named bodies for some ticks, everything else standing; deeds go with the first."""
        index, wanted = self.world.index, np.zeros_like(self.world.pose)
        for name, twist in twists.items():
            wanted[index[name]] = twist
        due, told = [(index[name], deed) for name, deed in deeds], []
        for _ in range(ticks):
            told += step(self.world, wanted, due)
            due = []
        self.events += told
        return told

    def do(self, name: str, deed: Deed) -> list:
        return self.drive(deeds=[(name, deed)])

    def pose(self, name: str) -> Pose:
        return Pose(*self.world.pose[self.world.index[name]].tolist())

    def put(self, name: str, *pose: float) -> None:
        self.world.pose[self.world.index[name]] = pose

    def couple(self, robot: str, bin_: str) -> None:
        """Couple by fiat, wherever they are."""
        i, j = self.world.index[robot], self.world.index[bin_]
        self.world.coupled[i], self.world.coupled[j] = j, i

    def coupled(self, name: str) -> str:
        other = int(self.world.coupled[self.world.index[name]])
        return "" if other == NOBODY else self.world.layout.names[other]

    def of(self, array: str, name: str):
        return getattr(self.world, array)[self.world.index[name]]

    def told(self, what: str) -> list:
        return [event for event in self.events if event.what == what]


def yard(*bodies, **kwargs) -> Yard:
    return Yard(world_of(*bodies, **kwargs))


def picker_with_bin(x: float = ROW_WEST, y: float = LANE, yaw: float = EAST, **kwargs) -> Yard:
    """picker_01 and its bin_02 behind it, in a bare field."""
    back = Pose(x - 2.25 * math.cos(yaw), y - 2.25 * math.sin(yaw), yaw)
    alone = yard(("picker", Pose(x, y, yaw)), ("bin", back), **kwargs)
    alone.couple("picker_01", "bin_02")
    return alone


def train(**kwargs) -> dict[str, Twist]:
    """The same twist for a picker and for the bin behind it, which is right as long as it is straight."""
    return {"picker_01": Twist(**kwargs), "bin_02": Twist(**kwargs)}


# -- movement


def test_ten_ticks_at_1_m_per_s_are_1_m():
    moved = yard(("picker", Pose(0, 0, EAST)))
    moved.drive(10, picker_01=AHEAD)
    assert moved.pose("picker_01") == pytest.approx((1.0, 0.0, 0.0), abs=1e-12)
    assert moved.of("distance", "picker_01") == pytest.approx(1.0)
    assert moved.world.tick == 10


def test_40_ticks_of_an_eighth_turn_per_second_are_exactly_90_degrees():
    turned = yard(("picker", Pose(0, 0, EAST)))
    turned.drive(40, picker_01=TURN_LEFT)
    assert turned.pose("picker_01") == pytest.approx((0.0, 0.0, NORTH), abs=1e-14)
    turned.drive(120, picker_01=TURN_LEFT)
    assert turned.pose("picker_01").yaw == pytest.approx(0.0, abs=2e-14)


@settings(max_examples=200, deadline=None)
@given(st.floats(-3, 3), st.floats(-3, 3), st.one_of(st.floats(-6.3, 6.3), st.floats(-1e-7, 1e-7), st.just(0.0)), st.floats(-3.1, 3.1))
@example(1.0, 0.0, 1e-300, 0.5)
@example(1.0, 0.0, 5e-324, 0.5)
def test_a_step_follows_its_arc(forward, left, turn, yaw):
    """Against the closed form where that is well conditioned, else against ten thousand tiny straight steps."""
    x, y, end = move_kernel.arc(2.0, -1.0, yaw, forward, left, turn, 0.1)
    if abs(turn) > 1e-3:
        north, east = math.sin(yaw + turn * 0.1) - math.sin(yaw), math.cos(yaw + turn * 0.1) - math.cos(yaw)
        expected = 2.0 + (forward * north + left * east) / turn, -1.0 + (left * north - forward * east) / turn
    else:
        middle = yaw + turn * (np.arange(1000) + 0.5) * 1e-4
        expected = (
            2.0 + 1e-4 * np.sum(forward * np.cos(middle) - left * np.sin(middle)),
            -1.0 + 1e-4 * np.sum(forward * np.sin(middle) + left * np.cos(middle)),
        )
    assert (x, y) == pytest.approx(expected, abs=1e-12)
    assert math.cos(end - yaw - turn * 0.1) == pytest.approx(1.0, abs=1e-12)


def test_driving_and_turning_makes_a_circle():
    round_ = yard(("picker", Pose(0, 0, EAST)))
    round_.drive(160, picker_01=Twist(1.0, 0.0, math.pi / 8))
    assert round_.pose("picker_01") == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)
    assert round_.of("distance", "picker_01") == pytest.approx(16.0)


@pytest.mark.parametrize(("kind", "speed", "eighths"), [("picker", 1, 1), ("tractor", 1, 1), ("worker", 1, 8), ("dog", 3, 16)])
def test_nothing_is_faster_than_its_kind(kind, speed, eighths):
    fast = yard((kind, Pose(0, 0, EAST)))
    fast.drive(1, **{f"{kind}_01": Twist(x=-99.0)})
    assert fast.pose(f"{kind}_01").x == pytest.approx(-0.1 * speed)
    fast.drive(1, **{f"{kind}_01": Twist(yaw=99.0)})
    assert fast.pose(f"{kind}_01").yaw == pytest.approx(0.1 * eighths * math.pi / 8)


def test_a_bin_is_not_faster_askew_than_straight_on():
    askew = picker_with_bin()
    askew.drive(1, bin_02=Twist(-99.0, 99.0))
    assert math.dist(askew.pose("bin_02")[:2], (ROW_WEST - 2.25, LANE)) == pytest.approx(0.3)


def test_only_a_coupled_bin_moves_sideways_and_one_by_itself_not_at_all():
    side = picker_with_bin()
    side.drive(1, picker_01=Twist(y=1.0), bin_02=Twist(y=1.0))
    assert side.pose("picker_01").y == LANE
    assert side.pose("bin_02").y == pytest.approx(LANE + 0.1)
    alone = yard(("bin", Pose(0, 0, EAST)))
    alone.drive(1, bin_01=Twist(1.0, 1.0, 1.0))
    assert alone.pose("bin_01") == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
def test_a_velocity_that_is_no_number_stands_still(wrong):
    still = yard(("dog", Pose(0, 0, EAST)))
    still.drive(1, dog_01=Twist(1.0, 0.0, wrong))
    assert still.pose("dog_01") == (0.0, 0.0, 0.0)


def everybody() -> Yard:
    return Yard(new_world(lay_out(Scenario(rows=3))))


def test_nothing_moves_that_is_not_driven():
    quiet = everybody()
    before = quiet.world.pose.copy()
    quiet.drive(50)
    assert np.array_equal(quiet.world.pose, before)


# -- obstacles


def overlapping(world: World) -> list[tuple[str, str]]:
    """The pairs of solid things that overlap; a wall's name is its number."""
    boxes = world.bodies.boxes.copy()
    place(world.pose, boxes)
    solid = np.flatnonzero(world.bodies.solid)
    names = world.layout.names
    pairs = [(names[i], names[j]) for i in solid for j in solid if i < j and overlap(boxes[i], boxes[j])]
    return pairs + [(names[i], str(k)) for i in solid for k in range(len(world.walls)) if overlap(boxes[i], world.walls[k])]


CROWD = [
    ("bin", Pose(-2.25, 0, 0)), ("picker", Pose(0, 0, 0)), ("carrier", Pose(0, 2, 0)), ("tractor", Pose(0, -3, 0.3)),
    ("worker", Pose(2, 0, 3)), ("visitor", Pose(2, 1.5, -2)), ("dog", Pose(-2, 2, 1)), ("cat", Pose(3.3, 1.0, 0)), ("weed", Pose(0, 0, 0)),
]  # fmt: skip
PEN = [(-5.0, 0.0, 0.5, 6.0), (5.0, 0.0, 0.5, 6.0), (0.0, -6.0, 5.0, 0.5), (0.0, 5.0, 5.0, 0.5), (2.0, 3.0, 0.25, 0.25)]
twist = st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.floats(-6, 6))


@settings(max_examples=60, deadline=None)
@given(st.lists(st.lists(twist, min_size=len(CROWD), max_size=len(CROWD)), min_size=1, max_size=4))
def test_no_two_solid_things_ever_overlap(courses):
    world = world_of(*CROWD, walls=PEN)
    world.coupled[[0, 1]] = 1, 0
    assert overlapping(world) == []
    for course in courses:
        for _ in range(12):
            step(world, np.array(course), [])
            assert overlapping(world) == []


def test_what_is_in_the_way_stops_a_body_and_is_told_once():
    wall = yard(("picker", Pose(0, 0, EAST)), walls=[(1.25 + 0.25 + 0.5, 0, 0.5, 3)])
    wall.drive(5, picker_01=AHEAD)
    assert wall.pose("picker_01").x == pytest.approx(0.2)
    assert not wall.of("twist", "picker_01").any()
    assert wall.of("refused", "picker_01") == collisions(wall.world) == 3
    assert [(event.tick, event.who, event.whom) for event in wall.told("collision")] == [(2, "picker_01", "")]
    assert "fence" in wall.told("collision")[0].detail
    wall.drive(1, picker_01=Twist(-1.0))
    wall.drive(3, picker_01=AHEAD)
    assert len(wall.told("collision")) == 2


def test_a_body_may_drive_until_it_touches():
    touch = yard(("picker", Pose(0, 0, EAST)), ("tractor", Pose(1.25 + 2.5 + 0.3, 0, EAST)))
    touch.drive(3, picker_01=AHEAD)
    assert touch.pose("picker_01").x == pytest.approx(0.3)
    touch.drive(1, picker_01=AHEAD)
    assert touch.told("collision")[0].whom == "tractor_02"


def test_robots_and_guests_are_counted_apart():
    both = yard(("picker", Pose(0, 0, EAST)), ("worker", Pose(1.25 + 0.275, 0, EAST)))
    both.drive(2, picker_01=AHEAD, worker_02=Twist(-1.0))
    assert (collisions(both.world), refused_moves(both.world)) == (2, 2)


def test_who_moves_first_gets_the_place():
    """A gap of 0.15 m, and both want 0.1 m of it."""
    race = yard(("picker", Pose(0, 0, EAST)), ("worker", Pose(1.25 + 0.275 + 0.15, 0, EAST)))
    race.drive(1, picker_01=AHEAD, worker_02=Twist(-1.0))
    assert race.pose("picker_01").x == pytest.approx(0.1)
    assert race.pose("worker_02").x == 1.25 + 0.275 + 0.15


def test_a_turn_counts_the_whole_box():
    near = yard(("tractor", Pose(0, 0, EAST)), walls=[(0, 1.5 + 0.25 + 0.01, 3, 0.25)])
    near.drive(1, tractor_01=TURN_LEFT)
    assert near.pose("tractor_01").yaw == 0.0
    assert near.of("refused", "tractor_01") == 1


def test_a_weed_stops_nobody():
    over = yard(("picker", Pose(0, 0, EAST)), ("weed", Pose(1.5, 0, EAST)))
    over.drive(30, picker_01=AHEAD)
    assert over.pose("picker_01").x == pytest.approx(3.0)


# -- the bar


def test_a_robot_cannot_leave_its_bin_behind():
    held = picker_with_bin()
    held.drive(10, picker_01=AHEAD)
    assert held.pose("picker_01").x == pytest.approx(ROW_WEST + 0.3)
    assert held.of("held", "picker_01") == 7
    assert held.of("refused", "picker_01") == 0
    held.drive(1, bin_02=AHEAD)
    held.drive(4, **train(x=1.0))
    assert held.pose("picker_01").x == pytest.approx(ROW_WEST + 0.7)


def test_without_a_bin_the_bar_holds_nobody():
    free = yard(("picker", Pose(0, 0, EAST)), ("bin", Pose(-2.25, 0, EAST)))
    free.drive(10, picker_01=AHEAD)
    assert free.pose("picker_01").x == pytest.approx(1.0)


# -- coupling


def beside(kind: str = "picker", off: float = 0.0, aside: float = 0.0, yaw: float = 0.0) -> Yard:
    """A robot, and a bin so many metres off its coupling point and turned so far."""
    distance = {"picker": 2.25, "carrier": 1.9, "tractor": 5.0}[kind]
    return yard((kind, Pose(1, 1, NORTH)), ("bin", Pose(1 - aside, 1 - distance + off, NORTH + yaw)))


@pytest.mark.parametrize("kind", ["picker", "carrier"])
@pytest.mark.parametrize("yaw", [0.0, math.pi / 2, -math.pi / 2, math.pi, math.radians(4.9), math.pi / 2 - math.radians(4.9)])
def test_a_bin_at_the_coupling_point_couples_at_any_quarter_turn_and_stays_where_it_is(kind, yaw):
    spot = beside(kind, off=0.06, aside=-0.06, yaw=yaw)
    before = spot.world.pose.copy()
    assert [event.what for event in spot.do(f"{kind}_01", Couple("bin_02"))] == ["coupled"]
    assert (spot.coupled(f"{kind}_01"), spot.coupled("bin_02")) == ("bin_02", f"{kind}_01")
    assert np.array_equal(spot.world.pose, before)


@pytest.mark.parametrize(
    ("spot", "why"),
    [
        (beside(off=0.11), "coupling point"),
        (beside(aside=0.08, off=0.08), "coupling point"),
        (beside(yaw=math.radians(5.1)), "square"),
        (beside(yaw=math.radians(40)), "square"),
        (beside("tractor"), "tows nothing"),
    ],
)
def test_a_bin_elsewhere_or_askew_does_not_couple(spot, why):
    robot = spot.world.layout.names[0]
    (refusal,) = spot.do(robot, Couple("bin_02"))
    assert (refusal.what, refusal.who, refusal.whom) == ("deed refused", robot, "bin_02")
    assert why in refusal.detail
    assert spot.coupled(robot) == ""


def test_coupling_and_uncoupling_want_both_to_stand():
    spot = beside()
    spot.drive(1, picker_01=Twist(0.5))
    assert "moves" in spot.do("picker_01", Couple("bin_02"))[0].detail  # it moved a tick ago
    assert "moves" in spot.drive(1, deeds=[("picker_01", Couple("bin_02"))], picker_01=Twist(0.5))[0].detail  # it wants to
    spot = beside()
    assert spot.do("picker_01", Couple("bin_02"))[0].what == "coupled"
    assert "bin_02 moves" in spot.drive(1, deeds=[("picker_01", Uncouple())], bin_02=Twist(0.1))[0].detail
    assert "bin_02 moves" in spot.do("picker_01", Uncouple())[0].detail
    assert spot.do("picker_01", Uncouple())[0].what == "uncoupled"
    assert spot.coupled("bin_02") == ""


def test_a_bin_is_coupled_to_one_robot_and_a_robot_to_one_bin():
    bins = ("bin", Pose(-2.25, 0, EAST)), ("bin", Pose(-2.25, 9, EAST))
    pair = yard(("picker", Pose(0, 0, EAST)), bins[0], ("carrier", Pose(-4.15, 0, math.pi)), bins[1])
    pair.do("picker_01", Couple("bin_02"))
    assert "coupled" in pair.do("carrier_03", Couple("bin_02"))[0].detail
    assert "has a bin" in pair.do("picker_01", Couple("bin_04"))[0].detail
    assert "no bin" in pair.do("carrier_03", Uncouple())[0].detail
    assert "no such bin" in pair.do("carrier_03", Couple("carrier_03"))[0].detail
    assert "no such bin" in pair.do("carrier_03", Couple("bin_99"))[0].detail


# -- picking


def test_a_row_from_end_to_end_fills_a_bin():
    row = picker_with_bin(x=ROW_WEST - 0.55)
    row.drive(710, **train(x=1.0))
    assert row.world.row_picked.tolist() == [70.0, 0.0, 0.0]
    assert row.of("fill", "bin_02") == 70.0
    assert is_full(row.world, row.world.index["bin_02"])
    assert [(e.what, e.who, e.whom) for e in row.events] == [("row picked", "picker_01", "bin_02"), ("bin full", "bin_02", "picker_01")]
    assert row.events[0].tick == 705  # 70.55 m at 0.1 m a tick
    assert row.events[0].detail == "row 1"


def test_a_row_is_picked_westward_as_well():
    row = picker_with_bin(x=ROW_EAST + 0.05, yaw=math.pi)
    row.drive(300, **train(x=1.0))
    assert row.world.row_from[0] == 1
    assert row.world.row_picked[0] == row.of("fill", "bin_02") == pytest.approx(29.95)


def test_what_grows_in_the_row_goes_into_the_bin_and_driving_back_and_forth_adds_nothing():
    row = picker_with_bin()
    row.drive(100, **train(x=1.0))
    row.drive(50, **train(x=-1.0))
    assert row.of("fill", "bin_02") == pytest.approx(10.0)
    row.drive(60, **train(x=1.0))
    assert row.of("fill", "bin_02") == pytest.approx(11.0)


def test_a_picker_that_begins_amid_a_row_picks_nothing():
    row = picker_with_bin(x=0.0)
    row.drive(100, **train(x=1.0))
    assert (row.world.row_picked[0], row.world.row_from[0]) == (0.0, 0)


def test_a_picker_with_a_full_bin_begins_no_row():
    row = picker_with_bin()
    row.world.fill[1] = 70.0
    row.drive(20, **train(x=1.0))
    assert (row.world.row_picked[0], row.world.row_from[0]) == (0.0, 0)


def test_a_second_bin_goes_on_where_the_first_one_ended_and_not_beyond_a_gap():
    row = picker_with_bin(x=-20.0)
    row.world.row_picked[0], row.world.row_from[0] = 10.0, -1  # picked up to x = -25.5
    row.drive(10, **train(x=1.0))
    assert row.world.row_picked[0] == 10.0
    row.drive(70, **train(x=-1.0))
    row.drive(20, **train(x=1.0))
    assert row.world.row_picked[0] == pytest.approx(11.5)
    assert row.of("fill", "bin_02") == pytest.approx(1.5)


def test_a_bin_takes_70_m_and_the_row_keeps_the_rest():
    row = picker_with_bin()
    row.world.fill[1] = 68.05
    row.drive(40, **train(x=1.0))
    assert row.of("fill", "bin_02") == 70.0
    assert row.world.row_picked[0] == pytest.approx(1.95)
    assert [event.what for event in row.events] == ["bin full"]


@pytest.mark.parametrize("y", [LANE + 1.01, LANE - 1.01, LANE - 2.75])
def test_beside_a_lane_nothing_is_picked(y):
    row = picker_with_bin(y=y)
    row.drive(20, **train(x=1.0))
    assert not row.world.row_picked.any()


def test_without_a_bin_nothing_is_picked():
    row = yard(("picker", Pose(ROW_WEST, LANE, EAST)))
    row.drive(20, picker_01=AHEAD)
    assert not row.world.row_picked.any()


def test_a_carrier_picks_nothing():
    row = yard(("carrier", Pose(ROW_WEST, LANE, EAST)), ("bin", Pose(ROW_WEST - 1.9, LANE, EAST)))
    row.couple("carrier_01", "bin_02")
    row.drive(20, carrier_01=AHEAD, bin_02=AHEAD)
    assert not row.world.row_picked.any()


def test_passing_a_lane_on_the_headland_begins_no_row():
    by = picker_with_bin(x=ROW_WEST - 0.05, y=LANE + 3, yaw=-math.pi / 2)
    by.drive(60, **train(x=1.0))
    assert not by.world.row_from.any()


def test_a_picker_picks_at_the_picking_speed_and_drives_on_at_its_own():
    row = picker_with_bin(picking_speed=0.25)
    row.drive(10, **train(x=0.25))
    row.drive(1, picker_01=AHEAD)
    assert row.of("twist", "picker_01")[0] == 0.25
    row.drive(1, picker_01=Twist(-1.0))
    assert row.of("twist", "picker_01")[0] == -0.25
    row.drive(1, picker_01=Twist(-1.0))
    assert row.of("twist", "picker_01")[0] == -1.0  # over what is picked
    row.world.fill[1] = 70.0
    row.put("picker_01", 0.0, LANE, EAST)
    row.put("bin_02", -2.25, LANE, EAST)
    row.drive(1, **train(x=1.0))
    assert row.of("twist", "picker_01")[0] == 1.0  # its bin is full


@settings(max_examples=30, deadline=None)
@given(st.lists(st.tuples(st.floats(-1, 1), st.integers(1, 80)), max_size=12))
def test_the_fruit_is_kept(course):
    """What is in the bin is what is missing in the rows, and neither ever shrinks."""
    row = picker_with_bin(x=ROW_WEST + 0.1)
    last = 0.0
    for speed, ticks in course:
        row.drive(ticks, **train(x=speed))
        assert row.of("fill", "bin_02") == pytest.approx(row.world.row_picked.sum(), abs=2e-6)
        assert row.of("fill", "bin_02") >= last
        last = row.of("fill", "bin_02")
    assert last <= max(row.of("distance", "picker_01"), 0.0) + 0.2


# -- unloading

BAY_X, BAY_Y = (BAY.west + BAY.east) / 2, (BAY.south + BAY.north) / 2


def carriers_in_bay(*x: float) -> Yard:
    """Carriers carrier_01, carrier_03 ... with full bins bin_02, bin_04 ..., the bins at these x in the bay, side by side."""
    bodies = []
    for k, bin_x in enumerate(x):
        y = BAY_Y - 0.85 + 1.7 * k
        bodies += [("carrier", Pose(bin_x + 1.9, y, EAST)), ("bin", Pose(bin_x, y, EAST))]
    bay = yard(*bodies)
    for k in range(len(x)):
        bay.couple(f"carrier_{2 * k + 1:02d}", f"bin_{2 * k + 2:02d}")
        bay.world.fill[2 * k + 1] = 70.0
    return bay


def test_five_seconds_at_rest_in_the_bay_empty_a_full_bin():
    bay = carriers_in_bay(BAY_X)
    bay.drive(49)
    assert bay.of("fill", "bin_02") == 70.0
    (event,) = bay.drive(1)
    assert (event.what, event.who, event.whom) == ("unloaded", "bin_02", "carrier_01")
    assert (bay.of("fill", "bin_02"), bay.world.delivered) == (0.0, 1)
    bay.drive(60)
    assert bay.world.delivered == 1


@pytest.mark.parametrize("moving", ["carrier_01", "bin_02"])
def test_who_moves_in_the_bay_begins_again(moving):
    bay = carriers_in_bay(BAY_X)
    bay.drive(40)
    bay.drive(1, **{moving: Twist(0.01)})
    bay.drive(49)
    assert bay.world.delivered == 0
    bay.drive(1)
    assert bay.world.delivered == 1


def test_the_bay_is_the_bins_place():
    outside = carriers_in_bay(BAY.west - 0.1)
    outside.drive(60)
    assert outside.world.delivered == 0


def test_a_bin_that_is_not_full_or_not_on_a_carrier_is_not_unloaded():
    bay = carriers_in_bay(BAY_X)
    bay.world.fill[1] = 69.9
    bay.drive(60)
    assert bay.world.delivered == 0
    loose = carriers_in_bay(BAY_X)
    loose.do("carrier_01", Uncouple())
    loose.drive(60)
    assert loose.world.delivered == 0
    picker = picker_with_bin(x=BAY_X + 2.25, y=BAY_Y)
    picker.world.fill[1] = 70.0
    picker.drive(60)
    assert picker.world.delivered == 0


def test_one_bin_at_a_time_is_unloaded_and_who_began_goes_on():
    bay = carriers_in_bay(BAY_X - 1.5, BAY_X + 1.7)
    bay.drive(1, carrier_01=Twist(yaw=0.01))  # bin_04 begins
    bay.drive(48)
    assert bay.world.delivered == 0
    assert [event.who for event in bay.drive(1)] == ["bin_04"]
    assert bay.drive(49) == []
    assert [event.who for event in bay.drive(1)] == ["bin_02"]
    assert bay.world.delivered == 2


# -- weeds


def weed_and_worker(distance: float) -> Yard:
    """worker_01 drives off along y, so many metres from weed_02, edge to edge."""
    return yard(("worker", Pose(0, 0, NORTH)), ("weed", Pose(0.5 + distance + 0.25, 0, EAST)))


def test_a_weed_is_flattened_when_something_moves_within_a_metre():
    near = weed_and_worker(0.99)
    near.drive(1, worker_01=Twist(0.1))
    assert [(e.what, e.whom) for e in near.do("weed_02", Flatten())] == [("weed flattened", "worker_01")]
    assert not near.of("alive", "weed_02")
    assert near.do("weed_02", Flatten())[0].what == "deed refused"


def test_a_weed_is_not_flattened_by_what_stands_or_is_farther():
    far = weed_and_worker(1.01)
    far.drive(1, worker_01=Twist(0.1))
    assert far.do("weed_02", Flatten())[0].what == "deed refused"
    still = weed_and_worker(0.5)
    assert still.do("weed_02", Flatten())[0].what == "deed refused"
    assert still.of("alive", "weed_02")


def test_a_weed_is_flattened_across_a_corner_by_the_straight_distance():
    corner = yard(("dog", Pose(0, 0, EAST)), ("weed", Pose(0.5 + 0.25 + 0.8, 0.4 + 0.25 + 0.8, EAST)))
    corner.drive(1, dog_01=Twist(0.001))
    assert corner.do("weed_02", Flatten())[0].what == "deed refused"
    corner.put("weed_02", 0.5 + 0.25 + 0.7, 0.4 + 0.25 + 0.7, EAST)
    corner.drive(1, dog_01=Twist(0.001))
    assert corner.do("weed_02", Flatten())[0].what == "weed flattened"


def test_only_weeds_are_flattened():
    near = yard(("worker", Pose(0, 0, NORTH)), ("visitor", Pose(1.1, 0, NORTH)))
    near.drive(1, worker_01=Twist(0.1))
    assert near.do("visitor_02", Flatten())[0].what == "deed refused"


# -- the end


def finished() -> Yard:
    """A harvest that is over."""
    end = everybody()
    end.world.row_picked[:] = 70.0
    end.drive(1)
    return end


def test_the_harvest_is_over_when_all_is_picked_unloaded_and_back():
    assert harvest_is_over(finished().world)


@pytest.mark.parametrize("missing", ["row", "bin", "place", "heading", "hitch", "rest", "picker"])
def test_the_harvest_is_not_over_before(missing):
    end = finished()
    world, carrier = end.world, end.world.index["carrier_01"]
    if missing == "row":
        world.row_picked[-1] = 69.9
    elif missing == "bin":
        world.fill[world.index["bin_01"]] = 70.0
    elif missing == "place":
        world.pose[carrier, :2] = 40.0, 24.5
    elif missing == "heading":
        world.pose[carrier, 2] = 1e-5
    elif missing == "hitch":
        end.do("carrier_01", Uncouple())
    elif missing == "rest":
        end.drive(1, carrier_01=Twist(0.001))
    else:
        end.drive(1, picker_01=Twist(0.001))
    assert not harvest_is_over(world)


# -- what agents are told


def test_everybody_is_told_its_place_and_its_hitch():
    told = picker_with_bin(yaw=NORTH)
    told.world.fill[1] = 70.0
    told.drive(1, picker_01=Twist(0.3))
    scans = Scanner(told.world.layout).scan(told.world)
    seen = observe(told.world, scans)
    picker, bin_ = seen["picker_01"], seen["bin_02"]
    assert picker.pose == pytest.approx(told.pose("picker_01"), abs=1e-15)
    assert (picker.tick, picker.twist, picker.full) == (1, (0.3, 0.0, 0.0), False)
    assert picker.hitch.name == "bin_02" and picker.hitch.scan is scans[1] and picker.scan is scans[0]
    assert picker.hitch.pose == pytest.approx(told.pose("bin_02"), abs=1e-15)
    assert bin_.hitch.name == "picker_01" and bin_.hitch.scan is None and bin_.hitch.twist == (0.3, 0.0, 0.0)
    assert (bin_.fill, bin_.full) == (70.0, True)
    told.world.coupled[:] = NOBODY
    assert observe(told.world, scans)["picker_01"].hitch is None
