"""Coupling and uncoupling by a robot that ROS drives: its velocity is 0, and its deed is sent until
physics has done or refused it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import hypot
from typing import Any

from orchard_ros2.plain.bodies import kind_of
from orchard_ros2.wire import state_of

Pose = Mapping[str, Any]  # the Orchard's message `pose`

# 5 s of simulated time: a step ends a motion, and the next one does the deed; the rest is for the
# network.
PATIENCE_TICKS = 50
COUPLE, UNCOUPLE = "couple", "uncouple"


@dataclass
class Handling:
    """A couple or uncouple that is under way."""

    robot: str
    what: str  #: COUPLE or UNCOUPLE
    bin: str  #: for COUPLE
    began: int  #: tick

    def outcome(self, pose: Pose) -> str | None:
        """Return '' if it is done at this pose, why it is given up, or None if it goes on."""
        hitch = pose.get("hitch")
        if (hitch["name"] if hitch else "") == self.bin:
            return ""
        if pose["tick"] - self.began > PATIENCE_TICKS:
            return (
                f"{self.robot}: not done within {PATIENCE_TICKS / 10:g} s: a robot can {self.what}"
                " only while it and its bin stand"
            )
        return None

    def deeds(self, pose: Pose) -> list[dict[str, str]]:
        """Return the deeds to send with a velocity of 0: none while something still moves."""
        hitch = pose.get("hitch")
        if any(state_of(pose)[4:]) or (hitch and any(state_of(hitch)[4:])):
            return []
        return [{"type": COUPLE, "bin": self.bin} if self.what == COUPLE else {"type": UNCOUPLE}]


def bin_behind(robot: str, tows: float, poses: Mapping[str, Pose]) -> str:
    """Return the bin whose centre is nearest to the coupling point of a robot; '' if no bin is
    known.

    `tows`: the coupling point behind the robot's centre, m; `poses`: name -> its newest pose.
    """
    x, y, z, w, *_ = state_of(poses[robot])
    at = x - tows * (w * w - z * z), y - tows * 2.0 * z * w
    bins = {name: state_of(pose) for name, pose in poses.items() if kind_of(name) == "bin"}
    return min(
        bins,
        key=lambda name: (hypot(bins[name][0] - at[0], bins[name][1] - at[1]), name),
        default="",
    )
