"""Services by which a robot that ROS drives couples a bin, or uncouples it."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from rclpy.task import Future
from std_srvs.srv import Trigger

from orchard_ros2 import deeds
from orchard_ros2.services import Services

#: Sends a robot a velocity of 0, and deeds.
Stand = Callable[[str, list[dict[str, str]]], None]


class Coupling:
    """What robots couple and uncouple. A robot does one of them at a time."""

    def __init__(
        self,
        services: Services,
        poses: Mapping[str, deeds.Pose],
        tick: Callable[[], int],
        stand: Stand,
    ) -> None:
        """`poses`: body -> its newest pose. `tick`: returns the tick of the run."""
        self._services = services
        self._poses = poses
        self._tick = tick
        self._stand = stand
        self._under_way: dict[str, tuple[deeds.Handling, Future]] = {}

    def offer(self, robot: str, tows: float) -> None:
        """Offer both services for a robot. `tows`: its coupling point behind its centre, m."""
        self._services.offer(f"{robot}/{deeds.COUPLE}", partial(self._couple, robot, tows))
        self._services.offer(f"{robot}/{deeds.UNCOUPLE}", partial(self._uncouple, robot))

    def is_busy(self, robot: str) -> bool:
        """Whether a robot couples or uncouples now."""
        return robot in self._under_way

    def note_pose(self, robot: str, pose: deeds.Pose) -> None:
        """Go on with what a robot does, at its newest pose."""
        if robot not in self._under_way:
            return
        handling, _ = self._under_way[robot]
        outcome = handling.outcome(pose)
        if outcome is None:
            self._stand(robot, handling.deeds(pose))
        else:
            self._finish(robot, outcome)

    def note_refusal(self, robot: str, why: str) -> None:
        """Note that physics has refused what a robot does."""
        if robot in self._under_way:
            self._finish(robot, f"{robot}: {why}")

    def forget(self) -> None:
        """Give up all that is under way: the run has been reset."""
        for robot in list(self._under_way):
            self._finish(robot, f"{robot}: the run has been reset")

    async def _couple(
        self, robot: str, tows: float, _: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        target = ""
        if robot in self._poses:
            target = deeds.bin_behind(robot, tows, self._poses)
        if not target:
            return _not_now(robot, response)
        return await self._handle(robot, deeds.COUPLE, target, response)

    async def _uncouple(
        self, robot: str, _: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        return await self._handle(robot, deeds.UNCOUPLE, "", response)

    async def _handle(
        self, robot: str, action: str, target: str, response: Trigger.Response
    ) -> Trigger.Response:
        """Answer when physics has done it, has refused it, or has had its time."""
        if robot not in self._poses or robot in self._under_way:
            return _not_now(robot, response)
        future = self._services.future()
        self._under_way[robot] = deeds.Handling(robot, action, target, self._tick()), future
        why_not = await future
        response.success = not why_not
        response.message = why_not or f"{robot}: {action}d {target}".strip()
        return response

    def _finish(self, robot: str, why_not: str) -> None:
        """End a coupling or uncoupling. `why_not`: '' if it is done."""
        _, future = self._under_way.pop(robot)
        future.set_result(why_not)
        self._services.wake()


def _not_now(robot: str, response: Any) -> Any:
    """Refuse a service call that cannot begin."""
    response.message = f"{robot}: busy with a service call, or its pose or a bin is not known yet"
    return response
