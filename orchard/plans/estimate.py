"""Where a robot takes itself to be (docs/reference.md).

Its odometry carries its estimate on, and each new position corrects it: this is a complementary
filter. While it drives, a robot also learns by which share its odometry measures too much or too
little.
"""

import msgspec

from orchard.contract.agent import Observation
from orchard.field.geometry import Pose, from_frame, to_frame
from orchard.field.scenario import TIME_STEP

# Share of the difference between position and estimate that corrects the estimate. As of any
# exponential smoothing, of white errors sqrt(GAIN / (2 - GAIN)) remains, which is 23 %.
GAIN = 0.1
# Share that is learned for each m by which the estimate was wrong and each m driven since: in some
# 3 s at 1 m/s.
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
    # m by which its position is ahead of where its odometry has it.
    further, _ = to_frame(Pose(x, y, seen.pose.yaw), seen.x, seen.y)
    return Estimate(
        tick=seen.tick,
        x=x + GAIN * (seen.x - x),
        y=y + GAIN * (seen.y - y),
        share=before.share + LEARN * further * ahead,
    )


def as_seen_from(place: Estimate, seen: Observation) -> Observation:
    """Return the observation with the estimate in place of the measured position.

    What is on the bar moves with it.
    """
    dx = place.x - seen.x
    dy = place.y - seen.y
    hitch = seen.hitch
    if hitch is not None:
        hitch = hitch._replace(x=hitch.x + dx, y=hitch.y + dy)
    return msgspec.structs.replace(seen, x=place.x, y=place.y, hitch=hitch)
