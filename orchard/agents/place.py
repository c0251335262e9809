"""Where a robot takes itself to be, if its receiver is not exact: its odometry carries its estimate on, each new position corrects it.

This is a complementary filter: of white errors little is left, of slow ones all. docs/reference.md gives the figures.
"""

import msgspec

from orchard.contract.agent import Observation
from orchard.field.geometry import Pose, from_frame
from orchard.field.scenario import TIME_STEP

GAIN = 0.1  # of the difference between the position and the estimate: of white errors sqrt(0.1 / 1.9), or 23 %, is left


class Estimate(msgspec.Struct):
    """A robot's estimate of its position."""

    tick: int
    x: float  # m
    y: float  # m


def place_of(seen: Observation, before: Estimate | None) -> Estimate:
    """Return a robot's estimate, for what it observes and its last estimate."""
    if before is None:
        return Estimate(seen.tick, seen.x, seen.y)
    ahead = seen.twist.x * TIME_STEP * (seen.tick - before.tick)
    x, y = from_frame(Pose(before.x, before.y, seen.pose.yaw), ahead, 0.0)
    return Estimate(seen.tick, x + GAIN * (seen.x - x), y + GAIN * (seen.y - y))


def as_seen_from(place: Estimate, seen: Observation) -> Observation:
    """Return the observation with the estimate in place of the measured position; what is on the bar moves with it."""
    x, y = place.x - seen.x, place.y - seen.y
    hitch = seen.hitch and seen.hitch._replace(x=seen.hitch.x + x, y=seen.hitch.y + y)
    return msgspec.structs.replace(seen, x=place.x, y=place.y, hitch=hitch)
