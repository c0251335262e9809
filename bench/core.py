"""Our own core in the field of the peers: physics, scans and collisions, with robots that drive
without agents.
"""

import time
from statistics import median
from typing import Any

import numpy as np

from bench.field import STEP, Field, velocities
from bench.timing import MOST_STEPS
from orchard.field.geometry import Pose
from orchard.field.kinds import name_of
from orchard.field.layout import Layout
from orchard.field.placement import Start
from orchard.field.scenario import TIME_STEP, Animals, People, Scenario
from orchard.sim.physics import step
from orchard.sim.scan import Scanner
from orchard.sim.world import World

ROBOT = "dog"  # the kind with the size that field.py gives; it drives forward and turns

assert STEP == TIME_STEP


def world_of(area: Field) -> World:
    """Return a world with only the walls and robots of the field."""
    no_obstacles: dict[str, Any] = {
        "people": People(workers=0, visitors=0),
        "animals": Animals(dogs=0, cats=0),
        "weeds": 0,
        "tractor": False,
    }
    starts = tuple(
        Start(name_of(ROBOT, i + 1), ROBOT, Pose(*pose))
        for i, pose in enumerate(area.starts.tolist())
    )
    return World(Layout(Scenario(**no_obstacles), (), (), {}, starts, area.walls))


def twists(robots: int, steps: int) -> np.ndarray:
    """Return the twists that physics gets, (steps, robots, 3): m/s forward, m/s sideways (0),
    rad/s.
    """
    forward_and_turn = velocities(robots, steps)
    return np.insert(forward_and_turn, 1, 0.0, axis=2)


def drive(world: World, scanner: Scanner, steps: int) -> None:
    """Run `steps` steps: each scans and moves all robots."""
    for twist in twists(len(world.pose), steps):
        scanner.scan(world)
        step(world, twist, [])


def steps_per_second(area: Field, seconds: float, repeats: int = 5) -> float:
    """Return the median rate of `repeats` measurements, which together take `seconds`."""
    world = world_of(area)
    scanner, wanted = Scanner(world), twists(len(area.starts), MOST_STEPS)
    drive(world, scanner, 3)  # loads the compiled kernels
    rates, k = [], 0
    for _ in range(repeats):
        begun, used, first = time.perf_counter(), time.process_time(), k
        while k == first or time.perf_counter() - begun < seconds / repeats:
            scanner.scan(world)
            step(world, wanted[k % MOST_STEPS], [])
            k += 1
        rates.append((k - first) / (time.process_time() - used))
    return median(rates)
