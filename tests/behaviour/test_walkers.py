"""People, animals and weeds: they steer by their scans, and what moves flattens weeds."""

from itertools import pairwise

import numpy as np
import pytest
from msgspec.structs import replace
from stage import Driven, Stage, Standing, empty_orchard, meadow, one_guest

from orchard.behaviour.walker import Animal, Person, WalkerMemory
from orchard.contract.agent import Mail, Observation
from orchard.field.geometry import Twist
from orchard.field.layout import lay_out
from orchard.field.scenario import Animals, People, Scenario
from orchard.local import Local


def facing(*boxes: tuple[float, float]) -> Observation:
    """Return what a worker sees of boxes of 1 m. The worker is at the origin and faces east.

    Each box has its near side at (metres ahead, metres to the left).
    """
    angles = np.radians(np.linspace(-90, 90, 180))
    scan = np.full(180, np.inf, dtype=np.float32)
    for ahead, left in boxes:
        across = ahead * np.tan(angles)
        hit = np.abs(across - left) < 0.5
        scan[hit] = np.minimum(scan[hit], (ahead / np.cos(angles[hit])).astype(np.float32))
    return Observation("worker_01", 5, 0.0, 0.0, (0.0, 1.0), Twist(1.0), scan)


def walk_on(seen: Observation) -> Twist:
    """Return the velocity of a worker that sees this."""
    person = Person(lay_out(empty_orchard(people=People(workers=1, visitors=0))), "worker_01")
    return person.tick(seen, Mail(), WalkerMemory(0.0, 0.0, 0)).twist


def test_walkers_mind_only_what_is_near_in_their_path():
    """A worker steers past what is in its path within four metres, and minds nothing else."""
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


# Where, m, for how many seconds, and the least metres that it walks in that time.
AT_A_FENCE = (42.0, 8.0, 60, 40)
IN_A_CORNER = (47.0, 31.0, 120, 30)


@pytest.mark.parametrize(
    ("kind", "where"),
    [("worker", AT_A_FENCE), ("visitor", AT_A_FENCE), ("dog", IN_A_CORNER), ("cat", IN_A_CORNER)],
)
def test_walkers_turn_away_from_an_obstacle_and_go_on(kind, where):
    x, y, seconds, metres = where
    stage = one_guest(kind, x, y)
    stage.run(seconds)
    assert stage.world.distance[stage.world.index[f"{kind}_01"]] > metres
    assert stage.world.collisions.sum() == 0


@pytest.mark.parametrize(
    "seed", [1, *(pytest.param(seed, marks=pytest.mark.soak) for seed in (6, 16))]
)
def test_nobody_stays_near_one_point_for_a_minute(seed):
    """No person or animal stays within a circle of 3 m for a minute."""
    stage = meadow(
        seed=seed,
        tractor=True,
        people=People(workers=3, visitors=3),
        animals=Animals(dogs=3, cats=3),
    )
    kinds = ("worker", "visitor", "dog", "cat")
    # Where each guest was at each second.
    tracks = {name: [] for name in stage.world.layout.names if name.startswith(kinds)}
    while stage.seconds < 600:
        stage.run(1)
        for name, track in tracks.items():
            track.append(stage.pose(name)[:2])
            if len(track) < 60:
                continue
            last_minute = np.array(track[-60:])
            middle = (last_minute.max(axis=0) + last_minute.min(axis=0)) / 2
            radius = np.hypot(*(last_minute - middle).T).max()
            assert radius > 3.0, f"{name} stays near {middle} until {stage.seconds} s"


@pytest.mark.parametrize("kind", ["dog", "cat"])
def test_animals_change_their_mind_every_three_seconds(kind):
    """Within 600 ticks, 60 s, it changes its mind at least 19 times, 30 ticks apart each time."""
    stage = one_guest(kind, 0.0, 20.0)
    speeds = []
    for _ in range(600):
        stage.tick()
        speeds.append(stage.local.memories[f"{kind}_01"].speed)
    changes = [i for i in range(1, 600) if speeds[i] != speeds[i - 1]]
    assert [later - earlier for earlier, later in pairwise(changes)] == [30] * (len(changes) - 1)
    assert len(changes) >= 19
    assert len(set(speeds)) == len(changes) + 1
    assert all(0 <= speed <= 3 for speed in speeds)


def test_animals_do_not_change_their_minds_in_the_same_tick():
    """Each of 20 animals has a phase of the 30 ticks, drawn by its name: they are spread."""
    layout = lay_out(Scenario(animals=Animals(dogs=10, cats=10)))
    phases = {
        Animal(layout, name).phase for name in layout.names if name.startswith(("dog", "cat"))
    }
    assert len(phases) > 8
    assert phases <= set(range(30))


def test_animals_change_their_mind_without_seeing_every_tick():
    """In realtime ticks may be left out."""
    seen = one_guest("dog", 0.0, 20.0).local.engine.observe()["dog_01"]
    dog = Animal(Local(Scenario()).engine.layout, "dog_01")
    memory = dog.tick(seen, Mail(), None).memory
    minds = []
    start = 60 - dog.phase
    for tick in (start - 1, start + 1, start + 29, start + 31):
        memory = dog.tick(replace(seen, tick=tick), Mail(), memory).memory
        minds.append(memory.speed)
    # The mind changes at `start`, and 30 ticks later.
    assert minds[0] != minds[1]
    assert minds[1] == minds[2]
    assert minds[2] != minds[3]


def test_weeds_disappear_when_something_moves_within_a_metre():
    stage = Stage(
        empty_orchard(weeds=1, people=People(workers=1, visitors=0)), worker_01=Driven(Twist(x=1.0))
    )
    stage.put("weed_01", 0.0, 20.0)
    # Passes with 0.75 m between their edges.
    stage.put("worker_01", -6.0, 21.5)
    stage.run_until(lambda: not stage.world.alive[stage.world.index["weed_01"]], 20)
    assert -2.0 < stage.pose("worker_01")[0] < -0.5


def test_a_weed_asks_only_for_what_can_flatten_it():
    """One body has flattened the weed and goes on there; another passes too far off."""
    stage = Stage(
        empty_orchard(weeds=2, people=People(workers=1, visitors=0)), worker_01=Driven(Twist(x=0.3))
    )
    stage.put("weed_01", 0.0, 20.0)
    # 1.15 m off: edges are 1.9 m - 0.5 m (half a worker) - 0.25 m (half a weed) apart.
    stage.put("weed_02", 0.0, 23.1)
    stage.put("worker_01", -2.0, 21.2)
    stage.run(20)
    assert stage.pose("worker_01")[0] > 3.5, "it has left"
    assert [event.who for event in stage.happened("weed flattened")] == ["weed_01"]
    assert not stage.happened("deed refused")


def test_weeds_stay_for_what_stands_still_or_passes_further_off():
    """worker_01 passes weed_01; worker_02 stands beside weed_02, 0.25 m from edge to edge."""
    stage = Stage(
        empty_orchard(weeds=2, people=People(workers=2, visitors=0)),
        worker_01=Driven(Twist(x=1.0)),
        worker_02=Standing(),
    )
    stage.put("weed_01", 0.0, 20.0)
    # Its edge passes 1.25 m from that of the weed.
    stage.put("worker_01", -6.0, 22.0)
    stage.put("weed_02", 20.0, 19.0)
    stage.put("worker_02", 20.0, 20.0)
    stage.run(12)
    assert stage.world.alive[[stage.world.index["weed_01"], stage.world.index["weed_02"]]].all()


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize(("speed", "y"), [(1.0, 21.5), (1.0, 21.7), (0.3, 21.5)])
def test_noise_hides_nothing_that_passes_from_a_weed(speed, y, seed):
    """A body passes slowly, its edge up to 0.95 m from the weed's.

    With noise it comes at most 0.3 m further than without.
    """
    at = [x_of_passer(noise, speed, y, seed) for noise in (0.0, 0.02)]
    assert abs(at[0] - at[1]) <= 0.3


def x_of_passer(noise, speed, y, seed) -> float:
    """Return the x at which a worker that drives east flattens the weed at (0, 20)."""
    orchard = empty_orchard(
        weeds=1, people=People(workers=1, visitors=0), laser={"noise": noise}, seed=seed
    )
    stage = Stage(orchard, worker_01=Driven(Twist(x=speed)))
    stage.put("weed_01", 0.0, 20.0)
    stage.put("worker_01", -3.0, y)
    stage.run_until(lambda: not stage.world.alive[stage.world.index["weed_01"]], 6.0 / speed)
    return float(stage.pose("worker_01")[0])
