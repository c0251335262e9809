"""The point that the first view's camera follows: a picker or a carrier that has much to show.

It glides to another robot, or cuts to it, as a film does.
"""

import math

import numpy as np
import rerun as rr

from orchard.contract.agent import State
from orchard.contract.events import Frame
from orchard.field.kinds import HAULERS
from orchard.field.layout import Layout
from orchard.field.scenario import TIME_STEP

# The focus's frame, and the entity that the camera follows.
FOCUS = "focus"
# s for which the camera stays with a robot
DWELL = 20.0
# s in which it comes nearer to its robot by two thirds, 1 - 1/e
GLIDE = 3.0
# m: it cuts to a robot that is further away, and shows no empty ground on the way.
CUT = 20.0
# How much a robot in a state has to show. A state that is not here has nothing to show.
INTEREST: dict[State, int] = {
    "handling a bin": 3,
    "unloading": 2,
    "picking": 2,
    "hauling": 1,
    "driving": 1,
    "calling": 1,
}


def log_focus(rec: rr.RecordingStream) -> None:
    """Log the entity that the camera follows, a point that is too small to see."""
    point = rr.Points3D([(0.0, 0.0, 0.0)], radii=[0.001])
    rec.log(FOCUS, rr.CoordinateFrame(FOCUS), point, static=True)


class Focus:
    """Follows a picker or a carrier, and turns to another one that has more to show."""

    def __init__(self, layout: Layout) -> None:
        self._index = {}
        for number, start in enumerate(layout.starts):
            if start.kind in HAULERS:
                self._index[start.name] = number
        self._states: dict[str, State] = dict.fromkeys(self._index, "resting")
        self._robot = ""
        # The tick at which the camera has turned to this robot.
        self._since = 0
        self._tick = 0
        # x and y, m.
        self._place = [0.0, 0.0]

    def follow(self, frame: Frame) -> list[float]:
        """Return the pose of the focus at a frame: x and y in m, yaw 0."""
        for name, state in frame.states.items():
            if name in self._index:
                self._states[name] = state
        if self._is_to_turn(frame.tick):
            self._turn(frame)
        self._glide(frame)
        self._tick = frame.tick
        return [*self._place, 0.0]

    def _is_to_turn(self, tick: int) -> bool:
        """Whether the camera has no robot yet, or was with one for long that now shows less."""
        if not self._robot:
            return True
        if tick - self._since < DWELL / TIME_STEP:
            return False
        most = max(self._interest(robot) for robot in self._index)
        return most > self._interest(self._robot)

    def _turn(self, frame: Frame) -> None:
        """Turn to the robot with most to show, of several to the nearest one. Cut if it is far."""
        is_first = not self._robot

        def preference(robot: str) -> tuple[int, float]:
            distance = math.dist(self._position(robot, frame.poses), self._place)
            return -self._interest(robot), distance

        self._robot = min(self._index, key=preference)
        self._since = frame.tick
        goal = self._position(self._robot, frame.poses)
        if is_first or math.dist(self._place, goal) > CUT:
            self._place = goal

    def _glide(self, frame: Frame) -> None:
        """Come nearer to the robot, by a share that depends on the time since the last frame."""
        seconds = (frame.tick - self._tick) * TIME_STEP
        share = 1.0 - math.exp(-seconds / GLIDE)
        goal = self._position(self._robot, frame.poses)
        self._place = [
            now + share * (wanted - now) for now, wanted in zip(self._place, goal, strict=True)
        ]

    def _interest(self, robot: str) -> int:
        """Return how much a robot has to show."""
        return INTEREST.get(self._states[robot], 0)

    def _position(self, robot: str, poses: np.ndarray) -> list[float]:
        """Return where a robot is: x and y, m. `poses`: (n, 3)."""
        return list(poses[self._index[robot], :2].tolist())
