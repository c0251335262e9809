"""What happens to which harvest, and when: all of it follows from a seed and a number. Times are ticks, as heard from `clock`."""

from collections.abc import Sequence
from random import Random
from typing import NamedTuple

from orchard.field.scenario import TIME_STEP

PHYSICS, HOST, LOGGER, ROUTER, ALL = "physics", "agents", "logger", "router", "everybody"
LINK, LINKS = "a link", "all links"
KILL, FREEZE, CUT, STALL, DELAY, BYTES = "kill", "freeze", "cut", "stall", "delay", "bad bytes"
LASTS = {FREEZE: (0.2, 5.0), STALL: (0.2, 5.0), DELAY: (1.0, 4.0)}  # s of wall time
ROUTER_AWAY = (0.2, 3.0)  # s, from a router's death until it is started again
MOST_DEATHS = 4  # of one process in a run: run.py gives up on what dies five times in a row; it may end what is frozen, too
FIRST, LAST = 0.05, 0.85  # of a run: before and after there are no faults, so that every recovery is seen
WHOLE_HARVEST = 5000  # ticks; one of 3 rows takes 5,500 at least
SECONDS = (60, 120, 180, 300)  # simulated, of a run that is no whole harvest
SEEDS = 4  # of scenarios, so that few runs of local mode tell all the hashes

KILLS = ((KILL, PHYSICS), (KILL, HOST), (KILL, HOST), (KILL, LOGGER), (KILL, ALL))
ANYWHERE = (*KILLS, (FREEZE, PHYSICS), (FREEZE, HOST), (FREEZE, LOGGER), (BYTES, ALL))
AT_A_ROUTER = ((KILL, ROUTER), (CUT, LINK), (CUT, LINKS), (STALL, LINK), (STALL, LINKS), (DELAY, LINK))


class Fault(NamedTuple):
    """Something that is done to a run."""

    tick: int  # at which it begins
    kind: str
    target: str
    seconds: float  # of wall time that it lasts; 0.0: over at once
    chance: int  # which of several hosts or links, and which bytes

    @property
    def name(self) -> str:
        return f"{self.kind} {self.target}" if self.kind != BYTES else self.kind


class Trial(NamedTuple):
    """One harvest and all that happens to it."""

    seed: int  # of the soak
    number: int
    orchard: int  # the scenario's seed
    mode: str
    speed: str
    seconds: int | None  # simulated; None: until all is harvested
    hosts: str
    is_recorded: bool
    is_routed: bool  # all meet at a router of its own, and every link goes through a relay
    faults: tuple[Fault, ...]

    def __str__(self) -> str:
        how_long = "whole harvest" if self.seconds is None else f"{self.seconds} s"
        where = "router" if self.is_routed else "no router"
        return f"run {self.number}: {self.mode}, {how_long} at {self.speed}, hosts {self.hosts}, {where}, {len(self.faults)} faults"


def trial(seed: int, number: int) -> Trial:
    """The same for the same seed and number. Every sixth run is a whole harvest, every fourth is in realtime."""
    chance = Random(f"{seed}/{number}")
    mode = "realtime" if number % 4 == 3 else "lockstep"
    seconds = None if number % 6 == 5 else chance.choice(SECONDS)
    speed = _speed(chance, mode, seconds)
    hosts = chance.choice(("1", "2", "2", "3", "4", "each" if seconds in SECONDS[:2] else "2"))
    is_recorded, is_routed = chance.random() < 0.5, chance.random() < 0.6
    ticks = WHOLE_HARVEST if seconds is None else round(seconds / TIME_STEP)
    orchard = chance.randint(1, SEEDS)
    return Trial(seed, number, orchard, mode, speed, seconds, hosts, is_recorded, is_routed, _faults(chance, ticks, is_recorded, is_routed))


def _speed(chance: Random, mode: str, seconds: int | None) -> str:
    """Simulated seconds to a second, so that no run takes long, and a fault meets it where it shall."""
    if mode == "realtime":
        return "20" if seconds is None or seconds > 120 else "10"
    return "max" if seconds is None else chance.choice(("15", "30", "max"))


def _faults(chance: Random, ticks: int, is_recorded: bool, is_routed: bool) -> tuple[Fault, ...]:
    """Some faults, in the order of their ticks; now and then two at once."""
    possible = [(kind, target) for kind, target in ANYWHERE + AT_A_ROUTER * is_routed if target != LOGGER or is_recorded]
    faults: list[Fault] = []
    for _ in range(chance.randint(3, 7)):
        kind, target = chance.choice(possible)
        together = faults and chance.random() < 0.2
        tick = faults[-1].tick if together else chance.randint(round(FIRST * ticks), round(LAST * ticks))
        seconds = chance.uniform(*ROUTER_AWAY) if target == ROUTER else chance.uniform(*LASTS[kind]) if kind in LASTS else 0.0
        faults.append(Fault(tick, kind, target, round(seconds, 2), chance.randrange(2**32)))
        if most_deaths(faults) > MOST_DEATHS:
            faults.pop()
    return tuple(sorted(faults))


def most_deaths(faults: Sequence[Fault]) -> int:
    """How often one process may have to be started again."""
    ends = [fault.target for fault in faults if fault.kind in (KILL, FREEZE)]
    return ends.count(ALL) + max(ends.count(target) for target in (PHYSICS, HOST, LOGGER))
