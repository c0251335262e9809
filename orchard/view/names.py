"""Names on the plan, each where it covers no other, and the point that the first view's camera follows."""

import math
from itertools import pairwise, product

import numpy as np
import rerun as rr

from orchard.contract.agent import State
from orchard.contract.events import Frame
from orchard.field.kinds import HAULERS, VEHICLES, short_name
from orchard.field.layout import X_WEST, Layout
from orchard.field.scenario import TIME_STEP
from orchard.view import palette
from orchard.view.scenery import MARGIN, plan_size

RENEWED_TICKS = 5  # interval at which the names follow the robots
NAME_Z, ROW_Z = 4.4, 4.0  # m
HIGH_PLAN, WIDE_PLAN = (730.0, 470.0), (330.0, 560.0)  # height and width of the plan in a usual window, screen points
LETTER, PADDING, HEIGHT = 6.5, 10.0, 22.0  # screen points: of a letter, and of a name's frame
DROP = 3.0 + HEIGHT / 2  # screen points: Rerun writes a name with its middle so far below its point
PIN = 6.0  # screen points: radius of a pin
COVERS_NAME, COVERS_PIN, MOVES, RANK = 10.0, 3.0, 0.5, 0.1  # what speaks against a place. The first of PLACES has rank 0

# Places of a name's middle, in halves of its size and its pin's: below its pin, above, on its right, on its left, in the corners, further
BESIDE = [(0, -1), (0, 1), (1, 0), (-1, 0), *product((1, -1), (-1, 1))]
PLACES = np.array([*BESIDE, (0, -2.5), (0, 2.5), (2.2, 0), (-2.2, 0), *product((2.2, -2.2), (-2.5, 2.5))], float)


def points_to_metres(layout: Layout) -> float:
    """Return the metres on the plan that are one screen point wide, in a usual window."""
    high, wide = plan_size(layout)
    rows, columns = HIGH_PLAN if high >= wide else WIDE_PLAN
    return max(high / rows, wide / columns)


class NameView:
    """The names of rows and robots. `show` logs where the robots' names are."""

    def __init__(self, rec: rr.RecordingStream, layout: Layout) -> None:
        self.rec, self.scale = rec, points_to_metres(layout)
        robots = [start for kind in VEHICLES for start in layout.starts if start.kind == kind]
        self._index = np.array([layout.index[start.name] for start in robots])
        self._labels = [short_name(start.name) for start in robots]
        self._halves = np.array([self._half(label) for label in self._labels])
        self._places = np.zeros(len(robots), int)  # the place of each name, an index of PLACES
        self._shown = np.full((len(robots), 2), np.nan)  # the pins that were last named
        self._rows = self._log_rows(layout)
        look = rr.Points3D.from_fields(radii=[0.01], colors=[palette.ROAD_EDGE], labels=self._labels, show_labels=True)
        self.rec.log("plan/names", look, static=True)

    def _half(self, label: str) -> tuple[float, float]:
        """Half the width and the height of a name, m."""
        return (LETTER * len(label) + PADDING) / 2 * self.scale, HEIGHT / 2 * self.scale

    def _log_rows(self, layout: Layout) -> np.ndarray:
        pitch = min(north.y - south.y for north, south in pairwise(layout.lanes))
        x, lanes = X_WEST - MARGIN / 2, layout.lanes[:: math.ceil(HEIGHT * self.scale / pitch)]  # all numbers would cover each other
        labels, points = [f"{lane.number}" for lane in lanes], [(x, lane.y + DROP * self.scale, ROW_Z) for lane in lanes]
        numbers = rr.Points3D(points, labels=labels, radii=[0.01], colors=[palette.ROAD_EDGE], show_labels=True)
        self.rec.log("plan/rows", numbers, static=True)
        return np.array([(x, lane.y, *self._half(label)) for lane, label in zip(lanes, labels, strict=True)])

    def show(self, tick: int, poses: np.ndarray) -> None:
        """Log the names every half second if a robot has moved. `poses`: (n, 3)."""
        pins = poses[self._index, :2]
        if tick % RENEWED_TICKS == 0 and (pins != self._shown).any():
            self._shown = pins
            middles = self._placed(pins)
            points = np.column_stack([middles[:, 0], middles[:, 1] + DROP * self.scale, np.full(len(pins), NAME_Z)])
            self.rec.log("plan/names", rr.Points3D.from_fields(positions=points))

    def _placed(self, pins: np.ndarray) -> np.ndarray:
        taken = np.concatenate([self._rows, np.zeros((len(pins), 4))])
        spots = pins[:, None] + PLACES * (self._halves + (PIN + 2.0) * self.scale)[:, None]
        boxes = np.column_stack([pins, np.full_like(pins, PIN * self.scale)])
        ranks, covered = np.arange(len(PLACES)), _covered(spots, self._halves, boxes)
        for n, half in enumerate(self._halves):
            names = _covered(spots[n : n + 1], half[None], taken[: len(self._rows) + n])[0]
            against = RANK * ranks + MOVES * (ranks != self._places[n]) + COVERS_NAME * names + COVERS_PIN * covered[n]
            self._places[n] = best = int(np.argmin(against))
            taken[len(self._rows) + n] = *spots[n, best], *half
        return taken[len(self._rows) :, :2]


def _covered(spots: np.ndarray, halves: np.ndarray, boxes: np.ndarray) -> np.ndarray:
    """Return how many boxes, (b, 4), each name covers at its possible middles, (k, p, 2). `halves`: (k, 2) half sizes."""
    apart = np.abs(spots[:, :, None] - boxes[:, :2]) - boxes[:, 2:] - halves[:, None, None]
    return np.asarray((apart < 0.0).all(axis=3).sum(axis=2))


FOCUS = "focus"  # its frame, and the entity that the camera follows
HOLD = 20.0  # s for which it stays with a robot
GLIDE = 3.0  # s in which it comes nearer to its robot by two thirds
CUT = 20.0  # m: to a robot further away it cuts, as a film does, and shows no empty ground on the way
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
    rec.log(FOCUS, rr.CoordinateFrame(FOCUS), rr.Points3D([(0.0, 0.0, 0.0)], radii=[0.001]), static=True)


class Focus:
    """Follows a picker or a carrier, and glides or cuts to another one that has more to show."""

    def __init__(self, layout: Layout) -> None:
        self._index = {start.name: i for i, start in enumerate(layout.starts) if start.kind in HAULERS}
        self._states: dict[str, State] = dict.fromkeys(self._index, "resting")
        self._robot = ""
        self._place = np.zeros(2)  # m
        self._since, self._tick = 0, 0

    def follow(self, frame: Frame) -> np.ndarray:
        """Return the pose of the focus at a frame, (3,): x and y in m, yaw 0."""
        self._states.update({name: state for name, state in frame.states.items() if name in self._index})
        if not self._robot:
            self._robot, self._since = self._best(frame.poses), frame.tick
            self._place = self._goal(frame.poses)
        elif frame.tick - self._since >= HOLD / TIME_STEP and self._work(best := self._best(frame.poses)) > self._work(self._robot):
            self._robot, self._since = best, frame.tick
            if math.dist(self._place, self._goal(frame.poses)) > CUT:
                self._place = self._goal(frame.poses)
        share = 1.0 - math.exp(-(frame.tick - self._tick) * TIME_STEP / GLIDE)
        self._place = self._place + share * (self._goal(frame.poses) - self._place)
        self._tick = frame.tick
        return np.array([*self._place, 0.0])

    def _work(self, robot: str) -> int:
        return WORK.get(self._states[robot], 0)

    def _goal(self, poses: np.ndarray) -> np.ndarray:
        return np.asarray(poses[self._index[self._robot], :2], float)

    def _best(self, poses: np.ndarray) -> str:
        return min(self._index, key=lambda name: (-self._work(name), math.dist(poses[self._index[name], :2], self._place)))
