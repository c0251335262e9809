"""The point that the first view's camera follows: the robot that has the most to show."""

import math

import numpy as np
import rerun as rr

from orchard.contract.agent import State
from orchard.contract.events import Frame
from orchard.field.kinds import HAULERS
from orchard.field.layout import Layout
from orchard.field.scenario import TIME_STEP

FOCUS = "focus"  # its frame, and the entity that the camera follows
HOLD = 20.0  # s for which it stays with a robot
GLIDE = 3.0  # s in which it comes nearer to its robot by two thirds
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
    """Follows a picker or a carrier, and glides to another one that has more to show."""

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
        share = 1.0 - math.exp(-(frame.tick - self._tick) * TIME_STEP / GLIDE)
        self._place = self._place + share * (self._goal(frame.poses) - self._place)
        self._tick = frame.tick
        return np.array([*self._place, 0.0])

    def _work(self, robot: str) -> int:
        return WORK.get(self._states[robot], 0)

    def _goal(self, poses: np.ndarray) -> np.ndarray:
        return np.asarray(poses[self._index[self._robot], :2], float)

    def _best(self, poses: np.ndarray) -> str:
        """Return the robot with the most to show; of several, the nearest to the focus."""
        return min(self._index, key=lambda name: (-self._work(name), math.dist(poses[self._index[name], :2], self._place)))
