"""The schedule of the soak: trials and their faults, derived from a seed and a number.

A trial is one run. A fault has a kind, such as a kill, and a target, such as physics. It begins at
a tick, as received on the key `clock`.
"""

from collections import Counter
from collections.abc import Sequence
from random import Random
from typing import NamedTuple

from orchard.field.scenario import TIME_STEP

# Targets: modules of processes/, and others.
PHYSICS = "physics"
HOST = "agents"
LOGGER = "logger"
ROUTER = "router"
ALL = "all processes"
RUN_PY = "run.py"
NOTHING = ""
LINK = "a link"
LINKS = "all links"
# Kinds. Three of them are signals: SIGKILL, SIGTERM, SIGINT.
KILL = "kill"
TERMINATE = "terminate"
INTERRUPT = "interrupt"
FREEZE = "freeze"
CUT = "cut"
STALL = "stall"
DELAY = "delay"
BYTES = "bad bytes"
FULL = "disk full"
TORN = "cache torn"
PORT = "port taken"
MISTAKES = "own agent's mistakes"
MORTAL = (KILL, TERMINATE, INTERRUPT, FREEZE)  # kinds that may end a process
# Kinds by which physics dies -> how often: with a taken port, once more for each start in vain.
DEATHS_OF_PHYSICS = {TORN: 1, PORT: 4}
# Kinds that last for a time -> least and most, s of wall time.
LASTS = {
    FREEZE: (0.2, 5.0),
    STALL: (0.2, 5.0),
    DELAY: (1.0, 4.0),
    FULL: (1.0, 8.0),
    PORT: (0.5, 3.0),
}
# Least and most s, from the death of the router until it is started again.
ROUTER_AWAY = (0.2, 3.0)
# Deaths of one process in a run: run.py gives up after five in a row. A frozen process counts too,
# because run.py may kill it.
MOST_DEATHS = 4
# Shares of a run: no fault begins before the first or after the last, so that each recovery is
# seen.
FIRST = 0.05
LAST = 0.85
# Ticks in which faults of a whole harvest begin: a harvest of 3 rows takes at least 5,500.
WHOLE_HARVEST = 5000
# Simulated s, of a run that is not a whole harvest.
SECONDS = (60, 120, 180, 300)
# How many seeds scenarios have: few, so that few local runs give all the hashes.
SEEDS = 4

# (kind, target) of faults. One that stands here twice is twice as frequent.
KILLS = ((KILL, PHYSICS), (KILL, HOST), (KILL, HOST), (KILL, LOGGER), (KILL, ALL), (KILL, RUN_PY))
SIGNALS = tuple(
    (kind, target) for kind in (TERMINATE, INTERRUPT) for target in (PHYSICS, HOST, LOGGER)
)
# Faults of each run.
ANYWHERE = (
    *KILLS,
    *SIGNALS,
    (FREEZE, PHYSICS),
    (FREEZE, HOST),
    (FREEZE, LOGGER),
    (BYTES, NOTHING),
    (FULL, NOTHING),
    (TORN, NOTHING),
    (MISTAKES, NOTHING),
)
# Further faults of a run with a router process of its own.
AT_A_ROUTER = (
    (KILL, ROUTER),
    (CUT, LINK),
    (CUT, LINKS),
    (STALL, LINK),
    (STALL, LINKS),
    (DELAY, LINK),
)
# Further faults of a run in which physics is the router.
AT_PHYSICS = ((PORT, NOTHING),)
# Each run has one of these in turn, so that a soak of ten minutes has them all.
IN_TURN = tuple(dict.fromkeys(AT_PHYSICS + ANYWHERE + AT_A_ROUTER))


class Fault(NamedTuple):
    """A fault that is injected into a run."""

    tick: int  # at which it begins
    kind: str  # such as KILL
    target: str  # such as PHYSICS; NOTHING: the kind says it all
    seconds: float  # duration in wall time; 0.0: none
    chance: int  # a random number: selects one of several hosts or links, or seeds the fuzzer

    @property
    def name(self) -> str:
        """Its kind and target, for people: "kill physics"."""
        return f"{self.kind} {self.target}".strip()


class Trial(NamedTuple):
    """One run of the soak and its faults."""

    seed: int  # of the soak
    number: int
    orchard: int  # the scenario's seed
    mode: str  # "lockstep" or "realtime"
    speed: str  # as in run.py --speed
    seconds: int | None  # simulated s; None: until the harvest is finished
    hosts: str  # as in run.py --hosts: a number, or "each" for a host for each agent
    is_recorded: bool
    is_routed: bool  # there is a router process of its own, and every link goes through a relay
    faults: tuple[Fault, ...]

    @property
    def is_mistaken(self) -> bool:
        """Whether an agent makes mistakes, from the first tick to the last."""
        return any(fault.kind == MISTAKES for fault in self.faults)

    def __str__(self) -> str:
        length = "whole harvest"
        if self.seconds is not None:
            length = f"{self.seconds} s"
        network = "no router"
        if self.is_routed:
            network = "router"
        return (
            f"run {self.number}: {self.mode}, {length} at {self.speed}, hosts {self.hosts},"
            f" {network}, {len(self.faults)} faults"
        )


def trial(seed: int, number: int) -> Trial:
    """Return the trial of a seed and a number; it depends on nothing else.

    Every sixth is a whole harvest, every fourth is in realtime.
    """
    # The order of the draws is part of the schedule: another order gives other trials.
    random = Random(f"{seed}/{number}")
    mode = "lockstep"
    if number % 4 == 3:
        mode = "realtime"
    seconds = None
    ticks = WHOLE_HARVEST
    if number % 6 != 5:
        seconds = random.choice(SECONDS)
        ticks = round(seconds / TIME_STEP)
    speed = _speed(random, mode, seconds)
    # A host for each agent is slow, so only a run of at most two minutes has them.
    most_hosts = "2"
    if seconds is not None and seconds <= 120:
        most_hosts = "each"
    hosts = random.choice(("1", "2", "2", "3", "4", most_hosts))
    # Each round begins one fault later, so that a fault is not always in the same mode.
    rounds = number // len(IN_TURN)
    due = IN_TURN[(number + rounds) % len(IN_TURN)]
    _, target = due
    is_recorded = target == LOGGER or random.random() < 0.5
    is_routed = due in AT_A_ROUTER or (due not in AT_PHYSICS and random.random() < 0.6)
    orchard = random.randint(1, SEEDS)
    here = ANYWHERE + AT_PHYSICS
    if is_routed:
        here = ANYWHERE + AT_A_ROUTER
    possible = [(kind, target) for kind, target in here if target != LOGGER or is_recorded]
    faults = _faults(random, ticks, due, possible)
    return Trial(seed, number, orchard, mode, speed, seconds, hosts, is_recorded, is_routed, faults)


def _speed(random: Random, mode: str, seconds: int | None) -> str:
    """Return the simulated seconds in a second of wall time.

    It is fast enough for a short run, and slow enough for faults to begin at their ticks.
    """
    is_long = seconds is None or seconds > 120
    if mode == "realtime" and is_long:
        return "20"
    if mode == "realtime":
        return "10"
    if seconds is None:
        return "max"
    return random.choice(("15", "30", "max"))


def _faults(
    random: Random, ticks: int, due: tuple[str, str], possible: list[tuple[str, str]]
) -> tuple[Fault, ...]:
    """Return at most 7 faults, in the order of their ticks. Some begin at the same tick.

    `due`: the kind and target of one of them. `possible`: those of the others.
    """
    faults: list[Fault] = []
    for number in range(random.randint(3, 7)):
        kind, target = due
        if number > 0:
            kind, target = random.choice(possible)
        # A fifth of the faults begins at the tick of the fault before.
        is_simultaneous = faults and random.random() < 0.2
        if is_simultaneous:
            tick = faults[-1].tick
        else:
            tick = random.randint(round(FIRST * ticks), round(LAST * ticks))
        if target == ROUTER:
            seconds = random.uniform(*ROUTER_AWAY)
        elif kind in LASTS:
            seconds = random.uniform(*LASTS[kind])
        else:
            seconds = 0.0
        faults.append(Fault(tick, kind, target, round(seconds, 2), random.randrange(2**32)))
        if most_deaths(faults) > MOST_DEATHS:
            faults.pop()
    return tuple(sorted(faults))


def most_deaths(faults: Sequence[Fault]) -> int:
    """Return the most restarts that these faults may cause for one process.

    A kill of all processes counts for each.
    """
    deaths = Counter[str]()
    for fault in faults:
        if fault.kind in MORTAL:
            deaths[fault.target] += 1
        deaths[PHYSICS] += DEATHS_OF_PHYSICS.get(fault.kind, 0)
    return deaths[ALL] + max(deaths[target] for target in (PHYSICS, HOST, LOGGER))
