"""Robots that follow each other on a line, where no places keep them apart."""

import simpy

from orchard.field.kinds import KINDS, Kind
from orchard.plans.sense import SIDE_MARGIN, STOP_DISTANCE

Line = tuple[
    str, float, int
]  # the axis along which it runs, its other coordinate in m, and the direction, +1 or -1


class Follower:
    """What the lines know of a robot."""

    kind: Kind
    bin: str  # coupled to it; '' for none
    line: Line | None = None  # on which it drives, or which its tail has not left
    end = 0.0  # up to where it drives there, in the line's direction, m
    is_across = False  # it has turned off its line, and its bin is no longer on it
    moved: simpy.Event  # its way got longer


CLEAR = (
    KINDS["carrier"].tows + KINDS["bin"].length / 2 + KINDS["carrier"].width / 2 + SIDE_MARGIN
)  # m a train drives to be off a line


class Lines:
    """The robots on each line, the foremost first."""

    def __init__(self) -> None:
        self._on: dict[Line, list[Follower]] = {}

    def enter(self, robot: Follower, line: Line, at: float) -> None:
        """Leave the line before, and enter this one at a coordinate in its direction."""
        self.leave(robot)
        on = self._on.setdefault(line, [])
        on.insert(_number_before(on, at), robot)

    def leave(self, robot: Follower) -> None:
        if robot.line is not None:
            self._on[robot.line].remove(robot)

    def before(self, robot: Follower, line: Line, at: float) -> Follower | None:
        """Return the robot that one at a coordinate of a line follows there, or would follow; None
        if there is none.
        """
        on = self._on.get(line, [])
        number = on.index(robot) if robot.line == line else _number_before(on, at)
        return on[number - 1] if number else None


def _number_before(on: list[Follower], at: float) -> int:
    return next((number for number in range(len(on), 0, -1) if on[number - 1].end >= at), 0)


def room(robot: Follower, before: Follower) -> float:
    """Return how far a robot may drive, in the direction of its line, m: up to where the one before
    it stands or will stand.
    """
    other = before.kind
    tail = (
        other.width / 2
        if before.is_across
        else other.tows + KINDS["bin"].length / 2
        if before.bin
        else other.length / 2
    )
    return before.end - tail - STOP_DISTANCE - robot.kind.length / 2
