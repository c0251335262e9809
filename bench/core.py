"""Our own core in the peers' field: physics, scan and collisions, with robots that drive without agents."""

import time

import numpy as np

from bench.field import STEP, Field, velocities
from orchard.config import TIME_STEP, Animals, People, Scenario
from orchard.geometry import Pose
from orchard.kinds import name_of
from orchard.layout import Layout, Start
from orchard.physics import step
from orchard.scan import Scanner
from orchard.world import World, new_world

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


def seconds(place: Field, steps: int) -> float:
    """How long so many steps take: each a scan of all robots, and their movement."""
    world = world_of(place)
    scanner, wanted = Scanner(world.layout), twists(len(place.starts), steps)
    scanner.scan(world), step(world, wanted[0], [])  # what is compiled is loaded
    begun = time.perf_counter()
    for twist in wanted:
        scanner.scan(world)
        step(world, twist, [])
    return time.perf_counter() - begun
