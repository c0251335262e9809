"""The state of the orchard, which only physics changes: all that a snapshot must hold."""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from orchard.field.kinds import LASER_RANGE
from orchard.field.layout import KEPT_LAYOUTS, Layout
from orchard.field.passes import FULL_WITHIN
from orchard.field.scenario import TIME_STEP, Scenario
from orchard.sim.kernels.boxes import RADIUS, boxes_of
from orchard.sim.kernels.grid import Grid, frame_of, grid_of, space_for
from orchard.sim.kernels.picking import ANYWHERE, NONE, full_bins, picked_metres
from orchard.sim.stretches import stretches_of

# m: the smallest side of a cell in the grid of bodies. Smaller cells cost more time than they save.
CELL = 10.0

__all__ = ["NONE", "Fixed", "World"]


class Fixed(NamedTuple):
    """What a layout says of n bodies, r rows and w walls, as the kernels take it."""

    # (n,) m/s.
    speed: np.ndarray
    # (n,) rad/s.
    turn: np.ndarray
    # (n,) m from its centre back to the centre of its coupled bin; 0: it tows nothing.
    tows: np.ndarray
    # (n,) bool: all but weeds. Others cannot drive through it, and lasers see it.
    solid: np.ndarray
    # (n,) bool: bins, which move only while they are coupled.
    sideways: np.ndarray
    # (n, 7) boxes: half sizes and radius. `place` writes the other columns.
    shapes: np.ndarray
    # int64: the indices of the pickers.
    pickers: np.ndarray
    # m: what fills a bin.
    bin_full: float
    # m: the least that a bin holds that is to be delivered, once its picker has left it.
    bin_least: float
    # (r,) m in a bin for each metre of the row: 1, unless each row fills one bin.
    row_share: np.ndarray
    # (r,) m: x of the rows' west ends.
    row_west: np.ndarray
    # (r,) m.
    row_length: np.ndarray
    # (r,) m: the lanes' centre lines.
    row_y: np.ndarray
    # How fast each part of a row is picked: see Stretches.
    stretch_begin: np.ndarray
    stretch_east: np.ndarray
    stretch_speed: np.ndarray
    # (w, 7): the boxes of fences, trunks and posts.
    walls: np.ndarray
    # The Grid of the walls that a body in each cell could touch.
    wall_frame: np.ndarray
    wall_begin: np.ndarray
    wall_members: np.ndarray
    # Of a Grid of bodies: two that could touch within a step are in neighbouring cells.
    body_frame: np.ndarray
    # The Grid of the walls that a laser in each cell could reach.
    walls_in_sight: Grid
    # int64: the indices of the carriers.
    carriers: np.ndarray


class Space(NamedTuple):
    """Arrays in which a step of n bodies works.

    A kernel that makes no arrays is called in half the time.
    """

    # (n, 7): the bodies at their poses.
    boxes: np.ndarray
    # The Grid of the bodies, as `space_for` makes it.
    cells: np.ndarray
    cell_begin: np.ndarray
    cell_members: np.ndarray
    # (n,) int64: the obstacle with which each body's collision begins: a body's index, n + a
    # wall's, or NONE.
    met: np.ndarray
    # Of each picker, int64: the row from which it picked, or NONE.
    picked_from: np.ndarray
    # Of each picker, m: its x before the step.
    before: np.ndarray
    # (n,) bool: as `World.full`.
    full: np.ndarray


def _space_of(fixed: Fixed) -> Space:
    """Return the space for a step. What is in it does not matter, but for the sizes in `boxes`."""
    n = len(fixed.shapes)
    pickers = len(fixed.pickers)
    cells, cell_begin, cell_members = space_for(n, fixed.body_frame)
    return Space(
        boxes=fixed.shapes.copy(),
        cells=cells,
        cell_begin=cell_begin,
        cell_members=cell_members,
        met=np.empty(n, dtype=np.int64),
        picked_from=np.full(pickers, NONE, dtype=np.int64),
        before=np.empty(pickers),
        full=np.empty(n, dtype=bool),
    )


@lru_cache(maxsize=KEPT_LAYOUTS)
def fixed_of(layout: Layout) -> Fixed:
    """Return what a layout says of its bodies, rows and walls. The arrays are never changed."""
    kinds = layout.kinds
    machines = [layout.machines[start.kind] for start in layout.starts]
    halves = np.column_stack([_array_of(kinds, "length"), _array_of(kinds, "width")]) / 2
    shapes = boxes_of(np.zeros_like(halves), halves)
    speed = _array_of(machines, "speed")
    # m: the largest radius of a body, and the longest way of one in a tick.
    radius = float(shapes[:, RADIUS].max(initial=0.0))
    step = float(speed.max(initial=0.0)) * TIME_STEP
    walls = boxes_of(layout.walls[:, :2], layout.walls[:, 2:])
    walls_in_touch = _grid(walls.tobytes(), radius)
    lanes = layout.lanes
    stretches = stretches_of(layout)
    row_length = _array_of(lanes, "length")
    if layout.scenario.bin_metres:
        bin_least = FULL_WITHIN
        row_share = np.ones(len(lanes))
    else:
        bin_least = layout.metres_per_bin
        row_share = layout.row_length / row_length
    return Fixed(
        speed=speed,
        turn=_array_of(machines, "turn"),
        tows=_array_of(kinds, "tows"),
        solid=_array_of(kinds, "solid", bool),
        sideways=_array_of(kinds, "sideways", bool),
        shapes=shapes,
        pickers=_indices(layout, "picker"),
        bin_full=layout.metres_per_bin,
        bin_least=bin_least,
        row_share=row_share,
        row_west=_array_of(lanes, "west"),
        row_length=row_length,
        row_y=_array_of(lanes, "y"),
        stretch_begin=stretches.begin,
        stretch_east=stretches.east,
        stretch_speed=stretches.speed,
        walls=walls,
        wall_frame=walls_in_touch.frame,
        wall_begin=walls_in_touch.begin,
        wall_members=walls_in_touch.members,
        body_frame=frame_of(walls, max(CELL, 2.0 * (radius + step))),
        walls_in_sight=_grid(walls.tobytes(), LASER_RANGE),
        carriers=_indices(layout, "carrier"),
    )


def _array_of(records: Sequence[object], name: str, dtype: type = float) -> np.ndarray:
    """Return one attribute of each record as an array, such as the `west` of each lane."""
    return np.array([getattr(record, name) for record in records], dtype=dtype)


def _indices(layout: Layout, kind: str) -> np.ndarray:
    """Return the indices of the bodies of a kind, int64."""
    return np.array(layout.indices_of(kind), dtype=np.int64)


@lru_cache(maxsize=KEPT_LAYOUTS)
def _grid(walls: bytes, reach: float) -> Grid:
    """Return the Grid of walls, (w, 7) boxes as bytes, within `reach` m of its cells.

    It is kept, because it does not depend on the seed. It is never changed.
    """
    return grid_of(np.frombuffer(walls).reshape(-1, RADIUS + 1), reach)


class World:
    """The state of n bodies and r rows.

    Poses are in the orchard's frame, twists in the body's frame; SI units. `layout`, `fixed` and
    `space` are no state: they follow from the scenario. All other attributes are in a snapshot.
    """

    def __init__(self, layout: Layout) -> None:
        """At tick 0, each body is at its start, and the bins are coupled."""
        n = len(layout.starts)
        rows = layout.scenario.rows
        self.layout = layout
        self.fixed = fixed_of(layout)
        self.space = _space_of(self.fixed)
        self.tick = 0
        starts = [start.pose for start in layout.starts]
        # (n, 3): x, y (m), yaw (rad).
        self.pose = np.array(starts, dtype=np.float64).reshape(n, 3)
        # (n, 3): forward, left (m/s), yaw rate (rad/s) of the last step; 0 if it was refused.
        self.twist = np.zeros((n, 3))
        # Of each body, the index of the body at the other end of the bar, or NONE.
        self.coupled = np.full(n, NONE, dtype=np.int64)
        # Of bins: metres of row in the bin, 0 to what fills it.
        self.fill = np.zeros(n)
        # False for a flattened weed.
        self.alive = np.ones(n, dtype=bool)
        # (r, 4) m: picked from the west end, and from the east end; and how far a part inside is
        # picked, from both ends. As `Rows.picked` in orchard/sim/kernels/picking.py.
        self.row_ends = np.zeros((rows, 4))
        # m: x before which this picker picks nothing.
        self.pick_from = np.full(n, ANYWHERE)
        # Of bins: ticks for which the bay has unloaded it by now; 0 if it does not.
        self.bay_ticks = np.zeros(n, dtype=np.int64)
        # Of carriers that have unloaded: ticks for which they will still be away at the load-out.
        self.hauling = np.zeros(n, dtype=np.int64)
        # Of each trailer: the bins on it at the bay, the tick at which it is or was back, and the
        # bins that it took then; see trailers.py. Without trailers there is one that is not used.
        load_out = layout.scenario.load_out
        self.trailers = np.zeros((load_out.trailers.count or 1, 3), dtype=np.int64)
        # Full bins at the bay that wait for the truck; see stock.py.
        self.waiting_bins = 0
        # Bins unloaded, and the metres that were in them.
        self.delivered = 0
        self.delivered_metres = 0.0
        # m that each body has driven.
        self.distance = np.zeros(n)
        # Collisions that each body began. One lasts while the body's steps meet an obstacle.
        self.collisions = np.zeros(n, dtype=np.int64)
        # Steps that were refused because of the coupled bin.
        self.refused = np.zeros(n, dtype=np.int64)
        # Whether a body is in a collision: its last step met an obstacle, and was refused.
        self.blocked = np.zeros(n, dtype=bool)
        # Whether a body is latched by an emergency stop; see stops.py.
        self.stopped = np.zeros(n, dtype=bool)
        # Of carriers' batteries, 0 flat to 1 full; see batteries.py.
        self.charge = np.ones(n)
        # Whether a body has a charger.
        self.plugged = np.zeros(n, dtype=bool)
        # m: the slow error of each receiver in x and y; see sensors.py.
        self.bias = np.zeros((n, 2))
        # The poses of odometry alone, kept if it has errors; see sensors.py.
        self.reckoned = self.pose.copy()
        for robot in layout.starts:
            if robot.bin:
                i = self.index[robot.name]
                j = self.index[robot.bin]
                self.coupled[i] = j
                self.coupled[j] = i

    @property
    def seconds(self) -> float:
        """Simulated time since the start of the run, s."""
        return self.tick * TIME_STEP

    @property
    def full(self) -> np.ndarray:
        """Which bodies are bins to be delivered, (n,) bool.

        They are full, or a picker has left them part full.
        """
        fixed = self.fixed
        full = np.empty(len(self.fill), dtype=bool)
        full_bins(self.fill, self.coupled, fixed.pickers, fixed.bin_full, fixed.bin_least, full)
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
    def is_any_hauling(self) -> bool:
        """Whether a carrier is away at the load-out, or on its way from the bay to it; or a
        trailer is away.
        """
        machine = self.layout.machines["carrier"]
        if machine.trailer_ticks:
            return bool((self.trailers[:, 1] > self.tick).any())
        return bool(machine.haul_ticks) and bool(self.hauling.any())

    @property
    def is_any_plugged(self) -> bool:
        """Whether a carrier has a charger."""
        return True in self.plugged.tolist()

    @property
    def scenario(self) -> Scenario:
        """The scenario that is simulated."""
        return self.layout.scenario

    @property
    def index(self) -> Mapping[str, int]:
        """Name of a body -> its index."""
        return self.layout.index

    @property
    def state(self) -> dict[str, Any]:
        """The attributes that a snapshot must hold, by name: numbers and arrays."""
        derived = ("layout", "fixed", "space")
        return {name: value for name, value in vars(self).items() if name not in derived}
