"""What physics lets each body see at a tick."""

import numpy as np

from orchard.agent import Hitch
from orchard.geometry import Twist
from orchard.layout import ROW_LENGTH
from orchard.move_kernel import quaternions
from orchard.sights import Sights
from orchard.world import World


def observe(world: World, scans: list[np.ndarray]) -> Sights:
    """What all bodies see now, in body order; scans as the scanner gives them."""
    names = world.layout.names
    states = np.concatenate((world.pose[:, :2], quaternions(world.pose), world.twist), axis=1)
    coupled = np.flatnonzero(world.coupled >= 0).tolist()
    robots = world.bodies.tows > 0.0
    hitches = {names[i]: _hitch(world, states, scans, int(world.coupled[i]), bool(robots[i])) for i in coupled}
    fills = {names[i]: float(world.fill[i]) for i in np.flatnonzero(world.fill).tolist()}
    return Sights(world.tick, names, states, scans, hitches, fills, {name for name, fill in fills.items() if fill >= ROW_LENGTH})


def _hitch(world: World, states: np.ndarray, scans: list[np.ndarray], other: int, tows: bool) -> Hitch:
    """The other end of a body's bar, with its scan if the body tows it."""
    x, y, z, w, vx, vy, turn = states[other].tolist()
    return Hitch(world.layout.names[other], x, y, (z, w), Twist(vx, vy, turn), scans[other] if tows else None)
