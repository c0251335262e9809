"""What people and animals share: walking on, turning away from what is in the way, and never lingering for long."""

import msgspec

from orchard.agents.sense import free_directions, freer_side, nearest_in_path
from orchard.contract.agent import Heard, Mail, Observation
from orchard.contract.messages import Answer, No, Position, Where
from orchard.field.geometry import STILL, Twist, angle_between
from orchard.field.kinds import Kind
from orchard.field.repeatable import PI, draw, wrap
from orchard.field.scenario import TIME_STEP

STEER_WITHIN = 4.0  # m (reference.md)
TURN_WITHIN = 1.0  # m
STEER = PI / 8  # rad/s while it walks on
BACK, LEFT, RIGHT, ON = Twist(x=-0.5), Twist(yaw=PI / 4), Twist(yaw=-PI / 4), Twist(x=0.5)
WAYS = (BACK, BACK, BACK, LEFT, RIGHT, ON)  # what one tries that bumped into something
RECOVERY = 12  # ticks for which it tries
LINGER = 6.0  # m: who has come no farther than this from a place, and so may still be within a circle of 3 m, ...
LINGER_TICKS = 200  # ... after a third of a minute breaks out of it
OUT_TICKS = 80  # for which it walks in one direction to get out
FREE = (3.0, 1.5)  # m that it wants to find free, or at least


class WalkerMemory(msgspec.Struct):
    """Where it lingers, and the heading in which it breaks out."""

    x: float
    y: float
    since: int  # tick at which it came here
    turning: bool = False  # it stopped for something near, and turns until its way is free
    moving: bool = False  # it wanted to move in the last tick
    way: int = 0  # which of the ways it tries
    recovers_until: int = 0  # tick
    out: float | None = None  # yaw in which it breaks out
    until: int = 0  # tick at which breaking out ends


def tell_where(seen: Observation, mail: Mail) -> list[tuple[Heard, Answer]]:
    """The answers to robots that ask where it is; nothing else concerns it."""
    here = Position(seen.x, seen.y)
    return [(heard, here if isinstance(heard.body, Where) else No("I only walk here")) for heard in mail.requests]


def walk(seen: Observation, memory: WalkerMemory, seed: int, speed: float, kind: Kind, whim: Twist) -> tuple[Twist, str]:
    """The velocity of somebody who would follow a whim, at no more than a speed when something is near; and what that is called."""
    twist = bump(seen, memory, seed) or break_out(seen, memory, seed, min(1.0, kind.speed), kind.turn)
    twist = twist or avoid(seen, memory, speed, kind.turn)
    memory.moving = (twist or whim) != STILL
    return twist or whim, "turning away" if twist else ""


def bump(seen: Observation, memory: WalkerMemory, seed: int) -> Twist | None:
    """Back off for a while, or turn aside, for one whose last step something was in the way of; None for all others."""
    if memory.moving and seen.twist == STILL:
        memory.way = int(len(WAYS) * draw(seed, seen.name, seen.tick, 2)[1])
        memory.recovers_until, memory.out = seen.tick + RECOVERY, None
    return WAYS[memory.way] if seen.tick < memory.recovers_until else None


def avoid(seen: Observation, memory: WalkerMemory, speed: float, most_turn: float) -> Twist | None:
    """The velocity that turns away from what is in the way; None where the way is free."""
    ahead = nearest_in_path(seen, STEER_WITHIN)
    if ahead < TURN_WITHIN or (memory.turning and ahead < 2 * TURN_WITHIN):
        memory.turning = True
        return Twist(yaw=min(PI / 2, most_turn))
    memory.turning = False
    return Twist(x=speed, yaw=STEER * freer_side(seen, STEER_WITHIN)) if ahead < STEER_WITHIN else None


def break_out(seen: Observation, memory: WalkerMemory, seed: int, speed: float, most_turn: float) -> Twist | None:
    """The velocity with which one that lingers leaves, towards a side that is free; None for one that does not linger."""
    if (seen.x - memory.x) ** 2 + (seen.y - memory.y) ** 2 > LINGER**2:
        memory.x, memory.y, memory.since, memory.out = seen.x, seen.y, seen.tick, None
    if seen.tick - memory.since < LINGER_TICKS:
        return None
    if memory.out is None or seen.tick >= memory.until:
        memory.out = wrap(seen.pose.yaw + way_out(seen, draw(seed, seen.name, seen.tick)[0]))
        memory.until = seen.tick + OUT_TICKS
    left = angle_between(seen.pose.yaw, memory.out)
    if abs(left) > 1e-9:
        return Twist(yaw=max(-most_turn, min(most_turn, left / TIME_STEP)))
    if nearest_in_path(seen, TURN_WITHIN) < TURN_WITHIN / 2:
        memory.out = None
        return Twist()
    return Twist(x=speed)


def way_out(seen: Observation, chance: float) -> float:
    """The angle to one of the directions in which the way is free, by chance (0 to 1); where none is, somewhere behind its back."""
    for reach in FREE:
        free = free_directions(seen, reach)
        if free:
            return free[int(chance * len(free))]
    return PI / 2 + chance * PI
