"""People and animals: they walk about, at random, and are in the way of robots.

People walk straight on. Animals choose a new speed and turn (a "whim") every 3 s. Both turn away
from what is in their path, and neither lingers for long: one that has hardly moved for a while
"breaks out" in a free direction. docs/reference.md, "The behaviours", has the rules and figures;
"manual" means the user manual of 2015 (docs/manual.md).
"""

import math

import msgspec

from orchard.contract.agent import MOST_HOLD, Action, Heard, Hold, Mail, Observation, State
from orchard.contract.messages import LAST_TICK, Answer, No, Position, Where
from orchard.contract.zone import is_left_freer
from orchard.field.geometry import STILL, Twist, angle_between
from orchard.field.kinds import KINDS, Kind, kind_of
from orchard.field.layout import Layout
from orchard.field.repeatable import PI, draw, wrap
from orchard.field.scenario import TICKS_PER_SECOND, TIME_STEP
from orchard.plans.sense import free_directions, is_path_free, path

STEER_WITHIN = 4.0  # m: for what is nearer in its path a walker steers aside while it walks
TURN_WITHIN = 1.0  # m: for what is nearer it stops and turns, until twice as much is free
STEER = PI / 8  # rad/s while it walks on
BACK = Twist(x=-0.5)
LEFT = Twist(yaw=PI / 4)
RIGHT = Twist(yaw=-PI / 4)
ON = Twist(x=0.5)
# What a walker tries after a collision, each with the same chance: to back off is three times as
# probable as any other way.
WAYS = (BACK, BACK, BACK, LEFT, RIGHT, ON)
RECOVERY = 12  # ticks for which it tries one of them
# m. A walker lingers while it is no farther than this from the place in its memory: it may still be
# within a circle with a radius of 3 m.
LINGER = 6.0
LINGER_TICKS = 200  # ticks after which it breaks out, 20 s
OUT_TICKS = 80  # ticks for which it walks in one direction to get out
# m that must be free in that direction; if no direction is free so far, the second value.
FREE = (3.0, 1.5)
EVADING_SPEED = 1.0  # m/s, at most, of an animal that turns away or breaks out
STRAIGHT = 1e-9  # rad: a walker that is turned less from its way out faces it

MIND_CHANGES = 3 * TICKS_PER_SECOND  # ticks between two choices of an animal (manual)
SLACK = 1e-6  # m, far more than rounding
SLOW = 0.05  # m/s: a slower animal counts as standing


class WalkerMemory(msgspec.Struct):
    """The place where a walker lingers, and the direction in which it breaks out."""

    x: float
    y: float
    since: int  # tick at which it came to x, y
    # Whether it stopped for something near, and turns until its way is free.
    turning: bool = False
    # Whether it wanted to move in the last tick.
    moving: bool = False
    # Index in WAYS of what it tries.
    way: int = 0
    recovers_until: int = 0  # tick
    out: float | None = None  # rad, the yaw in which it breaks out
    until: int = 0  # tick at which breaking out ends


class Person:
    """Walks about the orchard."""

    Memory = WalkerMemory
    holds = True

    def __init__(self, layout: Layout, name: str) -> None:
        self.seed = layout.scenario.seed
        self.kind = KINDS[kind_of(name)]

    def tick(self, seen: Observation, mail: Mail, memory: WalkerMemory | None) -> Action:
        """Walk straight on, unless something is in the way."""
        memory = memory or self.Memory(seen.x, seen.y, seen.tick)
        whim = Twist(x=self.kind.speed)
        twist, evading = walk(
            seen, memory, self.kind, seed=self.seed, speed=self.kind.speed, whim=whim
        )
        return Action(
            twist=twist,
            answers=tell_where(seen, mail),
            memory=memory,
            doing=evading or "walking",
            state="driving",
            hold=hold_of(seen, memory, twist, evading),
        )


class AnimalMemory(WalkerMemory):
    """The present choice of an animal."""

    speed: float = 0.0  # m/s
    rate: float = 0.0  # rad/s
    turning_until: int = 0  # tick
    # Number of the present choice; -1: none yet.
    mind: int = -1


class Animal:
    """Wanders at random."""

    Memory = AnimalMemory
    holds = True

    def __init__(self, layout: Layout, name: str) -> None:
        self.seed = layout.scenario.seed
        self.kind = KINDS[kind_of(name)]
        # Ticks by which its choices come earlier than those of an animal without a phase.
        self.phase = int(MIND_CHANGES * draw(self.seed, f"phase of {name}", 0)[0])

    def tick(self, seen: Observation, mail: Mail, memory: AnimalMemory | None) -> Action:
        """Follow the present whim, unless something is in the way."""
        memory = memory or self.Memory(seen.x, seen.y, seen.tick)
        mind = (seen.tick + self.phase) // MIND_CHANGES
        if mind != memory.mind:
            memory.mind = mind
            self.change_mind(seen, memory)
        whim_ends = (mind + 1) * MIND_CHANGES - self.phase
        whim = Twist(x=memory.speed)
        if seen.tick < memory.turning_until:
            whim_ends = min(whim_ends, memory.turning_until)
            whim = Twist(x=memory.speed, yaw=memory.rate)
        speed = min(memory.speed, EVADING_SPEED)
        twist, evading = walk(seen, memory, self.kind, seed=self.seed, speed=speed, whim=whim)
        state: State = "driving"
        doing = evading or "wandering"
        stands = not evading and memory.speed < SLOW
        if stands:
            state = "resting"
            doing = "standing"
        return Action(
            twist=twist,
            answers=tell_where(seen, mail),
            memory=memory,
            doing=doing,
            state=state,
            hold=hold_of(seen, memory, twist, evading, whim_ends),
        )

    def change_mind(self, seen: Observation, memory: AnimalMemory) -> None:
        """Choose a turn to either side, and a speed.

        The turn has up to 2 pi rad/s, and lasts for up to a second; the speed is up to 3 m/s.
        """
        rate, speed, length = draw(self.seed, seen.name, memory.mind * MIND_CHANGES, 3)
        memory.rate = (2 * rate - 1) * self.kind.turn
        memory.speed = speed * self.kind.speed
        memory.turning_until = seen.tick + int(TICKS_PER_SECOND * length)


def tell_where(seen: Observation, mail: Mail) -> list[tuple[Heard, Answer]]:
    """Return the walker's answers.

    They are its position to robots that ask for it, and a refusal to all other requests.
    """
    here = Position(seen.x, seen.y)
    answers: list[tuple[Heard, Answer]] = []
    for heard in mail.requests:
        if isinstance(heard.body, Where):
            answers.append((heard, here))
        else:
            answers.append((heard, No("I only walk here")))
    return answers


def walk(
    seen: Observation, memory: WalkerMemory, kind: Kind, *, seed: int, speed: float, whim: Twist
) -> tuple[Twist, str]:
    """Return a walker's velocity, and what it does to evade: 'turning away', or ''.

    `whim`: its velocity if nothing makes it steer. `speed`: m/s, if something does.
    """
    twist = bump(seen, memory, seed)
    if twist is None:
        twist = break_out(seen, memory, seed, min(EVADING_SPEED, kind.speed), kind.turn)
    if twist is None:
        twist = avoid(seen, memory, speed, kind.turn)
    evading = "turning away"
    if twist is None:
        twist = whim
        evading = ""
    memory.moving = twist != STILL
    return twist, evading


def bump(seen: Observation, memory: WalkerMemory, seed: int) -> Twist | None:
    """Return the velocity of a walker for a while after a collision; else None.

    It backs off, turns aside or goes on, by chance.
    """
    # It wanted to move, and did not: physics has refused the step.
    if memory.moving and seen.twist == STILL:
        # `break_out` uses the first of these numbers.
        _, chance = draw(seed, seen.name, seen.tick, 2)
        memory.way = int(len(WAYS) * chance)
        memory.recovers_until = seen.tick + RECOVERY
        memory.out = None
    if seen.tick < memory.recovers_until:
        return WAYS[memory.way]
    return None


def avoid(seen: Observation, memory: WalkerMemory, speed: float, most_turn: float) -> Twist | None:
    """Return the velocity that turns away from an obstacle; None if the way is free."""
    if is_path_free(seen, STEER_WITHIN):
        memory.turning = False
        return None
    turn_within = TURN_WITHIN
    if memory.turning:
        # It turns further than it must.
        turn_within = 2 * TURN_WITHIN
    memory.turning = not is_path_free(seen, turn_within)
    if memory.turning:
        return Twist(yaw=min(PI / 2, most_turn))
    if is_left_freer(seen.scan, STEER_WITHIN):
        return Twist(x=speed, yaw=STEER)
    return Twist(x=speed, yaw=-STEER)


def break_out(
    seen: Observation, memory: WalkerMemory, seed: int, speed: float, most_turn: float
) -> Twist | None:
    """Return the velocity with which a lingering walker leaves; None if it does not linger.

    It leaves in a direction that is free.
    """
    if (seen.x - memory.x) ** 2 + (seen.y - memory.y) ** 2 > LINGER**2:
        memory.x = seen.x
        memory.y = seen.y
        memory.since = seen.tick
        memory.out = None
    if seen.tick - memory.since < LINGER_TICKS:
        return None
    if memory.out is None or seen.tick >= memory.until:
        memory.out = wrap(seen.pose.yaw + way_out(seen, draw(seed, seen.name, seen.tick)[0]))
        memory.until = seen.tick + OUT_TICKS
    turn = angle_between(seen.pose.yaw, memory.out)
    if abs(turn) > STRAIGHT:
        return Twist(yaw=max(-most_turn, min(most_turn, turn / TIME_STEP)))
    if not is_path_free(seen, TURN_WITHIN / 2):
        # It stands for a tick, and chooses another direction in the next one.
        memory.out = None
        return Twist()
    return Twist(x=speed)


def hold_of(
    seen: Observation, memory: WalkerMemory, twist: Twist, evading: str, until: int = LAST_TICK
) -> Hold | None:
    """Return how long a walker keeps its velocity: as long as it does the same.

    `until`: when its whim ends. It is asked earlier when what `walk` decides by may change: whether
    its path is free as far as matters, and which side is freer.
    """
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
    """Return the ticks for which a walker surely stays within LINGER of where it lingers."""
    dx = seen.x - memory.x
    dy = seen.y - memory.y
    room = max(0.0, LINGER - math.sqrt(dx * dx + dy * dy) - SLACK)
    step = twist.x * TIME_STEP
    if step * MOST_HOLD > room:
        return int(room / step)
    return MOST_HOLD


def way_out(seen: Observation, chance: float) -> float:
    """Return the angle to a free direction, rad; if none is free, to one behind.

    `chance`: 0 to 1, chooses one of several.
    """
    for reach in FREE:
        free = free_directions(seen, reach)
        if free:
            return free[int(chance * len(free))]
    return PI / 2 + chance * PI
