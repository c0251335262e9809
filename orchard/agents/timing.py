"""How long the motion of a plan takes without traffic."""

from collections.abc import Iterator

from orchard.agents.robot import Step
from orchard.agents.route import OneWay, Side
from orchard.field.geometry import Pose


def way_to(route: OneWay, lane: int, side: Side) -> tuple[float, float]:
    """Return the metres by road from the queue's head to a carrier's stop at a lane, and the time from its departure until then, s."""
    head = route.queue.place(0)
    return route.distance(head.x, head.y, lane, side), duration(route.approach(lane, side), head)


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
