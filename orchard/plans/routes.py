"""The routes by name, and how long motion takes without traffic.

A scenario names a built-in route, or a class of the user's own that is derived from `OneWay`.
"""

from collections.abc import Iterator

from orchard.field.geometry import Pose
from orchard.field.layout import Layout
from orchard.field.machines import Machine
from orchard.field.plugins import make_plugin
from orchard.field.queue import ONE_WAY, TWO_WAY
from orchard.plans.robot import Step
from orchard.plans.route import OneWay, Side
from orchard.plans.two_way import TwoWay

# Name of a built-in route -> its class.
ROUTES = {ONE_WAY: OneWay, TWO_WAY: TwoWay}


def route_of(layout: Layout) -> OneWay:
    """Return the route that the scenario names. Raises ScenarioError if it cannot be used."""
    return make_plugin("route", layout.scenario.route, ROUTES, layout, base=OneWay)


def way_to(route: OneWay, lane: int, side: Side) -> tuple[float, float]:
    """Return a carrier's way from the queue's head to its stop at a lane, m by road, and s.

    The head is that of the first line.
    """
    head = route.queue.place(0)
    seconds = duration(route.approach(lane, side), head, route.layout.machines["carrier"])
    return route.distance(head.x, head.y, lane, side), seconds


def duration(steps: list[Step], start: Pose, machine: Machine) -> float:
    """Return the time of a machine's drives and turns without obstacles, s."""
    return max((ends for _, _, _, ends in timetable(steps, start, machine)), default=0.0)


def timetable(
    steps: list[Step], start: Pose, machine: Machine
) -> Iterator[tuple[Step, Pose, float, float]]:
    """Yield each step of a machine's plan, the pose in which it begins, and when it begins and
    ends, s from the beginning of the plan.

    Only motion takes time here: places are free, and bins are handled at once.
    """
    pose = start
    begins = 0.0
    for step in steps:
        end, seconds = step.motion(pose, machine)
        yield step, pose, begins, begins + seconds
        pose = end
        begins += seconds
