"""Which bodies are in the way of a robot that reports an obstacle.

A robot cannot say that itself: its laser sees returns, and no names. So the world is asked when the
robot is shown to people. Boxes are rows of orchard/sim/kernels/boxes.py.
"""

import numpy as np

from orchard.contract.agent import AHEAD, IN_TURN
from orchard.field.kinds import KINDS, kind_of
from orchard.sim.kernels.boxes import (
    COSINE,
    HALF_LENGTH,
    HALF_WIDTH,
    RADIUS,
    SINE,
    X,
    Y,
    gap,
    place,
)
from orchard.sim.world import World

# What is "ahead" of a robot: up to so many m from its front edge, and from each of its sides. Both
# are a little more than robots keep free (docs/reference.md).
REACH = 0.9
ASIDE = 0.25
# What an agent says that it waits for -> the words behind the names of the bodies.
PLACES = {AHEAD: "ahead", IN_TURN: "in its turn"}


def with_names(world: World, robot: str, waits_for: str) -> str:
    """Return what a robot waits for, with the names of the bodies in place of 'an obstacle'.

    Fences and trees have no name.
    """
    if waits_for not in PLACES or robot not in world.index:
        return waits_for
    bodies = _bodies_in_the_way(world, world.index[robot], waits_for == AHEAD)
    if not bodies:
        return waits_for
    names = ", ".join(_name(world, body) for body in bodies)
    return f"{names} {PLACES[waits_for]}"


def _name(world: World, body: int) -> str:
    """Return the name of a body; of a bin with that of its robot."""
    names = world.layout.names
    partner = int(world.coupled[body])
    if kind_of(names[body]) == "bin" and partner >= 0:
        return f"{names[body]} of {names[partner]}"
    return names[body]


def _bodies_in_the_way(world: World, robot: int, ahead: bool) -> list[int]:
    """Return the solid bodies ahead of a robot, the nearest first. `ahead`: False for those around
    it.
    """
    boxes = world.fixed.shapes.copy()
    place(world.pose, boxes)
    own = boxes[robot]
    if ahead:
        area = _box_ahead(own)
    else:
        area = _box_around(own, world.layout.names[robot])
    # A first choice, by circles around the robot's centre. It leaves out nothing that is in the
    # area: the box ahead lies within twice the robot's radius, which are its own and the area's.
    away = np.hypot(boxes[:, X] - own[X], boxes[:, Y] - own[Y])
    is_near = away < area[RADIUS] + own[RADIUS] + boxes[:, RADIUS]
    itself = (robot, int(world.coupled[robot]))
    # (m from the robot, body).
    in_area = []
    for j in np.flatnonzero(world.fixed.solid & is_near).tolist():
        if j not in itself and gap(area, boxes[j]) <= 0.0:
            in_area.append((float(gap(own, boxes[j])), j))
    return [j for _, j in sorted(in_area)]


def _box_ahead(own: np.ndarray) -> np.ndarray:
    """Return the box ahead of a robot, (7,), that it keeps free. `own`: its own box."""
    area = own.copy()
    middle = own[HALF_LENGTH] + REACH / 2
    area[X] = own[X] + middle * own[COSINE]
    area[Y] = own[Y] + middle * own[SINE]
    area[HALF_LENGTH] = REACH / 2
    area[HALF_WIDTH] = own[HALF_WIDTH] + ASIDE
    return area


def _box_around(own: np.ndarray, name: str) -> np.ndarray:
    """Return the square around a robot, (7,), which it and its bin reach in a turn."""
    area = own.copy()
    reach = KINDS[kind_of(name)].tows + own[RADIUS]
    area[HALF_LENGTH] = reach
    area[HALF_WIDTH] = reach
    # From its middle to a corner are 1.42 of a side's half; a little more leaves nothing out.
    area[RADIUS] = 1.5 * reach
    return area
