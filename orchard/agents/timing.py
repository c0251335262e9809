"""How long the motion of a plan takes without traffic."""

from collections.abc import Iterator

from orchard.agents.robot import Step
from orchard.agents.route import OneWay, Side
from orchard.field.geometry import Pose


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
    """Each step of a plan, the pose in which it begins, and when it begins and ends without obstacles, s. Only motion takes time."""
    pose, begins = start, 0.0
    for step in steps:
        end, seconds = step.motion(pose)
        yield step, pose, begins, begins + seconds
        pose, begins = end, begins + seconds
