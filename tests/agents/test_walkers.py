"""The common behaviour of people and animals: they steer by their scans, and do not stay in one place."""

import numpy as np
import pytest
from quiet_orchards import meadow, one_guest
from stage import empty_orchard

from orchard.agents.walker import Person, WalkerMemory
from orchard.contract.agent import Mail, Observation
from orchard.field.geometry import Twist
from orchard.field.layout import lay_out
from orchard.field.scenario import Animals, People


def facing(*boxes: tuple[float, float]) -> Observation:
    """Return what a worker at the origin, facing east, observes of 1 m boxes with near sides at (metres ahead, metres to the left)."""
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


@pytest.mark.parametrize("kind", ["worker", "visitor"])
def test_people_walk_straight_on_where_nothing_is_in_their_path(kind):
    stage = one_guest(kind, -20.0, 20.0)
    stage.run(20)
    stage.assert_at(f"{kind}_01", 0.0, 20.0, "EAST")


AT_A_FENCE, IN_A_CORNER = (42.0, 8.0, 60, 40), (47.0, 31.0, 120, 30)  # x, y, s, and the least metres in that time


@pytest.mark.parametrize(("kind", "where"), [("worker", AT_A_FENCE), ("visitor", AT_A_FENCE), ("dog", IN_A_CORNER), ("cat", IN_A_CORNER)])
def test_walkers_turn_away_from_an_obstacle_and_go_on(kind, where):
    x, y, seconds, metres = where
    stage = one_guest(kind, x, y)
    stage.run(seconds)
    assert stage.world.distance[stage.world.index[f"{kind}_01"]] > metres
    assert stage.world.collisions.sum() == 0


@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.soak) for seed in (6, 16))])
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
