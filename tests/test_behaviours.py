"""One test or more for every behaviour that the manual gives, in the order of its headings."""

import numpy as np
import pytest
from stage import Driven, Stage, Standing, empty_orchard

from orchard.agent import Action, Mail, Observation
from orchard.agents.person import Person
from orchard.agents.walker import WalkerMemory, tell_where
from orchard.config import Animals, People
from orchard.geometry import HEADINGS, Twist
from orchard.layout import QUEUE_HEAD, lay_out
from orchard.messages import BinState, State
from orchard.steps import Again, Ahead, DriveTo, Face, MoveTo, Realign


def meadow(**changes) -> Stage:
    """An orchard whose pickers and carriers do nothing until they are given a plan; carrier_01 stands free of the others."""
    stage = Stage(empty_orchard(**changes))
    for name in stage.local.agents:
        if name.startswith(("picker", "carrier")):
            stage.give(name, [])
    return stage


def one_guest(kind: str, x: float, y: float, heading: str = "EAST") -> Stage:
    """An orchard with nobody about but one worker, visitor, dog or cat, and nobody working."""
    people = People(workers=int(kind == "worker"), visitors=int(kind == "visitor"))
    animals = Animals(dogs=int(kind == "dog"), cats=int(kind == "cat"))
    stage = meadow(people=people, animals=animals)
    stage.put(f"{kind}_01", x, y, heading)
    return stage


# -- sensing


def test_sensing_a_robot_stops_for_what_its_laser_sees():
    stage = one_guest("worker", 0.0, 18.0)
    stage.local.agents["worker_01"] = Standing()
    stage.put("carrier_01", -10.0, 18.0)
    stage.give("carrier_01", [DriveTo(x=10.0)])
    stage.run(30)
    front = stage.pose("carrier_01")[0] + 0.9
    assert 0.6 < (0.0 - 0.275) - front <= 0.8, "stops 0.8 m before the worker, less at most one step"
    stage.assert_no_collisions()


# -- turning


@pytest.mark.parametrize(("heading", "seconds"), [("NORTH", 4.0), ("SOUTH", 4.0), ("WEST", 8.0)])
def test_turning_by_ninety_degrees_takes_four_seconds_and_is_exact(heading, seconds):
    stage = meadow()
    stage.put("carrier_01", 0.0, 20.0)
    stage.give("carrier_01", [Face(heading)])
    took = stage.run_until(lambda: not stage.local.memories["carrier_01"].plan, 20)
    assert took == pytest.approx(seconds + 0.1), "a tick more to see that it is done"
    stage.assert_at("carrier_01", 0.0, 20.0, heading)


def test_turning_waits_while_something_stands_in_what_the_bin_will_sweep():
    stage = one_guest("worker", -2.0, 21.6)
    stage.local.agents["worker_01"] = Standing()
    stage.put("carrier_01", 0.0, 20.0)
    stage.give("carrier_01", [Face("SOUTH")])  # to the right: the bin swings to the north, where the worker stands
    stage.run(10)
    stage.assert_at("carrier_01", 0.0, 20.0, "EAST")
    stage.assert_no_collisions()
    assert stage.local.actions["carrier_01"].waits_for == "an obstacle in its turn"


# -- directed movement


@pytest.mark.parametrize("metres", [3.0, 2.55, 0.04])
def test_directed_movement_by_x_metres_ends_there_with_the_remainder_driven_slower(metres):
    stage = meadow()
    stage.put("carrier_01", 0.0, 20.0)
    stage.give("carrier_01", [Ahead(metres)])
    stage.run(metres + 1)
    stage.assert_at("carrier_01", metres, 20.0, "EAST")


def test_directed_movement_to_a_point_goes_along_its_own_axis_first():
    stage = meadow()
    stage.put("carrier_01", 0.0, 18.0)
    stage.give("carrier_01", [MoveTo(6.0, 24.0)])
    stage.run_until(lambda: stage.pose("carrier_01")[1] > 18.1, 60)
    stage.assert_at("carrier_01", x=6.0, heading="NORTH")
    stage.run_until(lambda: not stage.local.memories["carrier_01"].plan, 60)
    stage.assert_at("carrier_01", 6.0, 24.0, "NORTH")


def test_directed_movement_to_a_point_behind_turns_about():
    stage = meadow()
    stage.put("carrier_01", 0.0, 18.0)
    stage.give("carrier_01", [MoveTo(-5.0, 18.0)])
    stage.run_until(lambda: not stage.local.memories["carrier_01"].plan, 60)
    stage.assert_at("carrier_01", -5.0, 18.0, "WEST")


def test_directed_movement_ends_right_although_something_was_in_the_way():
    stage = one_guest("worker", 0.0, 18.0, "NORTH")
    stage.local.agents["worker_01"] = Standing()
    stage.put("carrier_01", -6.0, 18.0)
    stage.give("carrier_01", [DriveTo(x=4.3)])
    stage.run_until(lambda: stage.local.actions and stage.local.actions["carrier_01"].waits_for == "an obstacle ahead", 20)
    stage.local.agents["worker_01"] = Driven(Twist(x=1.0))  # it walks away to the north
    stage.run_until(lambda: not stage.local.memories["carrier_01"].plan, 60)
    stage.assert_at("carrier_01", 4.3, 18.0, "EAST")


# -- awareness


@pytest.mark.parametrize("off", [0.3, -0.3, 0.02, -1e-5])
def test_awareness_realigns_to_the_nearest_heading_exactly(off):
    stage = meadow()
    stage.put("carrier_01", 0.0, 20.0)
    i, j = (stage.world.index[name] for name in ("carrier_01", stage.bin_of("carrier_01")))
    stage.world.coupled[[i, j]] = -1
    stage.world.pose[j] = 20.0, 20.0, 0.0
    stage.world.pose[i, 2] = HEADINGS["NORTH"] + off
    stage.give("carrier_01", [Realign()])
    stage.run_until(lambda: not stage.local.memories["carrier_01"].plan, 20)
    stage.assert_at("carrier_01", 0.0, 20.0, "NORTH")


# -- following


@pytest.mark.parametrize("robot", ["picker_01", "carrier_01"])
def test_following_a_bin_keeps_its_place_behind_its_robot(robot):
    stage = meadow()
    stage.put(robot, -15.0, 20.0)
    stage.give(robot, [MoveTo(-5.0, 26.0), MoveTo(10.0, 20.0), Face("NORTH"), Face("SOUTH"), DriveTo(y=19.0)])
    fruit = stage.bin_of(robot)
    worst = 0.0
    while stage.local.memories[robot].plan:
        assert stage.seconds < 120
        stage.tick()
        worst = max(worst, off_its_place(stage, robot, fruit))
    stage.run(0.2)
    assert 0.05 < worst <= 0.15
    assert off_its_place(stage, robot, fruit) < 1e-9, "exactly on its place at rest"
    assert stage.world.held.sum() == 0


def off_its_place(stage: Stage, robot: str, fruit: str) -> float:
    from orchard.geometry import Pose, from_frame
    from orchard.kinds import KINDS, kind_of

    x, y = from_frame(Pose(*stage.pose(robot)), -KINDS[kind_of(robot)].tows, 0.0)
    here = stage.pose(fruit)
    return ((here[0] - x) ** 2 + (here[1] - y) ** 2) ** 0.5


# -- random animals


@pytest.mark.parametrize("kind", ["dog", "cat"])
def test_random_animals_change_direction_and_speed_every_three_seconds(kind):
    stage = one_guest(kind, 0.0, 20.0)
    speeds = []
    for _ in range(20):
        stage.run(3)
        speeds.append(stage.local.memories[f"{kind}_01"].speed)
    assert len(set(speeds)) == 20
    assert all(0 <= speed <= 3 for speed in speeds)


# -- pickers


def test_pickers_begin_at_the_head_of_their_lane_and_pick_it_to_the_end():
    stage = Stage(empty_orchard())
    stage.assert_at("picker_01", x=-35.5, y=stage.world.layout.lane(1).y, heading="EAST")
    fruit = stage.bin_of("picker_01")
    took = stage.run_until(lambda: stage.is_full(fruit), 80)
    assert took == pytest.approx(70.0)
    stage.assert_at("picker_01", x=34.5, y=stage.world.layout.lane(1).y, heading="EAST")


def test_pickers_stop_for_an_obstacle_and_go_on_when_it_has_moved():
    stage = Stage(empty_orchard(people=People(workers=1, visitors=0)), worker_01=Standing())
    stage.put("worker_01", 0.0, stage.world.layout.lane(1).y, "NORTH")
    stage.run_until(lambda: stage.local.actions and stage.local.actions["picker_01"].waits_for == "an obstacle ahead", 60)
    stage.run(20)
    assert stage.pose("picker_01")[0] < 0.0
    stage.local.agents["worker_01"] = Driven(Twist(x=1.0))
    stage.run_until(lambda: stage.world.row_picked[0] == 70.0, 80)
    stage.assert_no_collisions()


def test_pickers_leave_the_full_bin_and_swap_it_for_an_empty_one_by_a_carrier():
    stage = Stage(empty_orchard())
    full = stage.bin_of("picker_01")
    stage.run_until(lambda: stage.is_full(full) and not stage.bin_of("picker_01"), 100)
    stage.assert_at(full, x=32.25)
    stage.run_until(lambda: bool(stage.bin_of("picker_01")), 200)
    assert stage.bin_of("picker_01") != full
    stage.assert_at("picker_01", x=40.5, heading="EAST")


def test_pickers_go_on_to_the_next_lane_with_their_empty_bin():
    stage = Stage(empty_orchard())
    stage.run_until(lambda: stage.world.row_picked[2] > 0.1, 400)  # picker_02 has rows 2 and 3
    stage.assert_at("picker_02", y=stage.world.layout.lane(3).y, heading="WEST")


# -- carriers


def test_carriers_line_up_in_a_queue_at_the_top_right():
    stage = Stage(empty_orchard(rows=5, pickers=5))
    xs = [stage.pose(f"carrier_0{i}")[0] for i in (1, 2, 3, 4)]
    assert xs[0] == QUEUE_HEAD
    assert xs == sorted(xs, reverse=True)
    stage.run(5)
    stage.assert_at("carrier_01", QUEUE_HEAD, 24.5, "EAST")


def test_carriers_stop_for_an_obstacle_on_the_road():
    stage = Stage(empty_orchard(people=People(workers=1, visitors=0)), worker_01=Standing())
    stage.put("worker_01", 38.25, 17.0, "NORTH")
    stage.run(120)
    assert stage.pose("carrier_01")[1] > 17.5, "it waits for as long as the worker stands there"
    stage.assert_no_collisions()


def test_carriers_bring_the_full_bin_to_the_driveway_and_come_back_to_the_queue():
    stage = Stage(empty_orchard())
    stage.run_until(lambda: stage.world.delivered == 1, 500)
    unloader = stage.happened("unloaded")[0]
    carrier = next(n for n in stage.world.layout.names if n.startswith("carrier") and stage.bin_of(n) == unloader.who)
    assert 23.5 < stage.pose(carrier)[1] < 25.5
    assert stage.world.fill[stage.world.index[unloader.who]] == 0.0
    stage.run_until(lambda: stage.doing(carrier) == "waiting in the queue", 200)


def test_carriers_do_not_answer_calls_while_they_work():
    stage = Stage(empty_orchard(carriers=1, rows=3, pickers=3))
    stage.run_to_the_end()
    jobs = [event for event in stage.happened("uncoupled") if event.who == "carrier_01"]
    assert len(jobs) == 3, "one exchange after another, none lost"


# -- bins


class Asker:
    """Asks bin_01 for its state at the beginning, and when it has been left full."""

    Memory = dict

    def __init__(self) -> None:
        self.answers: list = []

    def tick(self, seen: Observation, mail: Mail, memory: object) -> Action:
        self.answers += [reply.body for reply in mail.replies]
        return Action(requests=[("bin_01", State())] if seen.tick in (0, 720) else [], memory=memory)


def test_bins_tell_whether_they_are_full_and_on_whom():
    asker = Asker()
    stage = Stage(empty_orchard(), asker=asker)
    stage.run(73)
    begun, left = asker.answers
    assert (begun.full, begun.coupled_to) == (False, "picker_01")
    assert begun.fill == pytest.approx(0.1), "asked at 0 s, heard at 0.1 s"
    assert left == BinState(full=True, fill=70.0, coupled_to="")


# -- weeds


def test_weeds_disappear_when_something_moves_within_a_metre():
    stage = Stage(empty_orchard(weeds=1, people=People(workers=1, visitors=0)), worker_01=Driven(Twist(x=1.0)))
    stage.put("weed_01", 0.0, 20.0)
    stage.put("worker_01", -6.0, 21.5)  # passes with 0.75 m between their edges
    stage.run_until(lambda: not stage.world.alive[stage.world.index["weed_01"]], 20)
    assert -2.0 < stage.pose("worker_01")[0] < -0.5


def test_weeds_stay_for_what_stands_still_or_passes_further_off():
    stage = Stage(empty_orchard(weeds=2, people=People(workers=2, visitors=0)), worker_01=Driven(Twist(x=1.0)), worker_02=Standing())
    stage.put("weed_01", 0.0, 20.0)
    stage.put("worker_01", -6.0, 22.0)  # 1.25 m
    stage.put("weed_02", 20.0, 19.0)
    stage.put("worker_02", 20.0, 20.0)
    stage.run(12)
    assert stage.world.alive[[stage.world.index["weed_01"], stage.world.index["weed_02"]]].all()


# -- people


@pytest.mark.parametrize("kind", ["worker", "visitor"])
def test_people_walk_straight_on_where_nothing_is_in_their_path(kind):
    stage = one_guest(kind, -20.0, 20.0)
    stage.run(20)
    stage.assert_at(f"{kind}_01", 0.0, 20.0, "EAST")


@pytest.mark.parametrize("kind", ["worker", "visitor"])
def test_people_turn_away_from_an_obstacle_and_walk_on_in_the_new_direction(kind):
    stage = one_guest(kind, 42.0, 8.0)  # towards the east fence
    stage.run(60)
    assert stage.world.distance[stage.world.index[f"{kind}_01"]] > 40
    assert stage.world.refused.sum() == 0


# -- tractors


def test_the_tractor_drives_twenty_metres_waits_and_turns_about():
    stage = meadow(tractor=True)
    stage.assert_at("tractor_01", -45.0, 29.0, "EAST")
    stage.run_until(lambda: stage.doing("tractor_01") == "being loaded" if stage.local.actions else False, 30)
    stage.assert_at("tractor_01", -25.0, 29.0, "EAST")
    assert stage.run_until(lambda: stage.doing("tractor_01") == "turning about", 10) == pytest.approx(5.0)
    stage.run(7.9)
    stage.assert_at("tractor_01", x=-25.0, heading="WEST")
    stage.run_until(lambda: stage.doing("tractor_01") == "being unloaded", 30)
    stage.assert_at("tractor_01", -45.0, 29.0, "WEST")


def test_the_tractor_stops_for_an_obstacle_and_waits_for_it_to_move():
    stage = meadow(tractor=True, people=People(workers=1, visitors=0))
    stage.local.agents["worker_01"] = Standing()
    stage.put("worker_01", -35.0, 29.0, "NORTH")
    stage.run(30)
    assert stage.pose("tractor_01")[0] + 2.5 < -35.5
    stage.local.agents["worker_01"] = Driven(Twist(x=1.0))
    stage.run_until(lambda: stage.doing("tractor_01") == "being loaded", 30)
    stage.assert_no_collisions()


# -- animals


@pytest.mark.parametrize("kind", ["dog", "cat"])
def test_animals_turn_away_from_obstacles(kind):
    stage = one_guest(kind, 47.0, 31.0)  # in a corner between two fences
    stage.run(120)
    assert stage.world.distance[stage.world.index[f"{kind}_01"]] > 30
    assert stage.world.refused[stage.world.index[f"{kind}_01"]] < 20


@pytest.mark.parametrize("seed", [1, 6, 16])
def test_nobody_stays_within_a_circle_of_three_metres_for_a_minute(seed):
    stage = meadow(seed=seed, tractor=True, people=People(workers=3, visitors=3), animals=Animals(dogs=3, cats=3))
    guests = [n for n in stage.world.layout.names if n.split("_")[0] in ("worker", "visitor", "dog", "cat")]
    tracks = {name: [] for name in guests}
    while stage.seconds < 600:
        stage.run(1)
        for name, track in tracks.items():
            track.append(stage.pose(name)[:2])
            lately = np.array(track[-60:])
            middle = (lately.max(axis=0) + lately.min(axis=0)) / 2
            assert len(track) < 60 or np.hypot(*(lately - middle).T).max() > 3.0, f"{name} stays near {middle} until {stage.seconds} s"


# -- what a walker makes of its scan


def facing(*boxes: tuple[float, float]) -> Observation:
    """What a worker at the origin, facing east, sees of one-metre boxes whose near sides are at (metres ahead, metres to the left)."""
    angles = np.radians(np.linspace(-90, 90, 180))
    scan = np.full(180, np.inf, dtype=np.float32)
    for ahead, left in boxes:
        across = ahead * np.tan(angles)
        hit = np.abs(across - left) < 0.5
        scan[hit] = np.minimum(scan[hit], (ahead / np.cos(angles[hit])).astype(np.float32))
    return Observation("worker_01", 5, 0.0, 0.0, (0.0, 1.0), Twist(1.0), scan)


def walk_on(seen: Observation) -> Twist:
    person = Person(lay_out(empty_orchard(people=People(workers=1, visitors=0))), "worker_01")
    return person.tick(seen, Mail(), WalkerMemory(0.0, 0.0, 0)).twist


def test_walkers_mind_only_what_is_in_their_path_and_within_four_metres():
    assert walk_on(facing()) == Twist(x=1.0)
    assert walk_on(facing((4.5, 0.0))) == Twist(x=1.0)
    assert walk_on(facing((2.0, 3.0))) == Twist(x=1.0)
    assert walk_on(facing((3.0, 0.0))) != Twist(x=1.0)


@pytest.mark.parametrize(("other", "sign"), [(2.0, -1), (-2.0, 1)])
def test_walkers_steer_to_the_freer_side_while_they_walk_on(other, sign):
    twist = walk_on(facing((3.0, 0.0), (2.0, other)))
    assert twist.x == 1.0
    assert twist.yaw * sign > 0


def test_walkers_stop_and_turn_left_within_a_metre():
    twist = walk_on(facing((0.8, 0.0)))
    assert twist.x == 0.0
    assert twist.yaw > 0


def test_animals_keep_their_mind_for_three_seconds():
    stage = one_guest("dog", 0.0, 20.0)
    minds = []
    for _ in range(300):
        stage.tick()
        minds.append(stage.local.memories["dog_01"].speed)
    changes = [i for i in range(1, 300) if minds[i] != minds[i - 1]]
    assert changes == list(range(30, 300, 30))


# -- safety


def test_a_carrier_at_work_stops_for_a_person_beside_the_bin_that_it_ignores():
    stage = Stage(empty_orchard(people=People(workers=1, visitors=0)), worker_01=Standing())
    stage.put("worker_01", 33.2, stage.world.layout.lane(1).y - 1.9, "NORTH")  # in the way of its loop, a metre off the full bin
    stage.run(300)
    assert stage.bin_of("picker_01"), "the empty bin was delivered"
    assert stage.is_full("bin_01")
    stage.assert_at("bin_01", x=32.25)
    stage.assert_no_collisions()


def test_a_robot_stands_for_a_second_after_a_step_that_physics_refused():
    stage = meadow()
    stage.put("carrier_01", 0.0, 20.0)
    stage.put("carrier_02", 0.0, 17.0)
    stage.local.agents["carrier_02"] = Driven(Twist(x=0.0))
    stage.give("carrier_01", [Again([DriveTo(x=5.0)])], moving=True)
    stage.tick()
    assert stage.pose("carrier_01")[0] == 0.0
    assert stage.local.actions["carrier_01"].waits_for == "what it bumped into"
    stage.run(1.0)
    assert stage.pose("carrier_01")[0] > 0.0


def test_the_tractor_does_not_turn_while_somebody_stands_where_no_laser_looks():
    stage = meadow(tractor=True, people=People(workers=1, visitors=0))
    stage.local.agents["worker_01"] = Told()
    stage.put("worker_01", -27.2, 31.2, "NORTH")  # beside its tail, when it has come to the east end
    stage.run_until(lambda: stage.local.actions and stage.local.actions["tractor_01"].waits_for == "worker_01", 60)
    stage.run(20)
    stage.assert_at("tractor_01", -25.0, 29.0, "EAST")
    stage.assert_no_collisions()


class Told:
    """A person that stands, and tells where."""

    Memory = dict

    def tick(self, seen: Observation, mail: Mail, memory: object) -> Action:
        return Action(answers=tell_where(seen, mail), memory=memory)
