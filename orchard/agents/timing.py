"""How long the drives and turns of a plan take without traffic."""

from collections.abc import Iterator

from orchard.agents.robot import Step
from orchard.agents.route import OneWay, Side
from orchard.agents.steps import DriveTo, Face
from orchard.field.geometry import HEADINGS, Pose, angle_between
from orchard.field.kinds import EIGHTH


def head(route: OneWay) -> Pose:
    """Return the pose of a carrier at the head of the first line of the queue."""
    return route.queue.place(0)


def approach_seconds(route: OneWay, lane: int, side: Side) -> float:
    """Return the time from a carrier's departure at the queue's head until it can leave its bin for the picker of a lane, s."""
    return duration(route.approach(lane, side), head(route))


def duration(steps: list[Step], start: Pose) -> float:
    """Return the time of a plan's drives and turns without obstacles, s."""
    return max((ends for _, _, _, ends in timetable(steps, start)), default=0.0)


def timetable(steps: list[Step], start: Pose) -> Iterator[tuple[Step, Pose, float, float]]:
    """Each step of a plan, the pose in which it begins, and when it begins and ends without obstacles, s. Drives and turns take time."""
    (x, y, yaw), seconds = start, 0.0
    for step in steps:
        pose, begins = Pose(x, y, yaw), seconds
        if isinstance(step, Face):
            seconds += abs(angle_between(yaw, HEADINGS[step.heading])) / EIGHTH
            yaw = HEADINGS[step.heading]
        elif isinstance(step, DriveTo):
            to_x, to_y = x if step.x is None else step.x, y if step.y is None else step.y
            seconds += (abs(to_x - x) + abs(to_y - y)) / step.speed
            x, y = to_x, to_y
        yield step, pose, begins, seconds
