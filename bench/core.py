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

# The kind of body with the size that field.py gives its robots; it drives forward and turns.
ROBOT = "dog"

# All simulators must make the same steps.
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
    """Return the median rate of `repeats` measurements, which together take `seconds`.

    Each goes on for its part of the wall time, and is counted in processor time.
    """
    world = world_of(area)
    scanner = Scanner(world)
    wanted = twists(len(area.starts), MOST_STEPS)
    # Not measured: they load the compiled kernels.
    drive(world, scanner, 3)
    rates = []
    done = 0
    for _ in range(repeats):
        begun = time.perf_counter()
        used = time.process_time()
        first = done
        while done == first or time.perf_counter() - begun < seconds / repeats:
            scanner.scan(world)
            step(world, wanted[done % MOST_STEPS], [])
            done += 1
        rates.append((done - first) / (time.process_time() - used))
    return median(rates)
