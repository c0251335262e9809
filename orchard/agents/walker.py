"""People, who walk straight on, and animals, which choose anew every 3 s. None lingers for long."""

import math

import msgspec

from orchard.agents.sense import free_directions, is_path_free, path
from orchard.contract.agent import MOST_HOLD, Action, Heard, Hold, Mail, Observation, State
from orchard.contract.messages import LAST_TICK, Answer, No, Position, Where
from orchard.contract.zone import is_left_freer
from orchard.field.geometry import STILL, Twist, angle_between
from orchard.field.kinds import KINDS, Kind, kind_of
from orchard.field.layout import Layout
from orchard.field.repeatable import PI, draw, wrap
from orchard.field.scenario import TICKS_PER_SECOND, TIME_STEP

STEER_WITHIN = 4.0  # m (docs/reference.md)
TURN_WITHIN = 1.0  # m
STEER = PI / 8  # rad/s while it walks on
BACK, LEFT, RIGHT, ON = Twist(x=-0.5), Twist(yaw=PI / 4), Twist(yaw=-PI / 4), Twist(x=0.5)
WAYS = (BACK, BACK, BACK, LEFT, RIGHT, ON)  # what a walker tries after a collision
RECOVERY = 12  # ticks for which it tries one of them
LINGER = 6.0  # m: a walker that has got no farther from a place, and so may still be within a circle of 3 m, ...
LINGER_TICKS = 200  # ... breaks out of it after 20 s
OUT_TICKS = 80  # ticks for which it walks in one direction to get out
FREE = (3.0, 1.5)  # m that must be free in that direction; if no direction is, the second value

MIND_CHANGES = 3 * TICKS_PER_SECOND  # ticks between two choices of an animal (manual)
SLACK = 1e-6  # m, far more than rounding
SLOW = 0.05  # m/s: a slower animal counts as standing


class WalkerMemory(msgspec.Struct):
    """The place where a walker lingers, and the direction in which it breaks out."""

    x: float
    y: float
    since: int  # tick at which it came here
    turning: bool = False  # it stopped for something near, and turns until its way is free
    moving: bool = False  # it wanted to move in the last tick
    way: int = 0  # index in WAYS of what it tries
    recovers_until: int = 0  # tick
    out: float | None = None  # rad, the yaw in which it breaks out
    until: int = 0  # tick at which breaking out ends


class Person:
    """Walks about the orchard."""

    Memory = WalkerMemory
    holds = True

    def __init__(self, layout: Layout, name: str) -> None:
        self.seed, self.kind = layout.scenario.seed, KINDS[kind_of(name)]

    def tick(self, seen: Observation, mail: Mail, memory: WalkerMemory | None) -> Action:
        memory = memory or self.Memory(seen.x, seen.y, seen.tick)
        twist, evading = walk(
            seen, memory, self.seed, self.kind.speed, self.kind, Twist(x=self.kind.speed)
        )
        hold, doing = hold_of(seen, memory, twist, evading), evading or "walking"
        return Action(
            twist=twist,
            answers=tell_where(seen, mail),
            memory=memory,
            doing=doing,
            state="driving",
            hold=hold,
        )


class AnimalMemory(WalkerMemory):
    """The present choice of an animal."""

    speed: float = 0.0  # m/s
    rate: float = 0.0  # rad/s
    turning_until: int = 0  # tick
    mind: int = -1  # number of the present choice; -1: none yet


class Animal:
    """Wanders at random."""

    Memory = AnimalMemory
    holds = True

    def __init__(self, layout: Layout, name: str) -> None:
        self.seed, self.kind = layout.scenario.seed, KINDS[kind_of(name)]
        self.phase = int(MIND_CHANGES * draw(self.seed, f"phase of {name}", 0)[0])

    def tick(self, seen: Observation, mail: Mail, memory: AnimalMemory | None) -> Action:
        memory = memory or self.Memory(seen.x, seen.y, seen.tick)
        if (mind := (seen.tick + self.phase) // MIND_CHANGES) != memory.mind:
            memory.mind = mind
            self.change_mind(seen, memory)
        whim = Twist(x=memory.speed, yaw=memory.rate if seen.tick < memory.turning_until else 0.0)
        twist, evading = walk(seen, memory, self.seed, min(memory.speed, 1.0), self.kind, whim)
        doing = evading or ("wandering" if memory.speed >= SLOW else "standing")
        state: State = "resting" if doing == "standing" else "driving"
        whims = [
            (mind + 1) * MIND_CHANGES - self.phase,
            *([memory.turning_until] if seen.tick < memory.turning_until else []),
        ]
        hold = hold_of(seen, memory, twist, evading, min(whims))
        return Action(
            twist=twist,
            answers=tell_where(seen, mail),
            memory=memory,
            doing=doing,
            state=state,
            hold=hold,
        )

    def change_mind(self, seen: Observation, memory: AnimalMemory) -> None:
        """Choose a turn to either side at up to 2 pi rad/s, for up to a second, and a speed of up to 3 m/s."""
        rate, speed, length = draw(self.seed, seen.name, memory.mind * MIND_CHANGES, 3)
        memory.rate, memory.speed = (2 * rate - 1) * self.kind.turn, speed * self.kind.speed
        memory.turning_until = seen.tick + int(TICKS_PER_SECOND * length)


def tell_where(seen: Observation, mail: Mail) -> list[tuple[Heard, Answer]]:
    """Return the walker's answers: its position to robots that ask for it, a refusal to all other requests."""
    here = Position(seen.x, seen.y)
    return [
        (heard, here if isinstance(heard.body, Where) else No("I only walk here"))
        for heard in mail.requests
    ]


def walk(
    seen: Observation, memory: WalkerMemory, seed: int, speed: float, kind: Kind, whim: Twist
) -> tuple[Twist, str]:
    """Return a walker's velocity, and 'turning away' if something makes it steer, at `speed` m/s, else `whim` and ''."""
    twist = bump(seen, memory, seed) or break_out(
        seen, memory, seed, min(1.0, kind.speed), kind.turn
    )
    twist = twist or avoid(seen, memory, speed, kind.turn)
    memory.moving = (twist or whim) != STILL
    return twist or whim, "turning away" if twist else ""


def bump(seen: Observation, memory: WalkerMemory, seed: int) -> Twist | None:
    """Return the velocity with which a walker backs off, or turns aside, for a while after a collision; else None."""
    if memory.moving and seen.twist == STILL:
        memory.way = int(len(WAYS) * draw(seed, seen.name, seen.tick, 2)[1])
        memory.recovers_until, memory.out = seen.tick + RECOVERY, None
    return WAYS[memory.way] if seen.tick < memory.recovers_until else None


def avoid(seen: Observation, memory: WalkerMemory, speed: float, most_turn: float) -> Twist | None:
    """Return the velocity that turns away from an obstacle; None if the way is free."""
    if is_path_free(seen, STEER_WITHIN):
        memory.turning = False
        return None
    memory.turning = not is_path_free(seen, 2 * TURN_WITHIN if memory.turning else TURN_WITHIN)
    if memory.turning:
        return Twist(yaw=min(PI / 2, most_turn))
    return Twist(x=speed, yaw=STEER if is_left_freer(seen.scan, STEER_WITHIN) else -STEER)


def break_out(
    seen: Observation, memory: WalkerMemory, seed: int, speed: float, most_turn: float
) -> Twist | None:
    """Return the velocity with which a lingering walker leaves in a free direction; None if it does not linger."""
    if (seen.x - memory.x) ** 2 + (seen.y - memory.y) ** 2 > LINGER**2:
        memory.x, memory.y, memory.since, memory.out = seen.x, seen.y, seen.tick, None
    if seen.tick - memory.since < LINGER_TICKS:
        return None
    if memory.out is None or seen.tick >= memory.until:
        out = wrap(seen.pose.yaw + way_out(seen, draw(seed, seen.name, seen.tick)[0]))
        memory.out, memory.until = out, seen.tick + OUT_TICKS
    left = angle_between(seen.pose.yaw, memory.out)
    if abs(left) > 1e-9:
        return Twist(yaw=max(-most_turn, min(most_turn, left / TIME_STEP)))
    if not is_path_free(seen, TURN_WITHIN / 2):
        memory.out = None
        return Twist()
    return Twist(x=speed)


def hold_of(
    seen: Observation, memory: WalkerMemory, twist: Twist, evading: str, until: int = LAST_TICK
) -> Hold | None:
    """Return how long a walker keeps its velocity: as long as it does the same. `until`: when its whim ends."""
    if seen.tick < memory.recovers_until:
        return Hold(min(until, memory.recovers_until))
    until = min(
        until, memory.since + LINGER_TICKS, seen.tick + ticks_within(seen, memory, twist) + 1
    )
    if memory.turning:
        return Hold(until, watch=(path(seen, 2 * TURN_WITHIN),))
    if evading:
        return Hold(
            until,
            watch=(path(seen, STEER_WITHIN), path(seen, TURN_WITHIN)),
            freer_within=STEER_WITHIN,
        )
    return Hold(until, watch=(path(seen, STEER_WITHIN),))


def ticks_within(seen: Observation, memory: WalkerMemory, twist: Twist) -> int:
    """Return the ticks for which a walker surely stays within LINGER of the place where it lingers."""
    dx, dy = seen.x - memory.x, seen.y - memory.y
    room = max(0.0, LINGER - math.sqrt(dx * dx + dy * dy) - SLACK)
    return (
        int(room / (twist.x * TIME_STEP)) if twist.x * TIME_STEP * MOST_HOLD > room else MOST_HOLD
    )


def way_out(seen: Observation, chance: float) -> float:
    """Return the angle to a free direction, rad, chosen by `chance` (0 to 1); if none is free, to one behind."""
    for reach in FREE:
        if free := free_directions(seen, reach):
            return free[int(chance * len(free))]
    return PI / 2 + chance * PI
