"""A plain laser, to compare the compiled one of `orchard/sim/kernels/laser.py` with, and worlds to
try both in.

It is written in numpy without a thought for speed. A box is (x, y, half length, half width, yaw),
in metres and radians, in the frame of the orchard.
"""

from collections.abc import Sequence

import numpy as np

from orchard.field.geometry import Pose
from orchard.field.kinds import KINDS, LASER_RANGE
from orchard.field.lanes import ROW_WEST, Lane
from orchard.field.layout import Layout
from orchard.field.placement import Start
from orchard.field.scenario import Animals, People, Scenario
from orchard.sim.world import World

# m: what is so near to the edge of a box is on it.
TOUCH = 1e-9
# The wall of a world without walls, which must have one: no body comes there, and no laser sees it.
FAR_AWAY = (1000.0, 1000.0, 0.25, 0.25)
# y of row 1's centre line, from row to row, and between the trees of a row, m: the default ones.
FIRST_LANE = 10.75
ROW_PITCH = 5.5
ROW_WIDTH = 5.0


def world_of(
    *bodies: tuple[str, Pose],
    walls: list[tuple[float, float, float, float]] | None = None,
    **scenario,
) -> World:
    """Return a world with just these bodies, uncoupled, and these walls.

    Bodies: (kind, pose). Walls: (x, y, half length, half width), m.
    """
    nobody = {
        "people": People(workers=0, visitors=0),
        "animals": Animals(dogs=0, cats=0),
        "weeds": 0,
    }
    starts = tuple(
        Start(f"{kind}_{i + 1:02d}", kind, Pose(*pose)) for i, (kind, pose) in enumerate(bodies)
    )
    chosen = Scenario(**{"rows": 3, **nobody, **scenario})
    lanes = []
    for i in range(chosen.rows):
        lane = Lane(
            number=i + 1,
            y=FIRST_LANE - ROW_PITCH * i,
            picking_speed=chosen.mean_picking_speed,
            west=ROW_WEST,
            length=chosen.row_length,
            width=ROW_WIDTH,
        )
        lanes.append(lane)
    return World(Layout(chosen, tuple(lanes), (), {}, starts, np.array(walls or [FAR_AWAY])))


def boxes_seen_by(world: World, me: int) -> list[tuple[float, float, float, float, float]]:
    """Return the walls, and all solid bodies except the one with index `me`."""
    boxes = [(*wall, 0.0) for wall in world.layout.walls.tolist()]
    for i, start in enumerate(world.layout.starts):
        kind = KINDS[start.kind]
        if i != me and kind.solid:
            x, y, yaw = world.pose[i].tolist()
            boxes.append((x, y, kind.length / 2, kind.width / 2, yaw))
    return boxes


def bounds_of(world: World, me: int, slack: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and the most that a body may measure, (beams,) float64 m each.

    +inf means no return. A beam that grazes a box may hit or miss it: so each box counts as it is,
    and grown and shrunk by `slack` on all sides.
    """
    kind = KINDS[world.layout.starts[me].kind]
    x, y, yaw = world.pose[me].tolist()
    # The laser is at the front of the body.
    x, y = x + kind.laser.ahead * np.cos(yaw), y + kind.laser.ahead * np.sin(yaw)
    angles = yaw + kind.laser.first + kind.laser.increment * np.arange(kind.laser.beams)
    boxes = np.array(boxes_seen_by(world, me))
    # (inflations, boxes, beams), m.
    distances = np.array(
        [
            distance_to_box(x, y, angles, boxes.T[..., None], inflate)
            for inflate in (-slack, 0.0, slack)
        ]
    )
    least = distances.min(axis=(0, 1))
    # The nearest box ends a beam, so it counts however far the boxes behind it are.
    most = distances.max(axis=0).min(axis=0)
    return np.where(least <= LASER_RANGE + slack, least - slack, np.inf), np.where(
        most <= LASER_RANGE - slack, most + slack, np.inf
    )


def distance_to_box(
    x: float, y: float, angles: np.ndarray, box: Sequence, inflate: float = 0.0
) -> np.ndarray:
    """Return how far along each ray it first meets a box's edge, m; +inf where it does not.

    It is the method of slabs: a box is the common part of two strips, one along it and one across.
    A ray is in the box while it is in both strips. `angles`: (beams,) rad. `box`: five numbers, or
    five columns (boxes, 1) of many boxes; then a row is returned for each box.
    """
    box_x, box_y, half_length, half_width, yaw = box
    half_length = half_length + inflate
    half_width = half_width + inflate
    c, s = np.cos(yaw), np.sin(yaw)
    # Where the ray begins, in the frame of the box.
    along = c * (x - box_x) + s * (y - box_y)
    across = c * (y - box_y) - s * (x - box_x)
    outside = np.maximum(abs(along) - half_length, abs(across) - half_width)
    enter = -np.inf
    leave = np.inf
    for at, towards, half in (
        (along, np.cos(angles - yaw), half_length),
        (across, np.sin(angles - yaw), half_width),
    ):
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            low_side = (-half - at) / towards
            high_side = (half - at) / towards
        # A ray along a strip is in it always or never. Where it is always, the divisions give
        # infinities, or nan on a side; fmin and fmax pass over nan.
        never = (towards == 0.0) & (abs(at) > half)
        enter = np.fmax(enter, np.where(never, np.inf, np.fmin(low_side, high_side)))
        leave = np.fmin(leave, np.where(never, -np.inf, np.fmax(low_side, high_side)))
    # A ray that begins inside meets the edge where it leaves.
    hit = np.where(enter >= 0.0, enter, leave)
    distances = np.where((enter <= leave) & (leave >= 0.0), hit, np.inf)
    return np.where((outside >= -TOUCH) & (outside <= 0.0), 0.0, distances)
