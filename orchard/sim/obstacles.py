"""Which bodies are in the way of a robot that reports an obstacle: its laser sees returns only."""

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

REACH, ASIDE = (
    0.9,
    0.25,
)  # m ahead of its front edge and to each side: a little more than robots keep free
PLACES = {AHEAD: "ahead", IN_TURN: "in its turn"}


def with_names(world: World, robot: str, waits_for: str) -> str:
    """Return what a robot waits for, with the names of the bodies in place of 'an obstacle'. Fences and trees have no name."""
    if waits_for not in PLACES or robot not in world.index:
        return waits_for
    names = [
        _name(world, j) for j in _bodies_in_the_way(world, world.index[robot], waits_for == AHEAD)
    ]
    return f"{', '.join(names)} {PLACES[waits_for]}" if names else waits_for


def _name(world: World, body: int) -> str:
    names, other = world.layout.names, int(world.coupled[body])
    return (
        f"{names[body]} of {names[other]}"
        if kind_of(names[body]) == "bin" and other >= 0
        else names[body]
    )


def _bodies_in_the_way(world: World, robot: int, ahead: bool) -> list[int]:
    boxes = world.fixed.shapes.copy()
    place(world.pose, boxes)
    own, area = (
        boxes[robot],
        _box_ahead(boxes[robot]) if ahead else _box_around(boxes[robot], world.layout.names[robot]),
    )
    away = np.hypot(boxes[:, X] - own[X], boxes[:, Y] - own[Y])
    near = np.flatnonzero(
        world.fixed.solid & (away < area[RADIUS] + own[RADIUS] + boxes[:, RADIUS])
    ).tolist()
    others = [
        j
        for j in near
        if j not in (robot, int(world.coupled[robot])) and gap(area, boxes[j]) <= 0.0
    ]
    return sorted(others, key=lambda j: (float(gap(own, boxes[j])), j))


def _box_ahead(own: np.ndarray) -> np.ndarray:
    area, middle = own.copy(), own[HALF_LENGTH] + REACH / 2
    area[[X, Y]] = own[X] + middle * own[COSINE], own[Y] + middle * own[SINE]
    area[[HALF_LENGTH, HALF_WIDTH]] = REACH / 2, own[HALF_WIDTH] + ASIDE
    return area


def _box_around(own: np.ndarray, name: str) -> np.ndarray:
    area, reach = own.copy(), KINDS[kind_of(name)].tows + own[RADIUS]
    area[[HALF_LENGTH, HALF_WIDTH, RADIUS]] = reach, reach, 1.5 * reach
    return area
