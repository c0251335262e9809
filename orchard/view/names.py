"""Names on the plan, each where it covers no other, or else left out."""

import math
from itertools import compress, pairwise, product

import numpy as np
import rerun as rr

from orchard.field.kinds import VEHICLES, short_name
from orchard.field.layout import X_WEST, Layout
from orchard.view import palette
from orchard.view.columns import Columns
from orchard.view.scenery import MARGIN, plan_size

# Ticks after which the names follow the robots.
RENEWED_TICKS = 5
# z of the names of robots, and of the numbers of rows, m: both above the crowns of the plan.
NAME_Z = 4.4
ROW_NUMBER_Z = 4.0

# Height and width of the plan in a usual window, screen points.
HIGH_PLAN = (730.0, 470.0)
WIDE_PLAN = (330.0, 560.0)

# All that follows is in screen points.
LETTER = 6.5  # Width of a letter.
PADDING = 10.0  # Of the frame of a name, on both sides together.
HEIGHT = 22.0  # Of the frame of a name.
DROP = 3.0 + HEIGHT / 2  # Rerun writes a name with its middle so far below its point.
PIN = 6.0  # Radius of a pin.
GAP = 2.0  # Between a pin and its name.

# What speaks against a place, in points, which are added up: each name or pin that it covers, that
# the name is elsewhere now, and its rank in PLACES, of which the first has rank 0.
COVERS_NAME = 10.0
COVERS_PIN = 3.0
MOVES = 0.5
RANK = 0.1

# Places of a name's middle, x and y from its pin: below the pin, above, on its right, on its left,
# in the corners; then the same further away. At 1 the name touches the pin, but for GAP.
BESIDE = [(0, -1), (0, 1), (1, 0), (-1, 0), *product((1, -1), (-1, 1))]
PLACES = np.array(
    [*BESIDE, (0, -2.5), (0, 2.5), (2.2, 0), (-2.2, 0), *product((2.2, -2.2), (-2.5, 2.5))], float
)


def points_to_metres(layout: Layout) -> float:
    """Return the metres on the plan that are one screen point wide, in a usual window."""
    height, width = plan_size(layout)
    window = WIDE_PLAN
    if height >= width:
        window = HIGH_PLAN
    window_height, window_width = window
    return max(height / window_height, width / window_width)


class NameView:
    """The names of rows and robots. `show` adds where the robots' names are."""

    def __init__(self, columns: Columns, layout: Layout) -> None:
        """Log the numbers of the rows, and how names look. `columns`: for what changes."""
        self.rec = columns.rec
        self.columns = columns
        self.scale = points_to_metres(layout)
        robots: list[str] = []
        for kind in VEHICLES:
            robots += [start.name for start in layout.starts if start.kind == kind]
        self._index = np.array([layout.index[name] for name in robots])
        self._labels = [short_name(name) for name in robots]
        self._halves = np.array([self._half(label) for label in self._labels])
        # The place of each name, an index of PLACES, (r,).
        self._places = np.zeros(len(robots), int)
        # Where the pins were when names were last shown, (r, 2) m.
        self._shown = np.full((len(robots), 2), np.nan)
        self._rows = self._log_rows(layout)
        look = rr.Points3D.from_fields(radii=[0.01], colors=[palette.ROAD_EDGE], show_labels=True)
        self.rec.log("plan/names", look, static=True)

    def _half(self, label: str) -> tuple[float, float]:
        """Half the width and the height of a name, m."""
        return (LETTER * len(label) + PADDING) / 2 * self.scale, HEIGHT / 2 * self.scale

    def _log_rows(self, layout: Layout) -> np.ndarray:
        """Log the numbers of rows, of so many that none covers another one.

        Return their boxes, (r, 4): the middle's x and y, half width and half height, m.
        """
        pitch = min(north.y - south.y for north, south in pairwise(layout.lanes))
        lanes = layout.lanes[:: math.ceil(HEIGHT * self.scale / pitch)]
        x = X_WEST - MARGIN / 2
        labels = []
        points = []
        boxes = []
        for lane in lanes:
            label = f"{lane.number}"
            labels.append(label)
            points.append((x, lane.y + DROP * self.scale, ROW_NUMBER_Z))
            boxes.append((x, lane.y, *self._half(label)))
        numbers = rr.Points3D(
            points, labels=labels, radii=[0.01], colors=[palette.ROAD_EDGE], show_labels=True
        )
        self.rec.log("plan/rows", numbers, static=True)
        return np.array(boxes)

    def show(self, tick: int, poses: np.ndarray) -> None:
        """Add the names every half second if a robot has moved. `poses`: (n, 3)."""
        pins = poses[self._index, :2]
        if tick % RENEWED_TICKS != 0 or (pins == self._shown).all():
            return
        self._shown = pins
        labels, middles = self._arrange(pins)
        y = middles[:, 1] + DROP * self.scale
        points = np.column_stack([middles[:, 0], y, np.full(len(labels), NAME_Z)])
        self.columns.add("plan/names", rr.Points3D, positions=points, labels=labels)

    def _arrange(self, pins: np.ndarray) -> tuple[list[str], np.ndarray]:
        """Return the names that cover no other name, and their middles, (k, 2) m.

        `pins`: (r, 2) m, one for each robot. First each name takes the place that is best for it
        alone. Then, in the order of the robots, a name that covers an earlier one, or the number of
        a row, takes the best of the places that are left; if there is none, it is left out.
        """
        # The p possible middles of each name, (r, p, 2).
        spots = pins[:, None] + PLACES * (self._halves + (PIN + GAP) * self.scale)[:, None]
        costs = self._costs(spots, pins)
        # Where each name would be if there were no other names. The costs know where it was before.
        self._places = costs.argmin(axis=1)
        # That place of each name, (r, 1, 2).
        best = spots[np.arange(len(pins)), self._places, None]
        # The boxes that are taken, (rows + r, 4): those of the row numbers, then those of the
        # names.
        first = len(self._rows)
        taken = np.vstack([self._rows, np.column_stack([best[:, 0], self._halves])])
        # Only a name before it, or a row, can push a name away: of the name with number k the boxes
        # up to first + k - 1 count.
        covers_earlier = np.tril(_covers(best, self._halves, taken)[:, 0], first - 1)
        collides = np.any(covers_earlier, axis=1)
        for robot, half in enumerate(self._halves):
            if not collides[robot]:
                continue
            covered_count = _covers(spots[robot], half, taken[: first + robot]).sum(axis=-1)
            place = (costs[robot] + COVERS_NAME * covered_count).argmin()
            self._places[robot] = place
            taken[first + robot, :2] = spots[robot, place]
            if covered_count[place]:
                # A name without room is left out: a box at NaN covers nothing.
                taken[first + robot, :2] = np.nan
            # In its new place it may push away names after it.
            collides |= _covers(best, self._halves, taken[[first + robot]])[:, 0, 0]
        is_shown = ~np.isnan(taken[first:, 0])
        return list(compress(self._labels, is_shown)), taken[first:, :2][is_shown]

    def _costs(self, spots: np.ndarray, pins: np.ndarray) -> np.ndarray:
        """Return what speaks against each place of each name, without other names, (r, p).

        `spots`: (r, p, 2) m. `pins`: (r, 2) m.
        """
        ranks = np.arange(len(PLACES))
        boxes = np.column_stack([pins, np.full_like(pins, PIN * self.scale)])
        covered_pins = _covers(spots, self._halves, boxes).sum(axis=-1)
        is_elsewhere = ranks != self._places[:, None]
        return np.asarray(RANK * ranks + MOVES * is_elsewhere + COVERS_PIN * covered_pins)


def _covers(spots: np.ndarray, halves: np.ndarray, boxes: np.ndarray) -> np.ndarray:
    """Return which boxes each name covers at its possible middles, (..., p, b).

    `spots`: the middles, (..., p, 2). `halves`: half sizes, (..., 2). `boxes`: (b, 4), the middle's
    x and y, half width and half height. All in metres.
    """
    spots = spots[..., None, :]
    halves = halves[..., None, None, :]
    across = np.abs(spots[..., 0] - boxes[:, 0]) - boxes[:, 2] - halves[..., 0] < 0.0
    along = np.abs(spots[..., 1] - boxes[:, 1]) - boxes[:, 3] - halves[..., 1] < 0.0
    return np.asarray(across & along)
