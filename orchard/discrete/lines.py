"""Robots that follow each other on a line, where no places keep them apart."""

from typing import Protocol

import simpy

from orchard.agents.sense import SIDE_MARGIN, STOP_DISTANCE
from orchard.field.kinds import KINDS, kind_of

Line = tuple[str, float, int]  # the axis along which it runs, its other coordinate in m, and the direction, +1 or -1


class Follower(Protocol):
    """What the lines know of a robot."""

    name: str
    bin: str  # coupled to it; '' for none
    line: Line | None  # on which it drives, or which its tail has not left
    end: float  # up to where it drives there, in the line's direction, m
    is_across: bool  # it has turned off its line, and its bin is no longer on it
    moved: simpy.Event  # its way got longer
    entered: int  # how many lines it has entered so far

    @property
    def before(self) -> "Follower | None":
        """The robot that it follows."""
        ...


CLEAR = KINDS["carrier"].tows + KINDS["bin"].length / 2 + KINDS["carrier"].width / 2 + SIDE_MARGIN  # m a train drives to be off a line


class Lines:
    """The robot that entered each line last, and the one that each robot follows."""

    def __init__(self) -> None:
        self._last: dict[Line, Follower] = {}

    def enter(self, robot: Follower, line: Line, at: float) -> Follower | None:
        """Enter a line at a coordinate in the line's direction. Return the robot that is before it on the line, or None."""
        if self._last.get(line) is robot and robot.line == line:
            return robot.before
        before, self._last[line] = self.last(robot, line, at), robot
        return before

    def last(self, robot: Follower, line: Line, at: float) -> Follower | None:
        """Return the robot that entered a line last, if it is another one, and still before a coordinate there."""
        last = self._last.get(line)
        return last if last is not None and last is not robot and last.line == line and last.end >= at else None


def room(robot: Follower, before: Follower) -> float:
    """Return how far a robot may drive, in the direction of its line, m: up to where the one before it stands or will stand."""
    kind, other = KINDS[kind_of(robot.name)], KINDS[kind_of(before.name)]
    tail = other.width / 2 if before.is_across else other.tows + KINDS["bin"].length / 2 if before.bin else other.length / 2
    return before.end - tail - STOP_DISTANCE - kind.length / 2
