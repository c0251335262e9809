"""Where a robot takes itself to be, if its receiver has errors (docs/reference.md).

Odometry, the motion measured by the wheels, carries the robot's estimate on, and each newly
measured position corrects it: this is a complementary filter. While it drives, a robot also learns
by which share its odometry measures too much or too little.
"""

import msgspec

from orchard.contract.agent import Observation
from orchard.field.geometry import Pose, from_frame, to_frame
from orchard.field.scenario import TIME_STEP

# Share of the difference between measured position and estimate by which the estimate is corrected
# at each tick. As in any exponential smoothing, sqrt(GAIN / (2 - GAIN)) of white errors remains,
# which is 23 %.
GAIN = 0.1
# Change of `Estimate.share` for each m by which odometry was wrong and each m that was driven, per
# m2. So a wrong share is learned in some 3 s at 1 m/s.
LEARN = 0.5


class Estimate(msgspec.Struct):
    """A robot's estimate of its position."""

    tick: int
    x: float  # m
    y: float  # m
    # Metres driven for each metre that its odometry measures.
    share: float = 1.0


def place_of(seen: Observation, before: Estimate | None) -> Estimate:
    """Return a robot's estimate, for what it observes and its last estimate."""
    if before is None:
        return Estimate(seen.tick, seen.x, seen.y)
    ahead = before.share * seen.twist.x * TIME_STEP * (seen.tick - before.tick)
    x, y = from_frame(Pose(before.x, before.y, seen.pose.yaw), ahead, 0.0)
    # m by which the measured position is ahead of where odometry has the robot.
    further, _ = to_frame(Pose(x, y, seen.pose.yaw), seen.x, seen.y)
    return Estimate(
        tick=seen.tick,
        x=x + GAIN * (seen.x - x),
        y=y + GAIN * (seen.y - y),
        share=before.share + LEARN * further * ahead,
    )


def as_seen_from(place: Estimate, seen: Observation) -> Observation:
    """Return the observation with the estimate in place of the measured position.

    The bin on the bar is moved by the same difference.
    """
    dx = place.x - seen.x
    dy = place.y - seen.y
    hitch = seen.hitch
    if hitch is not None:
        hitch = hitch._replace(x=hitch.x + dx, y=hitch.y + dy)
    return msgspec.structs.replace(seen, x=place.x, y=place.y, hitch=hitch)
