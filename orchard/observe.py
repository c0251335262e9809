"""What physics tells each body at a tick."""

import numpy as np

from orchard.agent import Hitch, Observation
from orchard.geometry import Twist
from orchard.layout import ROW_LENGTH
from orchard.move_kernel import quaternions
from orchard.world import World


def observe(world: World, scans: list[np.ndarray]) -> dict[str, Observation]:
    """Name -> what that body sees now; scans as the scanner gives them, one a body, in body order."""
    tick, names = world.tick, world.layout.names
    poses, orientations = world.pose.tolist(), list(map(tuple, quaternions(world.pose).tolist()))
    twists = list(map(Twist._make, world.twist.tolist()))
    coupled, fills, robots = world.coupled.tolist(), world.fill.tolist(), (world.bodies.tows > 0.0).tolist()
    seen = {}
    for i, name in enumerate(names):
        x, y, _ = poses[i]
        hitch, j = None, coupled[i]
        if j >= 0:
            hitch = Hitch(names[j], poses[j][0], poses[j][1], orientations[j], twists[j], scans[j] if robots[i] else None)
        fill = fills[i]
        seen[name] = Observation(name, tick, x, y, orientations[i], twists[i], scans[i], hitch, fill, fill >= ROW_LENGTH)
    return seen
