"""The table of keys: for each key its message, delivery and replies.

A key is the name on which a message is published or a query is asked, such as
orchard/picker_01/pose. `make docs` writes keyspace.md from the table.
"""

import re
from functools import lru_cache
from typing import NamedTuple

from orchard.wire import messages as wire

# How messages are delivered, in the words of keyspace.md.
# Reliable, in order; the sender waits for a slow subscriber.
NEVER_LOST = "never lost"
# A Zenoh get, answered by a queryable.
QUERY = "query"
# The sender does not wait, and a slow subscriber misses messages.
NEWEST_WINS = "newest wins"
# In realtime the sender does not wait, and a slow subscriber misses messages.
NEWEST = "never lost; newest wins in realtime"
# A Zenoh liveliness token.
LIVELINESS = "liveliness"

PREFIX = "orchard"
# The process that owns the world.
PHYSICS = "physics"
# The name in the token of a process that records.
LOGGER = "logger"
_PREFIX = re.compile(r"[A-Za-z0-9_-]+(/[A-Za-z0-9_-]+)*")


class Key(NamedTuple):
    """A kind of key, and the messages on it.

    docs/key_words.py says which program sends them, when, and what they mean.
    """

    template: str
    # The message that is published, or the payload of the query; None: there is no payload.
    message: type | None
    # One of the five words above.
    delivery: str
    # The replies to a query; empty: the key cannot be queried.
    replies: tuple[type, ...] = ()


TABLE: dict[str, Key] = {
    "velocity": Key("{prefix}/{agent}/velocity", wire.Velocity, NEVER_LOST),
    "advice": Key("{prefix}/{body}/advice", wire.Advice, NEVER_LOST),
    "velocities": Key("{prefix}/hosts/{session}/velocities", wire.Velocities, NEVER_LOST),
    "pose": Key("{prefix}/{body}/pose", wire.Odometry, NEWEST),
    "truth": Key("{prefix}/{body}/truth", wire.Odometry, NEWEST),
    "odometry": Key("{prefix}/{body}/odometry", wire.Odometry, NEWEST),
    "scan": Key("{prefix}/{body}/scan", wire.LaserScan, NEWEST),
    "clock": Key("{prefix}/clock", wire.Clock, NEWEST),
    "seen": Key("{prefix}/hosts/{session}/seen", wire.Seen, NEWEST),
    "mail": Key("{prefix}/{agent}/mail", wire.Letter, QUERY, (wire.Received, wire.Answered)),
    "letters": Key("{prefix}/letters", wire.Letters, NEVER_LOST),
    "recall": Key("{prefix}/recall", wire.Recall, QUERY, (wire.Recalled,)),
    "state": Key("{prefix}/{bin}/state", wire.BinStatus, NEVER_LOST, (wire.BinStatus,)),
    "events": Key("{prefix}/events", wire.Events, NEVER_LOST),
    "picture": Key("{prefix}/picture", wire.TickStateMessage, NEVER_LOST),
    "bundle": Key("{prefix}/bundle", wire.Bundle, NEVER_LOST),
    "figures": Key("{prefix}/figures", wire.Figures, NEVER_LOST),
    "refused": Key("{prefix}/hosts/{session}/refused", wire.RefusedThere, NEVER_LOST),
    "refusals": Key("{prefix}/refusals", wire.Refusal, NEWEST_WINS),
    "left": Key("{prefix}/hosts/{session}/left", wire.Departure, NEVER_LOST),
    "scenario": Key("{prefix}/scenario", None, QUERY, (wire.RunInfo,)),
    "layout": Key("{prefix}/layout", None, QUERY, (wire.Orchard,)),
    "join": Key("{prefix}/hosts/{session}/join", wire.Join, QUERY, (wire.Joined,)),
    "lost": Key("{prefix}/lost", wire.Lost, NEVER_LOST),
    "simulation_state": Key(
        "{prefix}/simulation_state", wire.SimulationState, NEVER_LOST, (wire.SimulationState,)
    ),
    "set_simulation_state": Key(
        "{prefix}/set_simulation_state", wire.SetSimulationState, QUERY, (wire.SimulationState,)
    ),
    "step_simulation": Key(
        "{prefix}/step_simulation", wire.StepSimulation, QUERY, (wire.SimulationState,)
    ),
    "reset_simulation": Key(
        "{prefix}/reset_simulation", wire.ResetSimulation, QUERY, (wire.SimulationState,)
    ),
    "stop": Key("{prefix}/stop", wire.Stop, QUERY, (wire.Stopped,)),
    "end": Key("{prefix}/end", wire.End, NEVER_LOST),
    "alive": Key("{prefix}/alive/{name}/{session}", None, LIVELINESS),
    "physics": Key("{prefix}/alive/physics/{run}/{session}", None, LIVELINESS),
}


@lru_cache(maxsize=10_000)
def _filled(template: str, prefix: str, name: str, session: str) -> str:
    """Return a key with all its parts."""
    return template.format(
        prefix=prefix, body=name, agent=name, bin=name, name=name, run=name, session=session
    )


class Keys:
    """The keys of one run, below a prefix. Raises ValueError for an invalid prefix.

    >>> keys = Keys("orchard")
    >>> keys.of("pose", "bin_01")
    'orchard/bin_01/pose'
    >>> keys.of("pose")
    'orchard/*/pose'
    >>> keys.parts("orchard/bin_01/pose")
    ['bin_01', 'pose']
    """

    def __init__(self, prefix: str = PREFIX) -> None:
        if not _PREFIX.fullmatch(prefix):
            raise ValueError(
                f"prefix {prefix!r}: wanted are parts of letters, digits, _ and -, separated by /"
            )
        self.prefix = prefix

    def of(self, what: str, name: str = "*", session: str = "*") -> str:
        """Return the key of a kind, `what` in TABLE.

        Without a name or a session it is a key expression with * for all of them.

        `name`: of a body, an agent or a process; for "physics" the id of the run.
        """
        return _filled(TABLE[what].template, self.prefix, name, session)

    def parts(self, key: str) -> list[str]:
        """Return the parts of a key after the prefix: ['alive', 'picker_01', '3fa9'], ['clock']."""
        return key.removeprefix(self.prefix + "/").split("/")
