"""Names on the plan, each where it covers no other or else left out, and the point that the first
view's camera follows.
"""

import math
from itertools import compress, pairwise, product

import numpy as np
import rerun as rr

from orchard.contract.agent import State
from orchard.contract.events import Frame
from orchard.field.kinds import HAULERS, VEHICLES, short_name
from orchard.field.layout import X_WEST, Layout
from orchard.field.scenario import TIME_STEP
from orchard.view import palette
from orchard.view.columns import Columns
from orchard.view.scenery import MARGIN, plan_size

RENEWED_TICKS = 5  # interval at which the names follow the robots
NAME_Z, ROW_Z = 4.4, 4.0  # m
HIGH_PLAN, WIDE_PLAN = (
    (730.0, 470.0),
    (330.0, 560.0),
)  # height and width of the plan in a usual window, screen points
LETTER, PADDING, HEIGHT = 6.5, 10.0, 22.0  # screen points: of a letter, and of a name's frame
DROP = 3.0 + HEIGHT / 2  # screen points: Rerun writes a name with its middle so far below its point
PIN = 6.0  # screen points: radius of a pin
COVERS_NAME, COVERS_PIN, MOVES, RANK = (
    10.0,
    3.0,
    0.5,
    0.1,
)  # what speaks against a place. The first of PLACES has rank 0

# Places of a name's middle, in halves of its size and its pin's: below its pin, above, on its
# right, on its left, in the corners, further
BESIDE = [(0, -1), (0, 1), (1, 0), (-1, 0), *product((1, -1), (-1, 1))]
PLACES = np.array(
    [*BESIDE, (0, -2.5), (0, 2.5), (2.2, 0), (-2.2, 0), *product((2.2, -2.2), (-2.5, 2.5))], float
)


def points_to_metres(layout: Layout) -> float:
    """Return the metres on the plan that are one screen point wide, in a usual window."""
    high, wide = plan_size(layout)
    rows, columns = HIGH_PLAN if high >= wide else WIDE_PLAN
    return max(high / rows, wide / columns)


class NameView:
    """The names of rows and robots. `show` adds where the robots' names are."""

    def __init__(self, columns: Columns, layout: Layout) -> None:
        self.rec, self.columns, self.scale = columns.rec, columns, points_to_metres(layout)
        robots = [start for kind in VEHICLES for start in layout.starts if start.kind == kind]
        self._index = np.array([layout.index[start.name] for start in robots])
        self._labels = [short_name(start.name) for start in robots]
        self._halves = np.array([self._half(label) for label in self._labels])
        self._places = np.zeros(len(robots), int)  # the place of each name, an index of PLACES
        self._shown = np.full((len(robots), 2), np.nan)  # the pins that were last named
        self._rows = self._log_rows(layout)
        look = rr.Points3D.from_fields(radii=[0.01], colors=[palette.ROAD_EDGE], show_labels=True)
        self.rec.log("plan/names", look, static=True)

    def _half(self, label: str) -> tuple[float, float]:
        """Half the width and the height of a name, m."""
        return (LETTER * len(label) + PADDING) / 2 * self.scale, HEIGHT / 2 * self.scale

    def _log_rows(self, layout: Layout) -> np.ndarray:
        pitch = min(north.y - south.y for north, south in pairwise(layout.lanes))
        x, lanes = (
            X_WEST - MARGIN / 2,
            layout.lanes[:: math.ceil(HEIGHT * self.scale / pitch)],
        )  # all numbers would cover each other
        labels, points = (
            [f"{lane.number}" for lane in lanes],
            [(x, lane.y + DROP * self.scale, ROW_Z) for lane in lanes],
        )
        numbers = rr.Points3D(
            points, labels=labels, radii=[0.01], colors=[palette.ROAD_EDGE], show_labels=True
        )
        self.rec.log("plan/rows", numbers, static=True)
        return np.array(
            [(x, lane.y, *self._half(label)) for lane, label in zip(lanes, labels, strict=True)]
        )

    def show(self, tick: int, poses: np.ndarray) -> None:
        """Add the names every half second if a robot has moved. `poses`: (n, 3)."""
        if tick % RENEWED_TICKS == 0 and ((pins := poses[self._index, :2]) != self._shown).any():
            self._shown, (labels, middles) = pins, self._placed(pins)
            points = np.column_stack(
                [middles[:, 0], middles[:, 1] + DROP * self.scale, np.full(len(labels), NAME_Z)]
            )
            self.columns.add("plan/names", rr.Points3D, positions=points, labels=labels)

    def _placed(self, pins: np.ndarray) -> tuple[list[str], np.ndarray]:
        """Return the names that cover no other one, and their middles."""
        spots = pins[:, None] + PLACES * (self._halves + (PIN + 2.0) * self.scale)[:, None]
        boxes = np.column_stack([pins, np.full_like(pins, PIN * self.scale)])
        ranks, first = np.arange(len(PLACES)), len(self._rows)
        against = (
            RANK * ranks
            + MOVES * (ranks != self._places[:, None])
            + COVERS_PIN * _covers(spots, self._halves, boxes).sum(axis=-1)
        )
        self._places = against.argmin(axis=1)
        best = spots[
            np.arange(len(pins)), self._places, None
        ]  # where each would be if there were no other names
        taken = np.vstack([self._rows, np.column_stack([best[:, 0], self._halves])])
        collides = np.any(
            np.tril(_covers(best, self._halves, taken)[:, 0], first - 1), axis=1
        )  # with one before it
        for n, half in enumerate(self._halves):
            if collides[n]:
                covered = _covers(spots[n], half, taken[: first + n]).sum(axis=-1)
                self._places[n] = place = (against[n] + COVERS_NAME * covered).argmin()
                taken[first + n, :2] = np.nan if covered[place] else spots[n, place]
                collides |= _covers(best, self._halves, taken[[first + n]])[:, 0, 0]
        is_shown = ~np.isnan(taken[first:, 0])
        return [*compress(self._labels, is_shown)], taken[first:, :2][is_shown]


def _covers(spots: np.ndarray, halves: np.ndarray, boxes: np.ndarray) -> np.ndarray:
    """Return which boxes, (b, 4), each name covers at its possible middles, (..., p, 2): (..., p,
    b). `halves`: (..., 2) half sizes.
    """
    spots, halves = spots[..., None, :], halves[..., None, None, :]
    across = np.abs(spots[..., 0] - boxes[:, 0]) - boxes[:, 2] - halves[..., 0] < 0.0
    along = np.abs(spots[..., 1] - boxes[:, 1]) - boxes[:, 3] - halves[..., 1] < 0.0
    return np.asarray(across & along)


FOCUS = "focus"  # its frame, and the entity that the camera follows
HOLD = 20.0  # s for which it stays with a robot
GLIDE = 3.0  # s in which it comes nearer to its robot by two thirds
CUT = (
    20.0  # m: to a robot further away it cuts, as a film does, and shows no empty ground on the way
)
WORK: dict[State, int] = {
    "handling a bin": 3,
    "unloading": 2,
    "picking": 2,
    "hauling": 1,
    "driving": 1,
    "calling": 1,
}  # the more, the better


def log_focus(rec: rr.RecordingStream) -> None:
    """Log the entity that the camera follows, a point that is too small to see."""
    rec.log(
        FOCUS, rr.CoordinateFrame(FOCUS), rr.Points3D([(0.0, 0.0, 0.0)], radii=[0.001]), static=True
    )


class Focus:
    """Follows a picker or a carrier, and glides or cuts to another one that has more to show."""

    def __init__(self, layout: Layout) -> None:
        self._index = {
            start.name: i for i, start in enumerate(layout.starts) if start.kind in HAULERS
        }
        self._states: dict[str, State] = dict.fromkeys(self._index, "resting")
        self._robot = ""
        self._place = [0.0, 0.0]  # m
        self._since, self._tick = 0, 0

    def follow(self, frame: Frame) -> list[float]:
        """Return the pose of the focus at a frame: x and y in m, yaw 0."""
        self._states.update(
            {name: state for name, state in frame.states.items() if name in self._index}
        )
        held, is_first = frame.tick - self._since, not self._robot
        if is_first or (
            held >= HOLD / TIME_STEP and max(map(self._work, self._index)) > self._work(self._robot)
        ):
            self._robot = min(
                self._index,
                key=lambda name: (
                    -self._work(name),
                    math.dist(frame.poses[self._index[name], :2], self._place),
                ),
            )
            self._since = frame.tick
            if is_first or math.dist(self._place, self._goal(frame.poses)) > CUT:
                self._place = self._goal(frame.poses)
        share = 1.0 - math.exp(-(frame.tick - self._tick) * TIME_STEP / GLIDE)
        self._place = [
            now + share * (goal - now)
            for now, goal in zip(self._place, self._goal(frame.poses), strict=True)
        ]
        self._tick = frame.tick
        return [*self._place, 0.0]

    def _work(self, robot: str) -> int:
        return WORK.get(self._states[robot], 0)

    def _goal(self, poses: np.ndarray) -> list[float]:
        return list(poses[self._index[self._robot], :2].tolist())
