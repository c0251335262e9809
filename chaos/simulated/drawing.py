"""Draws the plan of a schedule from its seed: when it begins, and which faults happen when.

A schedule begins shortly before something happens in the harvest of its scene, and most of its
faults happen near such an event. So few ticks of it are spent on what is not looked for. The order
of the draws is part of each plan: another order gives other plans for all seeds.
"""

from dataclasses import replace
from math import inf
from random import Random

from chaos.simulated.bare_client import BARE_CLIENT
from chaos.simulated.census import OF_HARVEST
from chaos.simulated.harvest import FAILED, HARVESTED, REPAIRED, Harvest, harvest_of
from chaos.simulated.link import Delays
from chaos.simulated.plan import CLIENT, ROUTER, RUN_PY, Fault, Plan
from chaos.simulated.scenes import SCENES
from chaos.simulated.tearing import NO_TEARS, Tears
from orchard.server.options import PATIENCE
from orchard.wire.keys import LOGGER, PHYSICS

WITH_WALKERS = "crowd"  # the scene in which the bare client walks, in realtime
HOST = "host"
# Process -> the faults that it may have. One that stands here twice is twice as frequent.
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
# Faults that do not last.
AT_A_MOMENT = ("kill", "fork", "torn snapshot", "foreign snapshot")
# Faults (what, who) that come together, soon after each other.
TROUBLES: tuple[tuple[tuple[str, str], ...], ...] = (
    (("pause", CLIENT), ("kill", HOST)),
    (("reset", CLIENT), ("kill", PHYSICS)),
    (("stop robots", CLIENT), ("kill", PHYSICS)),
    (("full disk", PHYSICS), ("kill", PHYSICS)),
    (("kill", PHYSICS), ("kill", HOST)),
    (("cut", HOST), ("claim", CLIENT)),
    (("vanish", HOST), ("cut", HOST)),
    (("think", HOST), ("kill", HOST)),
)
# The same where there is a router of its own: a host that starts then finds only the mute client.
AT_A_ROUTER = (
    ("mute", CLIENT),
    ("kill", PHYSICS),
    ("kill", HOST),
)
# Faults of which half last for LONG_SECONDS.
LONG = ("pause", "mute")
LONG_SECONDS = (5.0, 25.0)

# Ticks of a schedule, if nothing makes it longer.
LENGTHS = (60, 100, 100, 200, 300)
# What a schedule begins shortly before, most often.
OF_A_HARVEST = (*OF_HARVEST, FAILED, REPAIRED, HARVESTED)
# The share of schedules that begin at the first tick, when hosts join.
AT_ITS_FIRST_TICK = 0.06
# The share of the others that begin before one of OF_A_HARVEST; the rest begins before a message.
BEFORE_AN_EVENT = 0.75
# The share of faults that happen near an event of the harvest, of those that are not at the
# beginning or the end.
NEAR_AN_EVENT = 0.85
# The most ticks before and after the event.
BEFORE = 12
AFTER = 6
LEAST_LEAD = 5  # ticks between the begin of a schedule and what it begins before
TRAIL = 25  # ticks that it lasts at least after that
# The events that are deeds of robots.
OF_DEEDS = ("coupled", "uncoupled", "picks from", "weed flattened")
# A schedule holds the deed that is nearest to its moment, if it is at most so many ticks away.
FAR_TICKS = 320
# Tries to find a moment with a deed so near.
TRIES = 3
# Events that are mostly far from each deed, and the share of schedules that begin before one.
RARE = (HARVESTED, "charging", "charged", FAILED, REPAIRED)
BEFORE_WHAT_IS_RARE = 0.06
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
# s that physics waits for a host in half of all schedules, and in those.
SHORT_PATIENCE = 4.0
# Least and most s of an absence: longer than the short patience.
ABSENCE = (5.0, 9.0)


def draw(seed: int) -> Plan:
    """Return the plan of a seed."""
    random = Random(f"plan {seed}")
    # A stream of its own, so that what is drawn for links does not change the other draws.
    of_links = Random(f"links {seed}")
    scene = random.choice(list(SCENES))
    harvest = harvest_of(scene)
    begin, ticks = _span(random, harvest)
    mode = "lockstep"
    if random.random() < 0.08:
        mode = "realtime"
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
    lasting = [fault for fault in plan.faults if _may_last_longer(fault, plan)]
    if plan.mode != "lockstep" or not lasting or random.random() >= WITH_ABSENCE:
        return plan
    at = plan.faults.index(random.choice(lasting))
    longer = plan.faults[at]._replace(seconds=random.uniform(*ABSENCE))
    faults = (*plan.faults[:at], longer, *plan.faults[at + 1 :])
    return replace(plan, patience=SHORT_PATIENCE, faults=faults)


def _may_last_longer(fault: Fault, plan: Plan) -> bool:
    """Whether a fault keeps a host away for a time that may become an absence."""
    is_of_a_host = fault.what in LASTING and fault.who not in (PHYSICS, LOGGER)
    least, _ = ABSENCE
    return is_of_a_host and fault.tick < plan.ticks and fault.seconds < least


def _bandwidth(random: Random) -> float:
    """Return the bytes a second that a link carries; infinity: size does not count.

    They are between 1 MB, a slow radio, and 100 MB, a fast cable.
    """
    if random.random() >= WITH_BANDWIDTH:
        return inf
    bandwidth: float = 10.0 ** random.uniform(6.0, 8.0)
    return bandwidth


def _tears(random: Random) -> Tears:
    """Return how often payloads change on the links of a plan: in most plans never."""
    if random.random() >= WITH_TEARS:
        return NO_TEARS
    # One payload in 10,000 to one in 100.
    torn = 10.0 ** random.uniform(-4.0, -2.0)
    changed = 10.0 ** random.uniform(-4.0, -2.0)
    return Tears(torn, changed)


def _span(random: Random, harvest: Harvest) -> tuple[int, int]:
    """Return the tick of the keyframe at which a schedule begins, and how many ticks it lasts.

    It begins shortly before something happens, its moment. A robot does a deed in it, unless the
    nearest deed is far from the moment.
    """
    ticks = random.choice(LENGTHS)
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

    All kinds of events are equally frequent, and so are all kinds of messages.
    """
    rare = [what for what in RARE if what in harvest.moments]
    if rare and random.random() < BEFORE_WHAT_IS_RARE:
        return random.choice(harvest.moments[random.choice(rare)])
    events = [what for what in OF_A_HARVEST if what in harvest.moments]
    others = sorted(set(harvest.moments).difference(events))
    moment = 0
    for _ in range(TRIES):
        kinds = others or events
        if events and random.random() < BEFORE_AN_EVENT:
            kinds = events
        moment = random.choice(harvest.moments[random.choice(kinds)])
        if abs(_nearest_deed(harvest, moment) - moment) <= FAR_TICKS:
            break
    return moment


def _nearest_deed(harvest: Harvest, moment: int) -> int:
    """Return the tick of the deed that is nearest to a moment; the moment itself without deeds."""
    deeds: list[int] = []
    for what in OF_DEEDS:
        deeds += harvest.moments.get(what, ())
    return min(deeds, key=lambda tick: abs(tick - moment), default=moment)


class Moments:
    """When faults happen in a plan: most often near an event of the harvest."""

    def __init__(self, plan: Plan, harvest: Harvest) -> None:
        self._ticks = plan.ticks
        events: set[int] = set()
        for what in OF_A_HARVEST:
            for tick in harvest.moments.get(what, ()):
                if plan.begin <= tick < plan.end:
                    events.add(tick - plan.begin)
        # Ticks after the beginning of the plan.
        self._events = sorted(events)

    def draw(self, random: Random) -> tuple[int, float]:
        """Return a tick and a delay after it, s, for a fault.

        5 % are before the first tick, 8 % at the end, and the others near an event or at any tick.
        """
        kind = random.random()
        if kind < 0.05:
            # Hosts take up to 1 s to load.
            return -1, random.random() * 1.5
        if kind < 0.13:
            return self._ticks - random.randrange(3), 10.0 ** random.uniform(-4.0, -1.0)
        if self._events and random.random() < NEAR_AN_EVENT:
            tick = random.choice(self._events) + random.randint(-BEFORE, AFTER)
            return min(max(tick, 0), self._ticks), 10.0 ** random.uniform(-4.0, -2.0)
        return random.randrange(self._ticks), 10.0 ** random.uniform(-4.0, -1.0)


def _faults(random: Random, plan: Plan, moments: Moments) -> list[Fault]:
    """Return the faults of a plan: one of five kinds of sets, of which each has its share."""
    kind = random.random()
    if plan.mode == "lockstep" and kind < 0.03:
        # This comes alone. While a link is cut or physics is gone, an open run could not tell it
        # from a true end.
        return [Fault("false end", CLIENT, *moments.draw(random), seconds=1.0)]
    if kind < 0.13:
        return [Fault("advise", CLIENT, *moments.draw(random), seconds=0.5)]
    if kind < 0.31:
        return _troubles(random, plan, moments)
    if kind < 0.35:
        # A link that breaks when the end is published.
        seconds = 10.0 ** random.uniform(-1.5, -0.2)
        delay = 10.0 ** random.uniform(-4.0, -1.0) - 1e-4
        return [Fault("cut", _name(HOST, random, plan), plan.ticks, delay, seconds)]
    faults = _independent(random, plan, moments)
    if faults and random.random() < WITH_OPERATOR:
        what = random.choice(OF_AN_OPERATOR)
        faults.append(_fault(random, plan, what, CLIENT, *moments.draw(random)))
    return faults


def _independent(random: Random, plan: Plan, moments: Moments) -> list[Fault]:
    """Return up to six faults of any processes, each at a moment of its own."""
    # The processes that faults hit, each as often as it stands here.
    processes = [HOST] * 2 * plan.hosts + [PHYSICS] * 2 + [CLIENT] * 4 + [RUN_PY]
    if plan.has_logger:
        processes.append(LOGGER)
    if plan.has_router:
        processes.append(ROUTER)
    faults: list[Fault] = []
    for _ in range(random.choice((0, 1, 2, 2, 3, 3, 4, 6))):
        who = random.choice(processes)
        possible = FAULTS[who]
        if who == PHYSICS and plan.has_router:
            # Only then is physics at a link that can be cut.
            possible += ("cut", "silence")
        tick, delay = moments.draw(random)
        if who == ROUTER:
            # The run has no first tick without a router.
            tick = max(tick, 0)
        faults.append(_fault(random, plan, random.choice(possible), who, tick, delay))
    return faults


def _troubles(random: Random, plan: Plan, moments: Moments) -> list[Fault]:
    """Return two or three faults that come together.

    The second one comes soon after the first one begins, or about when it ends; the third one comes
    soon after the second.
    """
    if random.random() < 0.1:
        return _debugged(random, plan, moments)
    possible = list(TROUBLES)
    if plan.has_router:
        possible += [AT_A_ROUTER] * 4
    first, *others = random.choice(possible)
    one = _fault(random, plan, *first, *moments.draw(random))
    faults = [one]
    at = one.delay
    if random.random() < 0.5:
        # From 1 s before the first one ends to 0.2 s after that.
        at += max(0.0, one.seconds + random.uniform(-1.0, 0.2))
    for other in others:
        # From 0.1 ms to 2 s later.
        at += 10.0 ** random.uniform(-4.0, 0.3)
        faults.append(_fault(random, plan, *other, one.tick, at))
    return faults


def _debugged(random: Random, plan: Plan, moments: Moments) -> list[Fault]:
    """Return the faults of a host in a debugger: it stands, and its run is paused meanwhile.

    It goes on 4 to 11 s after the run does.
    """
    paused = random.uniform(12.0, 25.0)
    tick, delay = moments.draw(random)
    host = _name(HOST, random, plan)
    stands = paused + random.uniform(4.0, 11.0)
    think = Fault("think", host, tick, delay, stands)
    return [think, Fault("pause", CLIENT, tick, delay, paused)]


def _fault(random: Random, plan: Plan, what: str, who: str, tick: int, delay: float) -> Fault:
    """Return a fault of this kind, with the rest of it drawn."""
    seconds = 0.0
    if what not in AT_A_MOMENT:
        # From 0.03 to 8 s.
        seconds = 10.0 ** random.uniform(-1.5, 0.9)
    if who == ROUTER:
        seconds = random.uniform(1.0, 6.0)
    if what in LONG and random.random() < 0.5:
        seconds = random.uniform(*LONG_SECONDS)
    is_between_messages = who in (HOST, PHYSICS) and random.random() < 0.3
    message = 0
    if is_between_messages and who == PHYSICS:
        message = random.randint(1, 30)
    elif is_between_messages:
        message = random.randint(1, 5)
    return Fault(what, _name(who, random, plan), tick, delay, seconds, message)


def _name(who: str, random: Random, plan: Plan) -> str:
    """Return the name of a process: a host is any of the hosts, or the bare client."""
    if who != HOST:
        return who
    if plan.has_bare_client and random.random() < 0.4:
        return BARE_CLIENT
    return f"agents {random.randint(1, plan.hosts)}"
