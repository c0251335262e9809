"""Our own core in the peers' field: physics, scan and collisions, with robots that drive without agents."""

import time
from statistics import median

import numpy as np

from bench.clocked import MOST_STEPS
from bench.field import STEP, Field, velocities
from orchard.field.geometry import Pose
from orchard.field.kinds import name_of
from orchard.field.layout import Layout, Start
from orchard.field.scenario import TIME_STEP, Animals, People, Scenario
from orchard.sim.physics import step
from orchard.sim.scan import Scanner
from orchard.sim.world import World, new_world

ROBOT = "dog"  # the kind that has the size of field.py, and drives as robots do: forward and round

assert STEP == TIME_STEP


def world_of(place: Field) -> World:
    """An orchard's world with the field's walls and robots, and nothing else in it."""
    nobody = {"people": People(workers=0, visitors=0), "animals": Animals(dogs=0, cats=0), "weeds": 0, "tractor": False}
    starts = tuple(Start(name_of(ROBOT, i + 1), ROBOT, Pose(*pose)) for i, pose in enumerate(place.starts.tolist()))
    return new_world(Layout(Scenario(**nobody), (), {}, starts, place.walls))


def twists(robots: int, steps: int) -> np.ndarray:
    """(steps, robots, 3): what physics is asked for at each step."""
    forward_and_turn = velocities(robots, steps)
    return np.insert(forward_and_turn, 1, 0.0, axis=2)


def drive(world: World, scanner: Scanner, steps: int) -> None:
    """So many steps: each a scan of all robots, and their movement."""
    for twist in twists(len(world.pose), steps):
        scanner.scan(world)
        step(world, twist, [])


def steps_per_second(place: Field, seconds: float, repeats: int = 5) -> float:
    """The median of some stretches of so many seconds in all."""
    world = world_of(place)
    scanner, wanted = Scanner(world.layout), twists(len(place.starts), MOST_STEPS)
    drive(world, scanner, 3)  # what is compiled is loaded
    rates, k = [], 0
    for _ in range(repeats):
        begun, used, first = time.perf_counter(), time.process_time(), k
        while k == first or time.perf_counter() - begun < seconds / repeats:
            scanner.scan(world)
            step(world, wanted[k % MOST_STEPS], [])
            k += 1
        rates.append((k - first) / (time.process_time() - used))
    return median(rates)
