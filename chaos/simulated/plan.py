"""The plan of one schedule: its run, and the faults that a seed draws for it."""

from dataclasses import dataclass
from random import Random
from typing import Any, NamedTuple

from chaos.simulated.clients import CHANGES_THE_HASH
from chaos.simulated.link import Delays
from orchard.wire.keys import LOGGER, PHYSICS

MOST_TICKS = 300
CLIENT, RUN_PY, ROUTER = "client", "run.py", "router"


class Fault(NamedTuple):
    """A fault: what happens to which process, so many seconds after a tick, and for how long (s). Before the first tick: tick -1."""

    what: str
    who: str
    tick: int
    delay: float = 0.0
    seconds: float = 0.0

    def __str__(self) -> str:
        return f"tick {self.tick} + {self.delay:.4f} s: {self.what} {self.who}" + (f" for {self.seconds:.2f} s" if self.seconds else "")


@dataclass(frozen=True)
class Plan:
    """What one schedule does. The same plan gives the same schedule."""

    seed: int
    scenario: dict[str, Any]
    ticks: int
    hosts: int
    has_logger: bool
    has_router: bool  # a router of its own, to which physics connects too
    delays: Delays
    faults: tuple[Fault, ...]
    mode: str = "lockstep"

    @property
    def has_hash(self) -> bool:
        """Whether the run has the hash of local mode."""
        return self.mode == "lockstep" and not any(fault.what in CHANGES_THE_HASH for fault in self.faults)


ALONE = {"people": {"workers": 0, "visitors": 0}, "animals": {"dogs": 0, "cats": 0}, "weeds": 0}
SCENARIOS: tuple[dict[str, Any], ...] = (
    {"rows": 3, "seed": 1},
    {"rows": 3, "seed": 2, "dispatch": "nearest", **ALONE},
    {"rows": 3, "seed": 3, "route": "two-way", **ALONE},
    {"rows": 4, "seed": 4, "dispatch": "assignment", "tractor": False, **ALONE},
)
FAULTS = {
    "host": ("kill", "kill", "kill", "freeze", "cut", "cut", "silence", "silence up", "silence down", "vanish"),
    PHYSICS: ("kill", "kill", "kill", "freeze", "full disk", "torn snapshot"),
    LOGGER: ("kill", "freeze", "cut", "silence"),
    CLIENT: ("claim", "claim", "nonsense", "repeat", "lie", "lie", "pause", "pause", "listen", "reset", "reset", "quit"),
    RUN_PY: ("kill",),
    ROUTER: ("kill",),
}
AT_A_MOMENT = ("kill", "torn snapshot")


def draw(seed: int) -> Plan:
    """Return the plan of a seed."""
    random = Random(f"plan {seed}")
    scenario, hosts, ticks = random.choice(SCENARIOS), random.randint(1, 3), random.choice((30, 100, 100, 200, 300))
    mode = "realtime" if random.random() < 0.1 else "lockstep"
    has_logger, has_router = random.random() < 0.15, random.random() < 0.2
    delays = Delays(10.0 ** random.uniform(-4.0, -2.0), random.choice((0.05, 0.3, 1.0)), random.choice((0.0, 0.003, 0.02)))
    names = [f"agents_{number}" for number in range(hosts)]
    targets = [*names, *names, *names, PHYSICS, PHYSICS, CLIENT, CLIENT, RUN_PY, *[LOGGER] * has_logger, *[ROUTER] * has_router]
    faults = []
    for _ in range(random.choice((0, 1, 1, 2, 2, 3, 4, 6))):
        who = random.choice(targets)
        choices = FAULTS.get(who, FAULTS["host"])
        if who == PHYSICS and has_router:
            choices += ("cut", "silence")
        what = random.choice(choices)
        seconds = 0.0 if what in AT_A_MOMENT else 10.0 ** random.uniform(-1.5, 0.9)
        tick, delay = _moment(random, ticks)
        faults.append(Fault(what, who, max(tick, 0) if who == ROUTER else tick, delay, seconds))  # without a router nothing begins
    if mode == "lockstep" and random.random() < 0.05:  # what an open run cannot tell from the truth while a link is cut or physics is gone
        faults = [Fault(random.choice(("false end", "advise", "stop robots")), CLIENT, *_moment(random, ticks), 1.0)]
    return Plan(seed, scenario, ticks, hosts, has_logger, has_router, delays, tuple(sorted(faults, key=lambda fault: fault.tick)), mode)


def _moment(random: Random, ticks: int) -> tuple[int, float]:
    """A tick and a delay, s: at the start, at the end or between."""
    if (kind := random.random()) < 0.1:
        return -1, random.random() * 1.5
    return ticks - random.randrange(3) if kind < 0.3 else random.randrange(ticks), 10.0 ** random.uniform(-4.0, -1.0)
