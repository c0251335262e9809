"""The plan of one schedule: its run, and the faults that a seed draws for it."""

from dataclasses import dataclass, replace
from math import inf
from random import Random
from typing import Any, NamedTuple

from chaos.simulated.bare_client import BARE_CLIENT
from chaos.simulated.census import OF_HARVEST
from chaos.simulated.clients import CHANGES_THE_HASH
from chaos.simulated.harvest import FAILED, HARVESTED, REPAIRED, Harvest, harvest_of
from chaos.simulated.link import Delays
from chaos.simulated.scenes import SCENES
from chaos.simulated.tearing import NO_TEARS, Tears
from orchard.net import requests
from orchard.server.options import PATIENCE
from orchard.wire.keys import LOGGER, PHYSICS

BACK_SECONDS = 3.0  # s that a host takes to be back, over a fast network
SLOW_IN_TURN = 3  # slow messages that it may send and receive until then, one after the other
CLIENT = "client"
RUN_PY = "run.py"
ROUTER = "router"
WITH_WALKERS = "crowd"  # the scene in which the bare client walks, in realtime


class Fault(NamedTuple):
    """A fault: what happens to which process, so many seconds after a tick, and for how long (s).

    `tick`: counted from the begin of the schedule, or from its last reset; -1: before the first
    tick.

    `message`: it happens as the process is about to send its message of that number from then on, a
    host its query: between two of them it may have sent its velocities, and not all of its mail. 0:
    at once.
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
    scene: str  # a name in SCENES
    ticks: int  # from its begin on
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
    begin: int = 0  # the tick of the keyframe from which it begins
    has_tables: bool = False
    tears: Tears = NO_TEARS  # how often payloads change on their way

    @property
    def scenario(self) -> dict[str, Any]:
        """The scenario of its scene."""
        return SCENES[self.scene]

    @property
    def end(self) -> int:
        """The tick at which it ends, unless the harvest is over, or is reset."""
        return self.begin + self.ticks

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
        """Whether a host may be away for longer than physics waits.

        What is allowed for several faults has room for slow messages.
        """
        joins_after_one = [fault.what != "think" for fault in self._lasting] == [True]
        slow = (
            SLOW_IN_TURN * self.delays.slow + self.late
            if joins_after_one and self.delays.share
            else 0.0
        )
        return self.away + slow >= self.patience

    @property
    def may_miss_the_end(self) -> bool:
        """Whether a host may not hear that the run is over: more happens than that one link is cut
        for a moment.
        """
        heavy = [fault for fault in self.faults if fault.who not in (CLIENT, LOGGER)]
        return (self.is_elsewhere or self.has_bare_client) and (
            len(heavy) > 1 or any(fault.what != "cut" or fault.seconds > 0.7 for fault in heavy)
        )

    @property
    def may_take(self) -> bool:
        """Whether a client may keep agents that it has got for longer than a host tries: its own
        question lasts while another is mute.
        """
        return any(
            fault.what == "claim" and (fault.seconds > 2.0 or self.has("mute"))
            for fault in self.faults
        )

    def has(self, *what: str) -> bool:
        """Whether it has one of these faults."""
        return any(fault.what in what for fault in self.faults)


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
    PHYSICS: (
        "kill",
        "kill",
        "kill",
        "freeze",
        "full disk",
        "torn snapshot",
        "foreign snapshot",
    ),
    LOGGER: ("kill", "freeze", "cut", "silence"),
    CLIENT: (
        "claim",
        "claim",
        "nonsense",
        "nonsense",
        "repeat",
        "lie",
        "lie",
        "pause",
        "pause",
        "listen",
        "listen",
        "listen",
        "survey",
        "survey",
        "survey",
        "survey",
        "late letters",
        "late letters",
        "mute",
        "false answers",
        "false answers",
        "flap",
        "flap",
        "reset",
        "reset",
        "stop robots",
        "stop robots",
        "quit",
    ),
    RUN_PY: ("kill", "fork"),
    ROUTER: ("kill",),
}
AT_A_MOMENT = ("kill", "fork", "torn snapshot", "foreign snapshot")
TROUBLES: tuple[tuple[tuple[str, str], ...], ...] = (  # that come together
    (("pause", CLIENT), ("kill", HOST)),
    (("reset", CLIENT), ("kill", PHYSICS)),
    (("stop robots", CLIENT), ("kill", PHYSICS)),
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


# what a schedule begins shortly before, most often
OF_A_HARVEST = (*OF_HARVEST, FAILED, REPAIRED, HARVESTED)
# The share of schedules that begin at the first tick, when hosts join.
AT_ITS_FIRST_TICK = 0.06
# The share of the others that begin before one of OF_A_HARVEST; the rest begins before a message.
BEFORE_AN_EVENT = 0.75
# The share of faults that happen near an event of the harvest, of those that are not at the begin
# or the end.
NEAR_AN_EVENT = 0.85
# How near, in ticks.
BEFORE = 12
AFTER = 6
LEAST_LEAD = 5  # ticks between the begin of a schedule and what it begins before
TRAIL = 25  # ticks that it lasts at least after that
OF_DEEDS = ("coupled", "uncoupled", "picks from", "weed flattened")
FAR_TICKS = 320  # from what happens to the nearest deed: further away, the schedule is without one
TRIES = 3  # that are made to find a moment that is not so far away
RARE = (HARVESTED, "charging", "charged", FAILED, REPAIRED)  # mostly far from each deed
BEFORE_WHAT_IS_RARE = 0.06  # the share of schedules that begin before that
# The share of schedules with other faults in which a person at the controls acts, too.
WITH_OPERATOR = 0.5
# What that person does: each as often as it stands here. Without it some messages would be rare.
OF_AN_OPERATOR = (
    "stop robots",
    "stop robots",
    "pause",
    "pause",
    "listen",
    "listen",
    "survey",
    "reset",
)
# The share of schedules in which large payloads take longer.
WITH_BANDWIDTH = 0.3
# The share of schedules in which payloads change on their way.
WITH_TEARS = 0.2
# What keeps a host away for a time, and the share of schedules with one of these in which it is
# away for longer than physics waits. Without it few sessions would be lost.
LASTING = ("freeze", "think", "cut", "silence", "vanish")
WITH_ABSENCE = 0.35
SHORT_PATIENCE = 4.0  # s that physics waits for a host in half of all schedules
ABSENCE = (5.0, 9.0)  # s


def draw(seed: int) -> Plan:
    """Return the plan of a seed."""
    random = Random(f"plan {seed}")
    of_links = Random(f"links {seed}")
    scene = random.choice(list(SCENES))
    harvest = harvest_of(scene)
    begin, ticks = _span(random, harvest)
    mode = "realtime" if random.random() < 0.08 else "lockstep"
    has_router = random.random() < 0.2
    has_walker = mode == "realtime" and scene == WITH_WALKERS
    plan = Plan(
        seed,
        scene,
        ticks,
        hosts=random.randint(1, 3),
        has_logger=random.random() < 0.15,
        has_router=has_router,
        delays=Delays(
            typical=10.0 ** random.uniform(-4.0, -2.0),
            slow=random.choice((0.05, 0.3, 1.0)),
            share=random.choice((0.0, 0.003, 0.02, 0.1)),
            bytes_per_second=_bandwidth(of_links),
        ),
        faults=(),
        mode=mode,
        patience=random.choice((PATIENCE, SHORT_PATIENCE)),
        is_elsewhere=random.random() < 0.25,
        has_bare_client=has_walker or (mode == "lockstep" and random.random() < 0.25),
        late=random.random() if has_router and random.random() < 0.3 else 0.0,
        begin=begin,
        has_tables=random.random() < 0.1,
        tears=_tears(of_links),
    )
    moments = Moments(plan, harvest)
    faults = sorted(_faults(random, plan, moments), key=lambda fault: fault.tick)
    return _with_absence(Random(f"absence {seed}"), replace(plan, faults=tuple(faults)))


def _with_absence(random: Random, plan: Plan) -> Plan:
    """Return a plan in which now and then a host is away for longer than physics waits."""
    lasting = [
        fault
        for fault in plan.faults
        if fault.what in LASTING
        and fault.who not in (PHYSICS, LOGGER)
        and fault.tick < plan.ticks
        and fault.seconds < ABSENCE[0]
    ]
    if plan.mode != "lockstep" or not lasting or random.random() >= WITH_ABSENCE:
        return plan
    chosen = random.choice(lasting)
    longer = chosen._replace(seconds=random.uniform(*ABSENCE))
    faults = tuple(longer if fault is chosen else fault for fault in plan.faults)
    return replace(plan, patience=SHORT_PATIENCE, faults=faults)


def _bandwidth(random: Random) -> float:
    """Return the bytes a second that a link carries: between a slow radio and a fast cable;
    infinity where size does not count.
    """
    return 10.0 ** random.uniform(6.0, 8.0) if random.random() < WITH_BANDWIDTH else inf


def _tears(random: Random) -> Tears:
    """Return how often payloads change on the links of a plan: in most plans never."""
    if random.random() >= WITH_TEARS:
        return NO_TEARS
    return Tears(
        torn=10.0 ** random.uniform(-4.0, -2.0), changed=10.0 ** random.uniform(-4.0, -2.0)
    )


def _span(random: Random, harvest: Harvest) -> tuple[int, int]:
    """Return at the tick of which keyframe a schedule begins, and how many ticks it lasts.

    It begins shortly before something happens, and a robot does a deed in it, unless the next one
    is far away.
    """
    ticks = random.choice((60, 100, 100, 200, 300))
    lead = random.randint(LEAST_LEAD, ticks // 2)
    moment = 0
    if random.random() >= AT_ITS_FIRST_TICK and harvest.moments:
        moment = _moment(random, harvest)
    deed = _nearest_deed(harvest, moment)
    if abs(deed - moment) > FAR_TICKS:
        deed = moment
    begin = harvest.last_keyframe(min(moment, deed) - lead)
    return begin, max(ticks, max(moment, deed) + TRAIL - begin)


def _moment(random: Random, harvest: Harvest) -> int:
    """Return a tick at which something happens, most often not far from a deed.

    Each kind is as frequent as another.
    """
    rare = [what for what in RARE if what in harvest.moments]
    if rare and random.random() < BEFORE_WHAT_IS_RARE:
        return random.choice(harvest.moments[random.choice(rare)])
    events = [what for what in OF_A_HARVEST if what in harvest.moments]
    others = sorted(set(harvest.moments).difference(events))
    moment = 0
    for _ in range(TRIES):
        kinds = events if events and random.random() < BEFORE_AN_EVENT else others or events
        moment = random.choice(harvest.moments[random.choice(kinds)])
        if abs(_nearest_deed(harvest, moment) - moment) <= FAR_TICKS:
            break
    return moment


def _nearest_deed(harvest: Harvest, moment: int) -> int:
    deeds = [tick for what in OF_DEEDS for tick in harvest.moments.get(what, ())]
    return min(deeds, key=lambda tick: abs(tick - moment), default=moment)


class Moments:
    """When faults happen in a plan: most often near an event of the harvest."""

    def __init__(self, plan: Plan, harvest: Harvest) -> None:
        self._ticks = plan.ticks
        self._events = sorted(
            {
                tick - plan.begin
                for what in OF_A_HARVEST
                for tick in harvest.moments.get(what, ())
                if plan.begin <= tick < plan.end
            }
        )

    def draw(self, random: Random) -> tuple[int, float]:
        """Return a tick and a delay, s: at the start, at the end, near an event, or between."""
        kind = random.random()
        if kind < 0.05:
            return -1, random.random() * 1.5
        if kind < 0.13:
            return self._ticks - random.randrange(3), 10.0 ** random.uniform(-4.0, -1.0)
        if self._events and random.random() < NEAR_AN_EVENT:
            tick = random.choice(self._events) + random.randint(-BEFORE, AFTER)
            return min(max(tick, 0), self._ticks), 10.0 ** random.uniform(-4.0, -2.0)
        return random.randrange(self._ticks), 10.0 ** random.uniform(-4.0, -1.0)


def _faults(random: Random, plan: Plan, moments: Moments) -> list[Fault]:
    kind = random.random()
    if plan.mode == "lockstep" and kind < 0.03:
        # What an open run cannot tell from the truth while a link is cut or physics is gone.
        return [Fault("false end", CLIENT, *moments.draw(random), seconds=1.0)]
    if kind < 0.13:
        return [Fault("advise", CLIENT, *moments.draw(random), seconds=0.5)]
    if kind < 0.31:
        return _troubles(random, plan, moments)
    if kind < 0.35:  # a link that breaks as the end is published
        seconds = 10.0 ** random.uniform(-1.5, -0.2)
        delay = 10.0 ** random.uniform(-4.0, -1.0) - 1e-4
        return [Fault("cut", _name(HOST, random, plan), plan.ticks, delay, seconds)]
    own = [
        PHYSICS,
        PHYSICS,
        CLIENT,
        CLIENT,
        CLIENT,
        CLIENT,
        RUN_PY,
        *[LOGGER] * plan.has_logger,
        *[ROUTER] * plan.has_router,
    ]
    faults: list[Fault] = []
    for _ in range(random.choice((0, 1, 2, 2, 3, 3, 4, 6))):
        who = random.choice([*[HOST] * 2 * plan.hosts, *own])
        more = ("cut", "silence") if who == PHYSICS and plan.has_router else ()
        tick, delay = moments.draw(random)
        # Without a router nothing begins.
        tick = max(tick, 0) if who == ROUTER else tick
        faults.append(_fault(random, plan, random.choice(FAULTS[who] + more), who, tick, delay))
    if faults and random.random() < WITH_OPERATOR:
        what = random.choice(OF_AN_OPERATOR)
        faults.append(_fault(random, plan, what, CLIENT, *moments.draw(random)))
    return faults


def _troubles(random: Random, plan: Plan, moments: Moments) -> list[Fault]:
    """Faults that come together, two or three: the second one soon after the first one, or as it
    ends; the third one soon after that.
    """
    if random.random() < 0.1:  # a host is debugged in a run that is paused meanwhile
        seconds = random.uniform(12.0, 25.0)
        moment = moments.draw(random)
        host = Fault(
            "think", _name(HOST, random, plan), *moment, seconds + random.uniform(4.0, 11.0)
        )
        return [host, Fault("pause", CLIENT, *moment, seconds)]
    first, *others = random.choice(TROUBLES + (AT_A_ROUTER,) * 4 * plan.has_router)
    one = _fault(random, plan, *first, *moments.draw(random))
    faults = [one]
    at = one.delay
    if random.random() < 0.5:
        at += max(0.0, one.seconds + random.uniform(-1.0, 0.2))
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
    message = 0
    if is_between_messages:
        message = random.randint(1, 30 if who == PHYSICS else 5)
    return Fault(what, _name(who, random, plan), tick, delay, seconds, message)


def _name(who: str, random: Random, plan: Plan) -> str:
    if who == HOST and plan.has_bare_client and random.random() < 0.4:
        return BARE_CLIENT
    return f"agents {random.randint(1, plan.hosts)}" if who == HOST else who


def leave_limit(plan: Plan) -> float:
    """Return the seconds of virtual time within which all processes end after physics: a host that
    starts just then asks TRIES times.

    A client that does not answer makes a question last.
    """
    mute = sum(fault.seconds for fault in plan.faults if fault.what == "mute")
    seconds_of_a_try = requests.AGAIN_SECONDS + plan.delays.there_and_back
    return 15.0 + mute + requests.TRIES * seconds_of_a_try
