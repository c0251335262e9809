"""Coupling and uncoupling by a robot that ROS drives.

A deed is what a robot does beside driving, as the Orchard's message `velocity` holds it: to couple
a bin to its bar, or to uncouple it. Meanwhile the robot's velocity is 0. The deed is sent again
until physics has done or refused it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import hypot
from typing import Any

from orchard_ros2.plain.bodies import kind_of
from orchard_ros2.wire import state_of

#: The Orchard's message `pose`.
Pose = Mapping[str, Any]

TICKS_PER_SECOND = 10
# Ticks after which a deed is given up, 5 s of simulated time. A step ends a motion, and the next
# one does the deed; the rest is for the network.
PATIENCE_TICKS = 50
COUPLE = "couple"
UNCOUPLE = "uncouple"


@dataclass
class Handling:
    """A coupling or uncoupling that is under way.

    `action`: COUPLE or UNCOUPLE. `bin`: the bin to couple; '' to uncouple. `began`: tick.
    """

    robot: str
    action: str
    bin: str
    began: int

    def outcome(self, pose: Pose) -> str | None:
        """Return '' if it is done at this pose, why it is given up, or None if it goes on."""
        hitch = pose.get("hitch")
        # The bin on the bar; '' for none, which is what an uncoupling wants.
        coupled_bin = hitch["name"] if hitch else ""
        if coupled_bin == self.bin:
            return ""
        if pose["tick"] - self.began > PATIENCE_TICKS:
            return (
                f"{self.robot}: not done within {PATIENCE_TICKS / TICKS_PER_SECOND:g} s: a robot"
                f" can {self.action} only while it and its bin stand"
            )
        return None

    def deeds(self, pose: Pose) -> list[dict[str, str]]:
        """Return the deeds to send with a velocity of 0: none while something still moves."""
        hitch = pose.get("hitch")
        if _moves(pose) or (hitch and _moves(hitch)):
            return []
        if self.action == COUPLE:
            return [{"type": COUPLE, "bin": self.bin}]
        return [{"type": UNCOUPLE}]


def _moves(pose: Pose) -> bool:
    """Whether a body has any velocity: the last three numbers of its state."""
    return any(state_of(pose)[4:])


def bin_behind(robot: str, tows: float, poses: Mapping[str, Pose]) -> str:
    """Return the bin that has its centre nearest to the coupling point of a robot.

    Return '' if no bin is known. `tows`: the coupling point behind the robot's centre, m. `poses`:
    name -> its newest pose.
    """
    x, y, z, w, *_ = state_of(poses[robot])
    # z and w are sine and cosine of half the yaw, so these are cosine and sine of the yaw.
    cosine = w * w - z * z
    sine = 2.0 * z * w
    point_x = x - tows * cosine
    point_y = y - tows * sine
    distances = []
    for name, pose in poses.items():
        if kind_of(name) == "bin":
            bin_x, bin_y, *_ = state_of(pose)
            distances.append((hypot(bin_x - point_x, bin_y - point_y), name))
    _, nearest = min(distances, default=(0.0, ""))
    return nearest
