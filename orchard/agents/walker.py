"""What people and animals share: walking on, turning away from what is in the way, and never lingering for long."""

import msgspec

from orchard.agent import Observation
from orchard.draw import draw
from orchard.geometry import Twist, angle_between
from orchard.sense import freer_side, nearest_in_path
from orchard.trig import PI, TURN, wrap

STEER_WITHIN = 4.0  # m (reference.md)
TURN_WITHIN = 1.0  # m
STEER = PI / 8  # rad/s while it walks on
LINGER = 3.0  # m: it leaves every circle of this radius ...
LINGER_TICKS = 300  # ... within a minute; after half of one it breaks out


class WalkerMemory(msgspec.Struct):
    """Where it lingers, and the heading in which it breaks out."""

    x: float
    y: float
    since: int  # tick at which it came here
    turning: bool = False  # it stopped for something near, and turns until its way is free
    out: float | None = None  # yaw in which it breaks out
    until: int = 0  # tick at which breaking out ends


def avoid(seen: Observation, memory: WalkerMemory, speed: float, most_turn: float) -> Twist | None:
    """The velocity that turns away from what is in the way; None where the way is free."""
    ahead = nearest_in_path(seen, STEER_WITHIN)
    if ahead < TURN_WITHIN or (memory.turning and ahead < 2 * TURN_WITHIN):
        memory.turning = True
        return Twist(yaw=min(PI / 2, most_turn))
    memory.turning = False
    return Twist(x=speed, yaw=STEER * freer_side(seen, STEER_WITHIN)) if ahead < STEER_WITHIN else None


def break_out(seen: Observation, memory: WalkerMemory, seed: int, speed: float, most_turn: float) -> Twist | None:
    """The velocity with which one that lingers leaves, in a random direction that is free; None for one that does not."""
    if (seen.x - memory.x) ** 2 + (seen.y - memory.y) ** 2 > LINGER**2:
        memory.x, memory.y, memory.since, memory.out = seen.x, seen.y, seen.tick, None
    if seen.tick - memory.since < LINGER_TICKS:
        return None
    if memory.out is None or seen.tick >= memory.until:
        memory.out, memory.until = wrap(TURN * draw(seed, seen.name, seen.tick)[0]), seen.tick + 40
    left = angle_between(seen.pose.yaw, memory.out)
    if abs(left) > 1e-9:
        return Twist(yaw=max(-most_turn, min(most_turn, left / 0.1)))
    if nearest_in_path(seen, TURN_WITHIN) < TURN_WITHIN / 2:
        memory.out = None
        return Twist()
    return Twist(x=speed)
