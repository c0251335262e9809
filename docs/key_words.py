"""The keys in words: what sends on each, how often, and what its messages mean beside what their
docstrings say.
"""

from typing import NamedTuple, get_args

from orchard.contract.events import What
from orchard.wire.keys import PHYSICS, TABLE

_EVERY_TICK = "once per tick, 10 per simulated second"
_ASKED = "once per tick at which one of the session's agents is asked"
IF_HEARD = ", while a session subscribes"
_ANSWERED = (
    "an owner: once per tick at which the agent is asked; for a robot without an owner: at will; "
    "physics: what it took from `velocities`"
)


class KeyWords(NamedTuple):
    """What a person must know of a key."""

    sender: str
    rate: str
    meaning: str = ""  # empty: the docstring of the message says it


WORDS = {
    "velocity": KeyWords(
        "the client that drives the robot, or the session that owns the agent; physics",
        _ANSWERED + IF_HEARD,
        "The velocity of the robot in the step from this tick to the next. While a session"
        " subscribes, physics also publishes here the velocities that it received in `velocities`:"
        " only at ticks at which the agent answered, which is seldom for an agent that holds."
        " Agents without a body have one too, of 0.",
    ),
    "advice": KeyWords(
        "a client that drives a robot whose agent goes on",
        "at will, at most once per tick",
        "The velocity of the robot in the step from this tick to the next, in place of that of its"
        " agent. See docs/protocol.md.",
    ),
    "velocities": KeyWords("a session that owns agents", _ASKED),
    "pose": KeyWords(
        PHYSICS,
        _EVERY_TICK + IF_HEARD,
        "The pose of the robot at this tick, its velocity in the last step, and the body that is"
        " coupled to it, as its sensors measure them: this is what agents use. They are the truth"
        " unless the scenario sets errors (`sensors`). Bins, people, animals and weeds have no such"
        " sensors, and observe the truth.",
    ),
    "truth": KeyWords(
        PHYSICS,
        _EVERY_TICK + IF_HEARD,
        "The same as it truly is, for viewers, loggers and evaluation, and not for agents."
        " `picture`, `events`, `figures` and the run's hash are of the truth too.",
    ),
    "odometry": KeyWords(
        PHYSICS,
        _EVERY_TICK + IF_HEARD,
        "The pose of the robot by its odometry alone, in its frame `odom` (REP-105): smooth, and"
        " drifting. `odom` is where `map` is at tick 0. `hitch` is nil. The transform from `map` to"
        " `odom` is pose * odometry^-1.",
    ),
    "scan": KeyWords(
        PHYSICS,
        _EVERY_TICK + IF_HEARD,
        "The ranges that the laser of the robot measures at this tick, and those of the laser of"
        " its bin.",
    ),
    "clock": KeyWords(PHYSICS, _EVERY_TICK + IF_HEARD),
    "seen": KeyWords(
        PHYSICS,
        _ASKED + IF_HEARD,
        "For a session that owns agents: the poses and scans of those that are asked, so that it"
        " need not subscribe to each. While an answer is missing physics sends it again, and the"
        " session must answer again.",
    ),
    "mail": KeyWords(
        "the session that owns an agent",
        "when the agent sends a request",
        "A request to the agent of the robot. The host of that agent replies.",
    ),
    "letters": KeyWords(PHYSICS, "in ticks with requests or answers" + IF_HEARD),
    "recall": KeyWords("a host, in lockstep", "when it may have missed mail"),
    "state": KeyWords(
        "the host of the bin's agent",
        "when `full` or `coupled_to` changes",
        "Whether the bin is full, and which robot it is coupled to. The key can also be queried,"
        " with an empty payload: the reply is as of its `tick`, the last one at which the bin was"
        " asked.",
    ),
    "events": KeyWords(
        PHYSICS,
        "in ticks with events",
        "The events of the step from this tick to the next. `what` is one of: "
        + ", ".join(get_args(What))
        + ".",
    ),
    "picture": KeyWords(PHYSICS, _EVERY_TICK + IF_HEARD),
    "bundle": KeyWords(
        PHYSICS, "every ten ticks, or earlier if 50 ms of wall time are over" + IF_HEARD
    ),
    "figures": KeyWords(PHYSICS, "twice per second of wall time"),
    "refused": KeyWords(
        "a host or the logger",
        "in ticks in which it refused messages",
        "How many messages this session has refused, by reason. Physics adds up the counts of all"
        " sessions.",
    ),
    "refusals": KeyWords(
        PHYSICS,
        "when it refuses a message, once a second for each key and reason",
        "A message that physics did not apply: its key, the reason, and the session that sent it,"
        " if the message says so. At most 100 a second; `figures` has the count of all.",
    ),
    "left": KeyWords(
        "a session that owns agents",
        "once, at its end",
        "The session leaves for good. Physics waits for that at the end: a session whose tokens are"
        " gone may only be cut off, and then it has not heard the end.",
    ),
    "scenario": KeyWords(
        "any session",
        "when it connects",
        "The run's id and present tick, its agents and its scenario. The payload of the query is"
        " empty. Physics replies.",
    ),
    "layout": KeyWords(
        "any session",
        "when it connects",
        "Fences, trunks, posts and rows; the bodies, where they start, and which rows a picker"
        " picks; the sizes, speeds and lasers of their kinds. The payload of the query is empty."
        " Physics replies.",
    ),
    "join": KeyWords(
        "a session that wants to own agents",
        "when it starts",
        "A request to own agents. Physics replies with their memories, sends their poses and scans"
        " of the present tick (again), and waits for their velocities from this tick on.",
    ),
    "lost": KeyWords(PHYSICS, "when a session loses agents"),
    "simulation_state": KeyWords(
        PHYSICS,
        "when the state changes",
        "Whether simulated time goes on. The key can also be queried, with an empty payload.",
    ),
    "set_simulation_state": KeyWords(
        "a client that may control the run",
        "at a user's request",
        "Pause the run, let it play, or end it. Physics replies with the new state. See"
        " docs/protocol.md.",
    ),
    "step_simulation": KeyWords(
        "a client that may control the run",
        "at a user's request",
        "Do some steps of a paused run. Physics replies when they are done and the tick after them"
        " is published. Refused unless the run is paused.",
    ),
    "reset_simulation": KeyWords(
        "a client that may control the run",
        "at a user's request",
        "Begin the run again at tick 0, with the same scenario or another seed. Physics replies"
        " when it begins to do so, see docs/protocol.md. Refused while a logger is there.",
    ),
    "stop": KeyWords(
        "a client that may stop robots",
        "in an emergency",
        "Stop robots in an emergency, or reset them. A stop overrides all velocities and deeds of"
        " all senders, and stays in force when agents end. A robot and the bin on its bar are"
        " stopped and reset together. People and animals keep walking; unloading continues. A stop"
        " is in force at once. Physics replies when the stop is also on the disk (then `kept` is"
        " true), or after 2 s if it is not; it replies at once if the run has not begun or is being"
        " resumed. To learn later whether the stop is on the disk, send the query again. A name"
        " that is not a robot's is refused, and then no robot is stopped.",
    ),
    "end": KeyWords(
        PHYSICS,
        "once; every 0.2 s until all have left",
        "The run is over. Physics removes its liveliness token, and waits until all tokens are gone"
        " and all sessions with agents have published `left`, at most two seconds. In an open run"
        " any client may publish here: it counts only if the token of physics goes within 3 s"
        " of it.",
    ),
    "alive": KeyWords(
        "each session that owns agents, one for each of them; the logger",
        "while the process lives",
        "The process is present. `session` is a text of letters and digits that no other process"
        " uses: the id of the owner.",
    ),
    "physics": KeyWords(
        PHYSICS,
        "while the process lives",
        "Physics is present. If it dies and starts again, it has another `session`. A router that"
        " has not noticed the death yet has both tokens for a moment.",
    ),
}


def meaning_of(name: str) -> str:
    """Return what the messages on a key mean; '' if neither its words nor its message say it."""
    meaning = WORDS[name].meaning
    if meaning:
        return meaning
    docstring = getattr(TABLE[name].message, "__doc__", None) or ""
    return " ".join(docstring.split())
