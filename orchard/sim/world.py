"""The state of the orchard, which only physics changes: all that a snapshot must hold."""

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from orchard.field.kinds import KINDS, LASER_RANGE
from orchard.field.layout import KEPT_LAYOUTS, Layout
from orchard.field.passes import FULL_WITHIN
from orchard.field.scenario import TIME_STEP
from orchard.sim.kernels.boxes import RADIUS, boxes_of
from orchard.sim.kernels.grid import Grid, frame_of, grid_of, space_for
from orchard.sim.kernels.move import ANYWHERE, NONE, full_bins, picked_metres

CELL = 10.0  # m: the smallest cell; smaller cells cost more time than they save

__all__ = ["NONE", "Fixed", "World"]


class Fixed(NamedTuple):
    """What a layout says of n bodies, r rows and w walls, as the kernels take it."""

    speed: np.ndarray  # (n,) m/s
    turn: np.ndarray  # (n,) rad/s
    tows: (
        np.ndarray
    )  # (n,) m from its centre back to the centre of its coupled bin; 0: it tows nothing
    solid: np.ndarray  # (n,) bool
    sideways: np.ndarray  # (n,) bool: bins, which move only while they are coupled
    shapes: np.ndarray  # (n, 7) boxes: half sizes and radius; `place` writes the other columns
    pickers: np.ndarray  # int64: their indices
    bin_full: float  # m: what fills a bin
    bin_least: float  # m: what is in a bin that is to be delivered, once its picker has left it
    row_share: np.ndarray  # (r,) m in a bin for each metre of the row: 1, unless each row fills one bin, however long it is
    row_west: np.ndarray  # (r,) m: x of the rows' west ends
    row_length: np.ndarray  # (r,) m
    row_y: np.ndarray  # (r,) m: the lanes' centre lines
    row_speed: np.ndarray  # (r,) m/s: the picking speeds
    walls: np.ndarray  # (w, 7): the boxes of fences, trunks and posts
    wall_frame: np.ndarray  # the Grid of the walls that a body in each cell could touch
    wall_begin: np.ndarray
    wall_members: np.ndarray
    body_frame: (
        np.ndarray
    )  # of a Grid of bodies: two that could touch within a step are in neighbouring cells
    walls_in_sight: Grid  # the Grid of the walls that a laser in each cell could reach
    carriers: np.ndarray  # int64: their indices


class Space(NamedTuple):
    """Arrays in which a step of n bodies works: a kernel that makes none is called in half the time."""

    boxes: np.ndarray  # (n, 7): the bodies at their poses
    cells: np.ndarray  # the Grid of the bodies, as `space_for` makes it
    cell_begin: np.ndarray
    cell_members: np.ndarray
    met: np.ndarray  # (n,) int64: the obstacle with which each body's collision begins: a body's index, n + a wall's, or NONE
    picked_from: np.ndarray  # of each picker, int64: the row from which it picked, or NONE
    before: np.ndarray  # of each picker, m: its x before the step
    full: np.ndarray  # (n,) bool


def _space_of(fixed: Fixed) -> Space:
    n, pickers = len(fixed.shapes), len(fixed.pickers)
    numbers = np.empty(n, dtype=np.int64), np.full(pickers, NONE, dtype=np.int64)
    return Space(
        fixed.shapes.copy(),
        *space_for(n, fixed.body_frame),
        *numbers,
        np.empty(pickers),
        np.empty(n, dtype=bool),
    )


@lru_cache(maxsize=KEPT_LAYOUTS)
def fixed_of(layout: Layout) -> Fixed:
    kinds = [KINDS[start.kind] for start in layout.starts]
    halves = np.array([(kind.length / 2, kind.width / 2) for kind in kinds]).reshape(-1, 2)
    shapes, speed = (
        boxes_of(np.zeros_like(halves), halves),
        np.array([kind.speed for kind in kinds], dtype=np.float64),
    )
    radius, step = (
        float(shapes[:, RADIUS].max(initial=0.0)),
        float(speed.max(initial=0.0)) * TIME_STEP,
    )
    walls = boxes_of(layout.walls[:, :2], layout.walls[:, 2:])
    return Fixed(
        speed,
        np.array([kind.turn for kind in kinds], dtype=np.float64),
        np.array([kind.tows for kind in kinds], dtype=np.float64),
        np.array([kind.solid for kind in kinds], dtype=bool),
        np.array([kind.sideways for kind in kinds], dtype=bool),
        shapes,
        np.array(
            [i for i, start in enumerate(layout.starts) if start.kind == "picker"], dtype=np.int64
        ),
        layout.metres_per_bin,
        FULL_WITHIN if layout.scenario.bin_metres else layout.metres_per_bin,
        np.array(
            [
                1.0 if layout.scenario.bin_metres else layout.row_length / lane.length
                for lane in layout.lanes
            ]
        ),
        np.array([lane.west for lane in layout.lanes]),
        np.array([lane.length for lane in layout.lanes]),
        np.array([lane.y for lane in layout.lanes]),
        np.array([lane.picking_speed for lane in layout.lanes]),
        walls,
        *_grid(walls.tobytes(), radius),
        frame_of(walls, max(CELL, 2.0 * (radius + step))),
        _grid(walls.tobytes(), LASER_RANGE),
        np.array(
            [i for i, start in enumerate(layout.starts) if start.kind == "carrier"], dtype=np.int64
        ),
    )


@lru_cache(maxsize=KEPT_LAYOUTS)
def _grid(walls: bytes, reach: float) -> Grid:
    """The grid of walls, which does not depend on the seed. It is read-only, as all constants."""
    return grid_of(np.frombuffer(walls).reshape(-1, RADIUS + 1), reach)


class World:
    """The state of n bodies and r rows. Poses are in the orchard's frame, twists in the body's frame; SI units."""

    def __init__(self, layout: Layout) -> None:
        """At tick 0, each body is at its start, and the bins are coupled."""
        n, rows = len(layout.starts), layout.scenario.rows
        self.layout, self.fixed = layout, fixed_of(layout)
        self.space = _space_of(self.fixed)
        self.tick = 0
        self.pose = np.array([start.pose for start in layout.starts], dtype=np.float64).reshape(
            n, 3
        )  # x, y, yaw
        self.twist = np.zeros(
            (n, 3)
        )  # forward, left, yaw rate of the last step; 0 if the step was refused
        self.coupled = np.full(
            n, NONE, dtype=np.int64
        )  # index of the body at the other end of the bar, or NONE
        self.fill = np.zeros(n)  # of bins, metres of row in the bin, 0 to what fills it
        self.alive = np.ones(n, dtype=bool)  # False for a flattened weed
        self.row_ends = np.zeros(
            (rows, 4)
        )  # metres picked from the row's west end, from its east end; and, while a pass picks a part
        # inside: as far as that is picked, from the west end, from the east end, else 0
        self.pick_from = np.full(n, ANYWHERE)  # x before which this picker picks nothing, m
        self.bay_ticks = np.zeros(
            n, dtype=np.int64
        )  # of bins, ticks at rest in the bay since it last moved
        self.delivered, self.delivered_metres = 0, 0.0  # bins unloaded, and what was in them
        self.distance = np.zeros(n)  # metres driven
        self.collisions = np.zeros(
            n, dtype=np.int64
        )  # that this body began; a collision lasts while its steps meet an obstacle
        self.refused = np.zeros(n, dtype=np.int64)  # steps refused because of the coupled bin
        self.blocked = np.zeros(
            n, dtype=bool
        )  # in a collision: the last step met an obstacle, and was refused
        self.stopped = np.zeros(n, dtype=bool)  # latched by an emergency stop; see stops.py
        self.charge = np.ones(n)  # of carriers' batteries, 0 flat to 1 full; see batteries.py
        self.plugged = np.zeros(n, dtype=bool)  # has a charger
        self.bias = np.zeros(
            (n, 2)
        )  # m: the slow error of each receiver in x and y; see sensors.py
        self.reckoned = (
            self.pose.copy()
        )  # the poses of odometry alone, kept if it has errors; see sensors.py
        for robot in layout.starts:
            if robot.bin:
                i, j = self.index[robot.name], self.index[robot.bin]
                self.coupled[i], self.coupled[j] = j, i

    @property
    def seconds(self) -> float:
        """Simulated time since the start of the run, s."""
        return self.tick * TIME_STEP

    @property
    def full(self) -> np.ndarray:
        """Which bodies are bins to be delivered, (n,) bool: full ones, and those that a picker has left part full."""
        full = np.empty(len(self.fill), dtype=bool)
        full_bins(
            self.fill,
            self.coupled,
            self.fixed.pickers,
            self.fixed.bin_full,
            self.fixed.bin_least,
            full,
        )
        return full

    @property
    def row_picked(self) -> np.ndarray:
        """Picked metres of each row, (r,)."""
        metres = np.empty(len(self.row_ends))
        picked_metres(self.row_ends, self.fixed.row_length, metres)
        return metres

    @property
    def rows_done(self) -> np.ndarray:
        """Which rows are picked to the end, (r,) bool."""
        return np.asarray(self.row_picked >= self.fixed.row_length - FULL_WITHIN)

    @property
    def has_picked(self) -> bool:
        """Whether a picker picked something in the last step."""
        return max(self.space.picked_from.tolist(), default=NONE) != NONE

    @property
    def is_any_stopped(self) -> bool:
        """Whether an emergency stop holds a robot."""
        return True in self.stopped.tolist()

    @property
    def is_any_plugged(self) -> bool:
        """Whether a carrier has a charger."""
        return True in self.plugged.tolist()

    @property
    def index(self) -> Mapping[str, int]:
        return self.layout.index

    @property
    def state(self) -> dict[str, Any]:
        return {
            name: value
            for name, value in vars(self).items()
            if name not in ("layout", "fixed", "space")
        }
