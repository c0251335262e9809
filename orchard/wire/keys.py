"""The table of keys: every key that the program uses, what travels on it, who sends it, how often and how surely.

`python -m orchard.keys` writes keyspace.md from it (see docs/keyspace.py); a test holds the two together.
"""

import re
from functools import lru_cache
from typing import NamedTuple, get_args

from orchard.contract.events import What
from orchard.wire.messages import (
    Answered,
    BinStatus,
    Clock,
    Command,
    Done,
    End,
    Events,
    Figures,
    Join,
    Joined,
    LaserScan,
    Letter,
    Letters,
    Lost,
    Odometry,
    Picture,
    Recall,
    Recalled,
    Received,
    RefusedThere,
    RunInfo,
    Seen,
    Stop,
    Stopped,
    Velocities,
    Velocity,
)

NEVER_LOST = "never lost"  # reliable, in order; a sender waits for a slow subscriber
QUERY = "query"  # a Zenoh get, answered by a queryable
NEWEST = "never lost; newest wins in realtime"  # there a slow subscriber misses some, and holds nobody up
LIVELINESS = "liveliness"  # a Zenoh liveliness token

PREFIX = "orchard"
PHYSICS = "physics"  # the name in the liveliness token of the process that owns the world
LOGGER = "logger"  # the name in that of a process that records
_PREFIX = re.compile(r"[A-Za-z0-9_-]+(/[A-Za-z0-9_-]+)*")


class Key(NamedTuple):
    """One kind of key."""

    template: str
    message: type | None  # what is put, or asked
    sender: str
    rate: str
    delivery: str
    meaning: str
    replies: tuple[type, ...] = ()  # of a query


_EVERY_TICK = "once per tick, 10 a simulated second"
IF_HEARD = ", while somebody listens"

TABLE: dict[str, Key] = {
    "velocity": Key(
        "{prefix}/{robot}/velocity",
        Velocity,
        "whoever drives the robot, or its agent",
        _EVERY_TICK,
        NEVER_LOST,
        "How the robot shall move in the step from this tick to the next. "
        "What comes in `velocities` physics puts here as well, while somebody listens.",
    ),
    "velocities": Key(
        "{prefix}/hosts/{session}/velocities",
        Velocities,
        "a session that holds agents",
        _EVERY_TICK,
        NEVER_LOST,
        "The same for all agents of a session at once: the answer to `seen`.",
    ),
    "pose": Key(
        "{prefix}/{robot}/pose",
        Odometry,
        "physics",
        _EVERY_TICK + IF_HEARD,
        NEWEST,
        "Where the robot is at this tick, how it moved in the last step, and what is coupled to it.",
    ),
    "scan": Key(
        "{prefix}/{robot}/scan",
        LaserScan,
        "physics",
        _EVERY_TICK + IF_HEARD,
        NEWEST,
        "What the robot's laser measures at this tick, and what its bin's does.",
    ),
    "clock": Key(
        "{prefix}/clock",
        Clock,
        "physics",
        _EVERY_TICK + IF_HEARD,
        NEWEST,
        "Simulated time. It is sent last: poses and scans of its tick are out.",
    ),
    "seen": Key(
        "{prefix}/hosts/{session}/seen",
        Seen,
        "physics",
        _EVERY_TICK + IF_HEARD,
        NEWEST,
        "For a session that holds agents: all their poses and scans of this tick, so that it need not subscribe to each. "
        "It comes again while an answer is missing, and is then to be answered again.",
    ),
    "mail": Key(
        "{prefix}/{robot}/mail",
        Letter,
        "any agent",
        "when it asks",
        QUERY,
        "A request to the robot's agent. The robot's host answers.",
        (Received, Answered),
    ),
    "letters": Key(
        "{prefix}/letters",
        Letters,
        "physics",
        "in ticks in which somebody asks or answers" + IF_HEARD,
        NEVER_LOST,
        "A copy of all requests and answers of a tick, for those who look on.",
    ),
    "recall": Key(
        "{prefix}/recall",
        Recall,
        "an agent's host, in lockstep",
        "when it may have missed mail",
        QUERY,
        "Which mail was for this tick? Physics answers with a copy of what was asked and answered at the two ticks before it.",
        (Recalled,),
    ),
    "state": Key(
        "{prefix}/{bin}/state",
        BinStatus,
        "the bin's agent",
        "when full or coupled_to changes",
        NEVER_LOST,
        "Whether the bin is full, and on whom. The same key can be queried, with an empty payload.",
        (BinStatus,),
    ),
    "events": Key(
        "{prefix}/events",
        Events,
        "physics",
        "in ticks in which something happens",
        NEVER_LOST,
        "What happened in the step from this tick to the next. `what` is one of: " + ", ".join(get_args(What)) + ".",
    ),
    "picture": Key(
        "{prefix}/picture",
        Picture,
        "physics",
        _EVERY_TICK + IF_HEARD,
        NEVER_LOST,
        "Everything that is to be seen, in one message, for the logger and whoever looks on.",
    ),
    "figures": Key(
        "{prefix}/figures", Figures, "physics", "twice a second of wall time", NEVER_LOST, "How the run goes, and what each robot does."
    ),
    "refused": Key(
        "{prefix}/hosts/{session}/refused",
        RefusedThere,
        "a host, the logger",
        "in ticks in which it refused something",
        NEVER_LOST,
        "How many messages it refused, by reason. Physics adds them up.",
    ),
    "scenario": Key(
        "{prefix}/scenario",
        None,
        "anyone",
        "when it comes to the run",
        QUERY,
        "The run's id and present tick, its agents, its scenario. The payload is empty; physics answers.",
        (RunInfo,),
    ),
    "join": Key(
        "{prefix}/hosts/{session}/join",
        Join,
        "a session that wants to hold agents",
        "when it begins",
        QUERY,
        "A wish to hold agents. Physics answers with their memories, sends their pose and scan of the present tick (again), "
        "and from this tick on waits for their velocities.",
        (Joined,),
    ),
    "lost": Key(
        "{prefix}/lost",
        Lost,
        "physics",
        "when it happens",
        NEVER_LOST,
        "Agents that were silent for too long: their robots stand. Their holder may join again.",
    ),
    "command": Key(
        "{prefix}/command", Command, "anyone", "when a person wishes", QUERY, "Stop the run. Physics answers and ends it.", (Done,)
    ),
    "stop": Key(
        "{prefix}/stop",
        Stop,
        "whoever may stop robots",
        "in an emergency",
        QUERY,
        "Stop robots, or reset them. It outranks every velocity and every deed, whoever sends them, and outlasts the agents. "
        "A robot and the bin on its bar are stopped and reset together. People and animals walk on; unloading goes on. "
        "It holds at once. Physics answers when it is on the disk as well, or after 2 s without (`kept`), or at once where the run "
        "has not begun, or begins again; asked again, it tells whether it is by now. "
        "A name that is no robot's is refused, and then nobody is stopped.",
        (Stopped,),
    ),
    "end": Key(
        "{prefix}/end",
        End,
        "physics",
        "once",
        NEVER_LOST,
        "The run is over. Physics waits for two seconds at most until all liveliness tokens are gone.",
    ),
    "alive": Key(
        "{prefix}/alive/{name}/{session}",
        None,
        "each host, for each agent; physics and logger for themselves",
        "while it lives",
        LIVELINESS,
        "Who is here. `session` is any text of letters and digits that no other process uses: the holder's id.",
    ),
}


@lru_cache(maxsize=10_000)
def _filled(template: str, prefix: str, name: str, session: str) -> str:
    return template.format(prefix=prefix, robot=name, bin=name, name=name, session=session)


class Keys:
    """The keys of one orchard."""

    def __init__(self, prefix: str = PREFIX) -> None:
        if not _PREFIX.fullmatch(prefix):
            raise ValueError(f"prefix {prefix!r}: letters, digits, _ and -, in parts with / between")
        self.prefix = prefix

    def of(self, what: str, name: str = "*", session: str = "*") -> str:
        """The key of that kind; of all names and sessions unless they are given."""
        return _filled(TABLE[what].template, self.prefix, name, session)

    def parts(self, key: str) -> list[str]:
        """What follows the prefix: ['picker_01', 'velocity'], ['alive', 'picker_01', '3fa9'], ['clock']."""
        return key.removeprefix(self.prefix + "/").split("/")
