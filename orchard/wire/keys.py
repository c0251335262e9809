"""The table of keys: for each key its message, sender, rate, delivery and meaning. `make docs` writes keyspace.md from it."""

import re
from functools import lru_cache
from typing import NamedTuple, get_args

from orchard.contract.events import What
from orchard.wire import messages as wire

NEVER_LOST = "never lost"  # reliable, in order; the sender waits for a slow subscriber
QUERY = "query"  # a Zenoh get, answered by a queryable
NEWEST_WINS = "newest wins"  # the sender does not wait, and a slow subscriber misses messages
NEWEST = "never lost; newest wins in realtime"  # in realtime the sender does not wait, and a slow subscriber misses messages
LIVELINESS = "liveliness"  # a Zenoh liveliness token

PREFIX = "orchard"
PHYSICS = "physics"  # the name in the liveliness token of the process that owns the world
LOGGER = "logger"  # the name in the token of a process that records
_PREFIX = re.compile(r"[A-Za-z0-9_-]+(/[A-Za-z0-9_-]+)*")


class Key(NamedTuple):
    """A kind of key, and the messages on it."""

    template: str
    message: type | None  # the message that is published, or the query
    sender: str
    rate: str
    delivery: str
    meaning: str
    replies: tuple[type, ...] = ()  # if the key can be queried


_EVERY_TICK = "once per tick, 10 per simulated second"
_ASKED = "once per tick at which one of the session's agents is asked"
IF_HEARD = ", while a session subscribes"

# fmt: off
TABLE: dict[str, Key] = {
    "velocity": Key("{prefix}/{body}/velocity", wire.Velocity, "the client that drives the robot, or the session that owns its agent",
                    _EVERY_TICK, NEVER_LOST,
                    "The velocity of the robot in the step from this tick to the next. While a session subscribes, physics also "
                    "publishes here the velocities that it received in `velocities`."),
    "advice": Key("{prefix}/{body}/advice", wire.Advice, "a client that drives a robot whose agent goes on", _EVERY_TICK, NEVER_LOST,
                  "The velocity of the robot in the step from this tick to the next, in place of that of its agent. See "
                  "docs/protocol.md."),
    "velocities": Key("{prefix}/hosts/{session}/velocities", wire.Velocities, "a session that owns agents", _ASKED, NEVER_LOST,
                      "The velocities of all agents of a session in one message: the answer to `seen`."),
    "pose": Key("{prefix}/{body}/pose", wire.Odometry, "physics", _EVERY_TICK + IF_HEARD, NEWEST,
                "The pose of the robot at this tick, its velocity in the last step, and the body that is coupled to it, as its sensors "
                "measure them: this is what agents use. They are the truth unless the scenario sets errors (`sensors`). Bins, people, "
                "animals and weeds have no such sensors, and observe the truth."),
    "truth": Key("{prefix}/{body}/truth", wire.Odometry, "physics", _EVERY_TICK + IF_HEARD, NEWEST,
                 "The same as it truly is, for viewers, loggers and evaluation, and not for agents. `picture`, `events`, `figures` and "
                 "the run's hash are of the truth too."),
    "odometry": Key("{prefix}/{body}/odometry", wire.Odometry, "physics", _EVERY_TICK + IF_HEARD, NEWEST,
                    "The pose of the robot by its odometry alone, in its frame `odom` (REP-105): smooth, and drifting. `odom` is where "
                    "`map` is at tick 0. `hitch` is nil. The transform from `map` to `odom` is pose * odometry^-1."),
    "scan": Key("{prefix}/{body}/scan", wire.LaserScan, "physics", _EVERY_TICK + IF_HEARD, NEWEST,
                "The ranges that the laser of the robot measures at this tick, and those of the laser of its bin."),
    "clock": Key("{prefix}/clock", wire.Clock, "physics", _EVERY_TICK + IF_HEARD, NEWEST,
                 "Simulated time. Physics sends it after all poses and scans of its tick."),
    "seen": Key("{prefix}/hosts/{session}/seen", wire.Seen, "physics", _ASKED + IF_HEARD, NEWEST,
                "For a session that owns agents: the poses and scans of those that are asked, so that it need not subscribe to "
                "each. While an answer is missing physics sends it again, and the session must answer again."),
    "mail": Key("{prefix}/{agent}/mail", wire.Letter, "any agent", "when it sends a request", QUERY,
                "A request to the agent of the robot. The host of that agent replies.", (wire.Received, wire.Answered)),
    "letters": Key("{prefix}/letters", wire.Letters, "physics", "in ticks with requests or answers" + IF_HEARD, NEVER_LOST,
                   "A copy of all requests and answers of a tick, for observers."),
    "recall": Key("{prefix}/recall", wire.Recall, "a host, in lockstep", "when it may have missed mail", QUERY,
                  "A query for the mail of this tick. Physics replies with a copy of all requests and answers of the two ticks before "
                  "it.", (wire.Recalled,)),
    "state": Key("{prefix}/{bin}/state", wire.BinStatus, "the host of the bin's agent", "when `full` or `coupled_to` changes", NEVER_LOST,
                 "Whether the bin is full, and which robot it is coupled to. The key can also be queried, with an empty payload: the reply "
                 "is as of its `tick`, the last one at which the bin was asked.",
                 (wire.BinStatus,)),
    "events": Key("{prefix}/events", wire.Events, "physics", "in ticks with events", NEVER_LOST,
                  "The events of the step from this tick to the next. `what` is one of: " + ", ".join(get_args(What)) + "."),
    "picture": Key("{prefix}/picture", wire.Picture, "physics", _EVERY_TICK + IF_HEARD, NEVER_LOST,
                   "The visible state of the whole orchard in one message, for the logger and other observers."),
    "figures": Key("{prefix}/figures", wire.Figures, "physics", "twice per second of wall time", NEVER_LOST,
                   "The figures of the run, and what each robot does."),
    "refused": Key("{prefix}/hosts/{session}/refused", wire.RefusedThere, "a host or the logger", "in ticks in which it refused messages",
                   NEVER_LOST, "How many messages this session has refused, by reason. Physics adds up the counts of all sessions."),
    "refusals": Key("{prefix}/refusals", wire.Refusal, "physics", "when it refuses a message, once a second for each key and reason",
                    NEWEST_WINS,
                    "A message that physics did not apply: its key, the reason, and the session that sent it, if the message says so. "
                    "At most 100 a second; `figures` has the count of all."),
    "left": Key("{prefix}/hosts/{session}/left", wire.Left, "a session that owns agents", "once, at its end", NEVER_LOST,
                "The session leaves for good. Physics waits for that at the end: a session whose tokens are gone may only be cut off, and "
                "then it has not heard the end."),
    "scenario": Key("{prefix}/scenario", None, "any client", "when it connects", QUERY,
                    "The run's id and present tick, its agents and its scenario. The payload of the query is empty. Physics replies.",
                    (wire.RunInfo,)),
    "layout": Key("{prefix}/layout", None, "any client", "when it connects", QUERY,
                  "Fences, trunks, posts and rows; the bodies and where they start; the sizes, speeds and lasers of their kinds. The "
                  "payload of the query is empty. Physics replies.", (wire.Orchard,)),
    "join": Key("{prefix}/hosts/{session}/join", wire.Join, "a session that wants to own agents", "when it starts", QUERY,
                "A request to own agents. Physics replies with their memories, sends their poses and scans of the present tick "
                "(again), and waits for their velocities from this tick on.", (wire.Joined,)),
    "lost": Key("{prefix}/lost", wire.Lost, "physics", "when a session loses agents", NEVER_LOST,
                "Agents that physics no longer waits for, because their session is gone or was silent for too long. Their robots stand. "
                "The session may join again."),
    "simulation_state": Key("{prefix}/simulation_state", wire.SimulationState, "physics", "when the state changes", NEVER_LOST,
                            "Whether simulated time goes on. The key can also be queried, with an empty payload.", (wire.SimulationState,)),
    "set_simulation_state": Key("{prefix}/set_simulation_state", wire.SetSimulationState, "a client that may control the run",
                                "at a user's request", QUERY,
                                "Pause the run, let it play, or end it. Physics replies with the new state. See docs/protocol.md.",
                                (wire.SimulationState,)),
    "step_simulation": Key("{prefix}/step_simulation", wire.StepSimulation, "a client that may control the run", "at a user's request",
                           QUERY,
                           "Do some steps of a paused run. Physics replies when they are done and the tick after them is published. "
                           "Refused unless the run is paused.",
                           (wire.SimulationState,)),
    "reset_simulation": Key("{prefix}/reset_simulation", wire.ResetSimulation, "a client that may control the run", "at a user's request",
                            QUERY,
                            "Begin the run again at tick 0, with the same scenario or another seed. Physics replies when it begins to do "
                            "so, see docs/protocol.md. Refused while a logger is there.",
                            (wire.SimulationState,)),
    "stop": Key("{prefix}/stop", wire.Stop, "a client that may stop robots", "in an emergency", QUERY,
                "Stop robots in an emergency, or reset them. A stop overrides all velocities and deeds of all senders, and stays in "
                "force when agents end. A robot and the bin on its bar are stopped and reset together. People and animals keep walking; "
                "unloading continues. A stop is in force at once. Physics replies when the stop is also on the disk (then `kept` is "
                "true), or after 2 s if it is not; it replies at once if the run has not begun or is being resumed. To learn later "
                "whether the stop is on the disk, send the query again. A name that is not a robot's is refused, and then no robot is "
                "stopped.", (wire.Stopped,)),
    "end": Key("{prefix}/end", wire.End, "physics", "once; every 0.2 s until all have left", NEVER_LOST,
               "The run is over. Physics removes its liveliness token, and waits until all tokens are gone and all sessions with agents "
               "have published `left`, at most two seconds. In an open run any client may publish here: it counts only if the token of "
               "physics goes within 3 s of it."),
    "alive": Key("{prefix}/alive/{name}/{session}", None, "each host, one for each of its agents; physics and the logger, one each",
                 "while the process lives", LIVELINESS,
                 "The process is present. `session` is a text of letters and digits that no other process uses: the id of the owner."),
}
# fmt: on


@lru_cache(maxsize=10_000)
def _filled(template: str, prefix: str, name: str, session: str) -> str:
    return template.format(prefix=prefix, body=name, agent=name, bin=name, name=name, session=session)


class Keys:
    """The keys of one run, below a prefix. Raises ValueError for an invalid prefix."""

    def __init__(self, prefix: str = PREFIX) -> None:
        if not _PREFIX.fullmatch(prefix):
            raise ValueError(f"prefix {prefix!r}: wanted are parts of letters, digits, _ and -, separated by /")
        self.prefix = prefix

    def of(self, what: str, name: str = "*", session: str = "*") -> str:
        """Return the key of a kind, `what` in TABLE. Without a name or a session it is a key expression for all of them."""
        return _filled(TABLE[what].template, self.prefix, name, session)

    def parts(self, key: str) -> list[str]:
        """Return the parts of a key after the prefix: ['picker_01', 'velocity'], ['alive', 'picker_01', '3fa9'], ['clock']."""
        return key.removeprefix(self.prefix + "/").split("/")
