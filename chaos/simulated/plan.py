"""The plan of one schedule: its run, and the faults that a seed draws for it."""

from dataclasses import dataclass, replace
from random import Random
from typing import Any, NamedTuple

from chaos.simulated.bare_client import BARE_CLIENT
from chaos.simulated.clients import CHANGES_THE_HASH
from chaos.simulated.link import Delays
from orchard.server.options import PATIENCE
from orchard.wire.keys import LOGGER, PHYSICS

MOST_TICKS = 300
BACK_SECONDS = 3.0  # s that a host takes to be back, over a fast network
SLOW_IN_TURN = 3  # slow messages that it may send and receive until then, one after the other
CLIENT, RUN_PY, ROUTER = "client", "run.py", "router"


class Fault(NamedTuple):
    """A fault: what happens to which process, so many seconds after a tick, and for how long (s). Before the first tick: tick -1.

    `message`: it happens as the process is about to send its message of that number from then on, a host its query: between two of them it
    may have sent its velocities, and not all of its mail. 0: at once.
    """

    what: str
    who: str
    tick: int
    delay: float = 0.0
    seconds: float = 0.0
    message: int = 0

    def __str__(self) -> str:
        when = f"tick {self.tick} + {self.delay:.4f} s" + (
            f", at message {self.message}" if self.message else ""
        )
        return f"{when}: {self.what} {self.who}" + (
            f" for {self.seconds:.2f} s" if self.seconds else ""
        )


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
    patience: float = PATIENCE  # s that physics waits for a host
    is_elsewhere: bool = False  # the hosts are on another machine: run.py does not end them
    has_bare_client: bool = False  # a client of its own has one agent, which stands
    late: float = 0.0  # s by which tokens come later than messages, as over several routers

    @property
    def has_hash(self) -> bool:
        """Whether the run has the hash of local mode, if no agent was lost."""
        return self.mode == "lockstep" and not any(
            fault.what in CHANGES_THE_HASH for fault in self.faults
        )

    @property
    def _lasting(self) -> list[Fault]:
        """Return the faults after which a host may be away."""
        return [
            fault
            for fault in self.faults
            if fault.who not in (CLIENT, LOGGER) or fault.what == "claim"
        ]

    @property
    def away(self) -> float:
        """For how long a host may be away at most, s of a run that plays."""
        is_debugged = [fault.what for fault in self.faults] == ["think", "pause"] and self.faults[
            0
        ][2:4] == self.faults[1][2:4]
        paused = self.faults[1].seconds if is_debugged and self.faults[1].tick > 0 else 0.0
        return sum(fault.seconds + BACK_SECONDS for fault in self._lasting) - paused

    @property
    def may_lose(self) -> bool:
        """Whether a host may be away for longer than physics waits. What is allowed for several faults has room for slow messages."""
        joins_after_one = [fault.what != "think" for fault in self._lasting] == [True]
        slow = (
            SLOW_IN_TURN * self.delays.slow + self.late
            if joins_after_one and self.delays.share
            else 0.0
        )
        return self.away + slow >= self.patience

    @property
    def may_miss_the_end(self) -> bool:
        """Whether a host may not hear that the run is over: more happens than that one link is cut for a moment."""
        heavy = [fault for fault in self.faults if fault.who not in (CLIENT, LOGGER)]
        return (self.is_elsewhere or self.has_bare_client) and (
            len(heavy) > 1 or any(fault.what != "cut" or fault.seconds > 0.7 for fault in heavy)
        )

    @property
    def may_take(self) -> bool:
        """Whether a client may keep agents that it has got for longer than a host tries: its own question lasts while another is mute."""
        return any(
            fault.what == "claim" and (fault.seconds > 2.0 or self.has("mute"))
            for fault in self.faults
        )

    def has(self, *what: str) -> bool:
        """Whether it has one of these faults."""
        return any(fault.what in what for fault in self.faults)


ALONE = {"people": {"workers": 0, "visitors": 0}, "animals": {"dogs": 0, "cats": 0}, "weeds": 0}
ONE_WAY = {"route": "one-way", "rows_to_pickers": "balanced"}
SCENARIOS: tuple[dict[str, Any], ...] = (
    {
        "rows": 3,
        "seed": 1,
        "people": {"workers": 1, "visitors": 0},
        "animals": {"dogs": 1, "cats": 0},
        "weeds": 2,
        **ONE_WAY,
    },
    {"rows": 3, "seed": 2, "dispatch": "nearest", **ONE_WAY, **ALONE},
    {"rows": 3, "seed": 3, **ONE_WAY, "route": "two-way", **ALONE},
    {"rows": 4, "seed": 4, "dispatch": "assignment", "tractor": False, **ONE_WAY, **ALONE},
)
IN_REALTIME: dict[str, Any] = {
    "rows": 3,
    "seed": 2,
    **ONE_WAY,
    **ALONE,
    "people": {"workers": 1, "visitors": 0},
}  # the agent of the bare client
HOST = "host"
FAULTS = {
    HOST: (
        "kill",
        "kill",
        "kill",
        "freeze",
        "think",
        "cut",
        "cut",
        "silence",
        "silence up",
        "silence down",
        "vanish",
    ),
    PHYSICS: ("kill", "kill", "kill", "freeze", "full disk", "torn snapshot"),
    LOGGER: ("kill", "freeze", "cut", "silence"),
    CLIENT: (
        "claim",
        "claim",
        "nonsense",
        "repeat",
        "lie",
        "lie",
        "pause",
        "pause",
        "listen",
        "mute",
        "reset",
        "reset",
        "quit",
    ),
    RUN_PY: ("kill",),
    ROUTER: ("kill",),
}
AT_A_MOMENT = ("kill", "torn snapshot")
TROUBLES: tuple[tuple[tuple[str, str], ...], ...] = (  # that come together
    (("pause", CLIENT), ("kill", HOST)),
    (("reset", CLIENT), ("kill", PHYSICS)),
    (("full disk", PHYSICS), ("kill", PHYSICS)),
    (("kill", PHYSICS), ("kill", HOST)),
    (("cut", HOST), ("claim", CLIENT)),
    (("vanish", HOST), ("cut", HOST)),
    (("think", HOST), ("kill", HOST)),
)
AT_A_ROUTER = (
    ("mute", CLIENT),
    ("kill", PHYSICS),
    ("kill", HOST),
)  # a host that starts finds the client only
LONG = ("pause", "mute")  # what lasts for long now and then


def draw(seed: int) -> Plan:
    """Return the plan of a seed."""
    random = Random(f"plan {seed}")
    hosts = random.randint(1, 3)
    has_logger, has_router = random.random() < 0.15, random.random() < 0.2
    plan = Plan(
        seed,
        random.choice(SCENARIOS),
        random.choice((30, 100, 100, 200, 300)),
        hosts,
        has_logger,
        has_router,
        Delays(
            10.0 ** random.uniform(-4.0, -2.0),
            random.choice((0.05, 0.3, 1.0)),
            random.choice((0.0, 0.003, 0.02, 0.1)),
        ),
        (),
        "realtime" if random.random() < 0.1 else "lockstep",
        random.choice((PATIENCE, PATIENCE, 4.0)),
        random.random() < 0.25,
        random.random() < 0.5,
        random.random() if has_router and random.random() < 0.3 else 0.0,
    )
    if plan.mode == "realtime":
        plan = replace(plan, scenario=IN_REALTIME, has_bare_client=True)
    elif plan.scenario is not SCENARIOS[0]:  # its agent is not in the others
        plan = replace(plan, has_bare_client=False)
    return replace(plan, faults=tuple(sorted(_faults(random, plan), key=lambda fault: fault.tick)))


def _faults(random: Random, plan: Plan) -> list[Fault]:
    kind = random.random()
    if (
        plan.mode == "lockstep" and kind < 0.05
    ):  # what an open run cannot tell from the truth while a link is cut or physics is gone
        return [
            Fault(
                random.choice(("false end", "advise", "stop robots")),
                CLIENT,
                *_moment(random, plan.ticks),
                1.0,
            )
        ]
    if kind < 0.25:
        return _troubles(random, plan)
    if kind < 0.35:  # a link that breaks as the end is published
        seconds = 10.0 ** random.uniform(-1.5, -0.2)
        return [
            Fault(
                "cut",
                _name(HOST, random, plan),
                plan.ticks,
                10.0 ** random.uniform(-4.0, -1.0) - 1e-4,
                seconds,
            )
        ]
    faults: list[Fault] = []
    own = [
        PHYSICS,
        PHYSICS,
        CLIENT,
        CLIENT,
        RUN_PY,
        *[LOGGER] * plan.has_logger,
        *[ROUTER] * plan.has_router,
    ]
    for _ in range(random.choice((0, 1, 1, 2, 2, 3, 4, 6))):
        who = random.choice([*[HOST] * 3 * plan.hosts, *own])
        more = ("cut", "silence") if who == PHYSICS and plan.has_router else ()
        tick, delay = _moment(random, plan.ticks)  # without a router nothing begins
        faults.append(
            _fault(
                random,
                plan,
                random.choice(FAULTS[who] + more),
                who,
                max(tick, 0) if who == ROUTER else tick,
                delay,
            )
        )
    return faults


def _troubles(random: Random, plan: Plan) -> list[Fault]:
    """Faults that come together, two or three: the second one soon after the first one, or as it ends; the third one soon after that."""
    if random.random() < 0.1:  # a host is debugged in a run that is paused meanwhile
        seconds, moment = random.uniform(12.0, 25.0), _moment(random, plan.ticks)
        host = Fault(
            "think", _name(HOST, random, plan), *moment, seconds + random.uniform(4.0, 11.0)
        )
        return [host, Fault("pause", CLIENT, *moment, seconds)]
    first, *others = random.choice(TROUBLES + (AT_A_ROUTER,) * 4 * plan.has_router)
    one = _fault(random, plan, *first, *_moment(random, plan.ticks))
    faults, at = (
        [one],
        one.delay
        + (max(0.0, one.seconds + random.uniform(-1.0, 0.2)) if random.random() < 0.5 else 0.0),
    )
    for other in others:
        at += 10.0 ** random.uniform(-4.0, 0.3)
        faults.append(_fault(random, plan, *other, one.tick, at))
    return faults


def _fault(random: Random, plan: Plan, what: str, who: str, tick: int, delay: float) -> Fault:
    seconds = 0.0 if what in AT_A_MOMENT else 10.0 ** random.uniform(-1.5, 0.9)
    if who == ROUTER:
        seconds = random.uniform(1.0, 6.0)
    if what in LONG and random.random() < 0.5:
        seconds = random.uniform(5.0, 25.0)
    is_between_messages = who in (HOST, PHYSICS) and random.random() < 0.3
    message = random.randint(1, 30 if who == PHYSICS else 5) if is_between_messages else 0
    return Fault(what, _name(who, random, plan), tick, delay, seconds, message)


def _name(who: str, random: Random, plan: Plan) -> str:
    if who == HOST and plan.has_bare_client and random.random() < 0.4:
        return BARE_CLIENT
    return f"agents {random.randint(1, plan.hosts)}" if who == HOST else who


def _moment(random: Random, ticks: int) -> tuple[int, float]:
    """A tick and a delay, s: at the start, at the end or between."""
    if (kind := random.random()) < 0.1:
        return -1, random.random() * 1.5
    return ticks - random.randrange(3) if kind < 0.3 else random.randrange(
        ticks
    ), 10.0 ** random.uniform(-4.0, -1.0)
