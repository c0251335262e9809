"""The state of the orchard: arrays, one row per body, in the order in which bodies move.

Physics alone changes it. Everything that a snapshot must hold is in here; what never changes is in the layout.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from orchard.field.kinds import KINDS
from orchard.field.layout import Layout
from orchard.field.scenario import TIME_STEP
from orchard.sim.kernels.boxes import RADIUS, Grid, boxes_of, frame_of, grid_of
from orchard.sim.kernels.move import NOBODY, Bodies

CELL = 10.0  # m, at least: smaller ones are more work than they save

__all__ = ["NOBODY", "World", "half_sizes", "new_world"]


@dataclass
class World:
    """n bodies, r rows. Poses in the orchard's frame, twists in the body's; SI units."""

    layout: Layout
    tick: int
    pose: np.ndarray  # (n, 3) float64: x, y, yaw
    twist: np.ndarray  # (n, 3) float64: what each body moved with in the last step; 0 where a step was refused
    coupled: np.ndarray  # (n,) int64: index of the body at the other end of the bar, or NOBODY
    fill: np.ndarray  # (n,) float64: of bins, metres of row in it, 0 to 70
    alive: np.ndarray  # (n,) bool: False for a weed that is flattened
    row_picked: np.ndarray  # (r,) float64: metres of each row that are picked, 0 to 70
    row_from: np.ndarray  # (r,) int64: the end at which its picking began: 0 not yet, -1 west, +1 east
    bay_ticks: np.ndarray  # (n,) int64: of bins, ticks at rest in the bay since it last moved
    delivered: int = 0  # bins unloaded
    distance: np.ndarray = field(default_factory=lambda: np.zeros(0))  # (n,) float64: metres driven
    refused: np.ndarray = field(default_factory=lambda: np.zeros(0))  # (n,) int64: steps that would have overlapped
    held: np.ndarray = field(default_factory=lambda: np.zeros(0))  # (n,) int64: steps that the bar held back
    blocked: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))  # (n,) bool: the last step was refused
    stopped: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))  # (n,) bool: latched by an emergency stop; see stops.py

    @property
    def index(self) -> dict[str, int]:
        return self.layout.index

    @property
    def seconds(self) -> float:
        return self.tick / 10

    @cached_property
    def bodies(self) -> Bodies:
        """What physics must know of each body's kind."""
        return bodies_of(self.layout)

    @cached_property
    def walls(self) -> np.ndarray:
        """(w, 7): the boxes of fences, trunks and posts."""
        return boxes_of(self.layout.walls[:, :2], self.layout.walls[:, 2:])

    @cached_property
    def wall_grid(self) -> Grid:
        """Where the walls are that a body could touch."""
        return grid_of(self.walls, self._radius)

    @cached_property
    def frame(self) -> np.ndarray:
        """The frame of a grid for bodies: two that could touch within a step are in neighbouring cells, or in the same."""
        step = float(self.bodies.speed.max(initial=0.0)) * TIME_STEP
        return frame_of(self.walls, max(CELL, 2.0 * (self._radius + step)))

    @property
    def _radius(self) -> float:
        """m, of the circle around the largest body."""
        return float(self.bodies.boxes[:, RADIUS].max(initial=0.0))

    @cached_property
    def pickers(self) -> np.ndarray:
        """The indices of the pickers."""
        return self._all_of("picker")

    @cached_property
    def carriers(self) -> np.ndarray:
        """The indices of the carriers."""
        return self._all_of("carrier")

    @cached_property
    def planners(self) -> tuple[str, ...]:
        """The names of pickers and carriers: the harvest goes on while they get on with their plans."""
        return tuple(self.layout.names[i] for i in [*self.pickers.tolist(), *self.carriers.tolist()])

    def _all_of(self, kind: str) -> np.ndarray:
        return np.array([i for i, start in enumerate(self.layout.starts) if start.kind == kind], dtype=np.int64)

    @cached_property
    def lane_y(self) -> np.ndarray:
        """(r,) m: the lanes' centre lines."""
        return np.array([lane.y for lane in self.layout.lanes])


def new_world(layout: Layout) -> World:
    """The world at tick 0: every body at its start, the bins coupled."""
    n, rows = len(layout.starts), layout.scenario.rows
    coupled = np.full(n, NOBODY, dtype=np.int64)
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
    """The bodies' kinds as arrays, in body order."""
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
    """(n, 2): half length and half width of every body, m."""
    return np.array([(KINDS[s.kind].length / 2, KINDS[s.kind].width / 2) for s in layout.starts]).reshape(-1, 2)
