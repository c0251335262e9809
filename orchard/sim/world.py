"""The state of the orchard: arrays with one row per body, in the order in which bodies move.

Only physics changes it. It contains all state that a snapshot must hold; constants are in the layout.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from orchard.field.kinds import KINDS
from orchard.field.layout import Layout
from orchard.field.scenario import TICKS_PER_SECOND, TIME_STEP
from orchard.sim.kernels.boxes import RADIUS, Grid, boxes_of, frame_of, grid_of
from orchard.sim.kernels.move import NONE, Bodies

CELL = 10.0  # m: the smallest cell; smaller cells cost more time than they save

__all__ = ["NONE", "World", "half_sizes", "new_world"]


@dataclass
class World:
    """The state of n bodies and r rows. Poses are in the orchard's frame, twists in the body's frame; SI units."""

    layout: Layout
    tick: int
    pose: np.ndarray  # (n, 3) float64: x, y, yaw
    twist: np.ndarray  # (n, 3) float64: forward, left, yaw rate of the last step; 0 if the step was refused
    coupled: np.ndarray  # (n,) int64: index of the body at the other end of the bar, or NONE
    fill: np.ndarray  # (n,) float64: of bins, metres of row in the bin, 0 to 70
    alive: np.ndarray  # (n,) bool: False for a flattened weed
    row_picked: np.ndarray  # (r,) float64: picked metres of each row, 0 to 70
    row_from: np.ndarray  # (r,) int64: the end at which picking began: 0 not yet, -1 west, +1 east
    bay_ticks: np.ndarray  # (n,) int64: of bins, ticks at rest in the bay since it last moved
    delivered: int = 0  # bins unloaded
    distance: np.ndarray = field(default_factory=lambda: np.zeros(0))  # (n,) float64: metres driven
    refused: np.ndarray = field(default_factory=lambda: np.zeros(0))  # (n,) int64: steps refused because of an obstacle
    held: np.ndarray = field(default_factory=lambda: np.zeros(0))  # (n,) int64: steps refused because of the coupled bin
    blocked: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))  # (n,) bool: the last step met an obstacle
    stopped: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))  # (n,) bool: latched by an emergency stop; see stops.py

    @property
    def index(self) -> dict[str, int]:
        return self.layout.index

    @property
    def seconds(self) -> float:
        return self.tick / TICKS_PER_SECOND

    @cached_property
    def bodies(self) -> Bodies:
        """The constant properties of each body."""
        return bodies_of(self.layout)

    @cached_property
    def walls(self) -> np.ndarray:
        """(w, 7): the boxes of fences, trunks and posts."""
        return boxes_of(self.layout.walls[:, :2], self.layout.walls[:, 2:])

    @cached_property
    def wall_grid(self) -> Grid:
        """The grid of the walls that a body in each cell could touch."""
        return grid_of(self.walls, self._radius)

    @cached_property
    def frame(self) -> np.ndarray:
        """The frame of a grid for bodies: two bodies that could touch within a step are in the same cell or in neighbouring cells."""
        step = float(self.bodies.speed.max(initial=0.0)) * TIME_STEP
        return frame_of(self.walls, max(CELL, 2.0 * (self._radius + step)))

    @property
    def _radius(self) -> float:
        """The radius of the circle around the largest body, m."""
        return float(self.bodies.boxes[:, RADIUS].max(initial=0.0))

    @cached_property
    def pickers(self) -> np.ndarray:
        """The indices of the pickers, int64."""
        return self._all_of("picker")

    @cached_property
    def carriers(self) -> np.ndarray:
        """The indices of the carriers, int64."""
        return self._all_of("carrier")

    @cached_property
    def planners(self) -> tuple[str, ...]:
        """The names of pickers and carriers: the harvest makes progress while they finish steps of their plans."""
        return tuple(self.layout.names[i] for i in [*self.pickers.tolist(), *self.carriers.tolist()])

    def _all_of(self, kind: str) -> np.ndarray:
        return np.array([i for i, start in enumerate(self.layout.starts) if start.kind == kind], dtype=np.int64)

    @cached_property
    def lane_y(self) -> np.ndarray:
        """The y of the lanes' centre lines, (r,), m."""
        return np.array([lane.y for lane in self.layout.lanes])


def new_world(layout: Layout) -> World:
    """Return the world at tick 0: each body is at its start, and the bins are coupled."""
    n, rows = len(layout.starts), layout.scenario.rows
    coupled = np.full(n, NONE, dtype=np.int64)
    for robot in layout.starts:
        if robot.bin:
            i, j = layout.index[robot.name], layout.index[robot.bin]
            coupled[i], coupled[j] = j, i
    return World(
        layout=layout,
        tick=0,
        pose=np.array([start.pose for start in layout.starts], dtype=np.float64).reshape(n, 3),
        twist=np.zeros((n, 3)),
        coupled=coupled,
        fill=np.zeros(n),
        alive=np.ones(n, dtype=bool),
        row_picked=np.zeros(rows),
        row_from=np.zeros(rows, dtype=np.int64),
        bay_ticks=np.zeros(n, dtype=np.int64),
        distance=np.zeros(n),
        refused=np.zeros(n, dtype=np.int64),
        held=np.zeros(n, dtype=np.int64),
        blocked=np.zeros(n, dtype=bool),
        stopped=np.zeros(n, dtype=bool),
    )


def bodies_of(layout: Layout) -> Bodies:
    """Return the constant properties of the bodies as arrays, in body order."""
    kinds = [KINDS[start.kind] for start in layout.starts]
    return Bodies(
        boxes=boxes_of(np.zeros((len(kinds), 2)), half_sizes(layout)),
        speed=np.array([kind.speed for kind in kinds], dtype=np.float64),
        turn=np.array([kind.turn for kind in kinds], dtype=np.float64),
        tows=np.array([kind.tows for kind in kinds], dtype=np.float64),
        solid=np.array([kind.solid for kind in kinds], dtype=bool),
        sideways=np.array([kind.sideways for kind in kinds], dtype=bool),
    )


def half_sizes(layout: Layout) -> np.ndarray:
    """Return half length and half width of each body, (n, 2), m."""
    return np.array([(KINDS[s.kind].length / 2, KINDS[s.kind].width / 2) for s in layout.starts]).reshape(-1, 2)
