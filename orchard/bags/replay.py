"""Lets the velocities in a bag drive its robots again: for `orchard replay`.

The agent of such a robot runs as ever: it follows its plan, sends letters, and couples bins. Only
the velocity that it wants is replaced by that of the bag.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from operator import itemgetter
from pathlib import Path
from typing import Any

import msgspec
from msgspec.structs import replace
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection

from orchard.bags.plain import messages, topics
from orchard.contract.agent import Action, Agent, Mail, Observation
from orchard.contract.messages import FASTEST
from orchard.field.geometry import Twist
from orchard.field.kinds import VEHICLES, kind_of
from orchard.field.problems import printable
from orchard.field.scenario import Scenario, check
from orchard.folders import regular

# The scenario of the run, as JSON.
SCENARIO = topics.Topic("orchard/scenario", "std_msgs/msg/String", topics.LATCHED)
A_BAG = "a bag of ROS 2: an .mcap file, or the folder of a bag with its metadata.yaml"
# Steps for which a velocity drives a robot if no newer one comes: 0.5 s. A velocity that a program
# sends on the network stands as long (WATCHDOG_TICKS of orchard/server/commands.py).
KEPT_TICKS = 5
# The types of ROS messages that hold a velocity.
VELOCITIES = {topics.CMD_VEL.type, topics.CMD_VEL_UNSTAMPED.type}


@dataclass(frozen=True)
class Commands:
    """What a bag holds to drive robots again."""

    scenario: Scenario | None  #: of the run that was recorded; None if the bag does not say
    #: robot -> tick at which the step begins -> the velocity for it
    velocities: Mapping[str, Mapping[int, Twist]]
    #: robot -> the tick of each of its velocities in the bag; several may be of one tick
    ticks: Mapping[str, Sequence[int]] = field(default_factory=dict)


class Replayed:
    """An agent that drives with the velocities of a bag, or its own where the bag has none."""

    def __init__(self, agent: Agent, velocities: Mapping[int, Twist]) -> None:
        self.Memory = agent.Memory
        self._agent = agent
        self._velocities = velocities

    def tick(self, seen: Observation, mail: Mail, memory: Any) -> Action:
        action = self._agent.tick(seen, mail, memory)
        # Without a hold it is asked at each tick: the bag may have another velocity in each.
        return replace(action, twist=self._velocity(seen.tick, action.twist), hold=None)

    def _velocity(self, tick: int, otherwise: Twist) -> Twist:
        """Return the newest velocity of the last KEPT_TICKS ticks; `otherwise` if there is none."""
        for earlier in range(tick, tick - KEPT_TICKS, -1):
            if earlier in self._velocities:
                return self._velocities[earlier]
        return otherwise


def replayed(agents: Mapping[str, Agent], commands: Commands) -> dict[str, Agent]:
    """Return the agents, those of the bag's robots with the bag's velocities."""
    replaced = dict(agents)
    for name, velocities in commands.velocities.items():
        if name in agents:
            replaced[name] = Replayed(agents[name], velocities)
    return replaced


def read_commands(bag: Path, from_first_stamp: bool = False) -> Commands:
    """Return what a bag holds on NAME/cmd_vel, TwistStamped or Twist, of each robot.

    A velocity counts from its stamp on, or from the message's time if it has none. A stamp of 0 is
    none. Times count from 0 s, or from the first velocity of the bag if `from_first_stamp`.
    Raises ValueError for what cannot be used.
    """
    scenario = None
    topics_seen = set[str]()
    # Robot -> (stamp in ns, velocity), in the order of the bag.
    stamped = dict[str, list[tuple[int, Twist]]]()
    for connection, time, message in _messages(bag, topics_seen):
        robot = _robot_of(connection.topic, connection.msgtype)
        if robot:
            stamp = _stamp_of(message, time)
            where = f"{bag}: {connection.topic}, at {stamp / 1e9:.1f} s"
            stamped.setdefault(robot, []).append((stamp, _twist_of(message, where)))
        else:
            scenario = _scenario(message.data, f"the scenario in {bag}")
    _check_velocities(bag, stamped, topics_seen)
    # The stamp, in ns, at which the run begins.
    begin = 0
    if from_first_stamp:
        begin = min(stamp for twists in stamped.values() for stamp, _ in twists)
    velocities = dict[str, dict[int, Twist]]()
    ticks = dict[str, list[int]]()
    for robot, twists in sorted(stamped.items()):
        twists.sort(key=itemgetter(0))
        ticks[robot] = []
        velocities[robot] = {}
        for stamp, twist in twists:
            # A stamp between two ticks counts from the later tick on. The two minus signs let `//`,
            # which rounds down, round up.
            tick = -((begin - stamp) // messages.TICK_NANOSECONDS)
            ticks[robot].append(tick)
            velocities[robot][tick] = twist
    return Commands(scenario, velocities, ticks)


def _check_velocities(bag: Path, velocities: Mapping[str, Any], topics_seen: set[str]) -> None:
    """Raise ValueError for a bag without a velocity. `topics_seen`: all topics that it has."""
    if not velocities:
        wanted = "the topic /NAME/cmd_vel of a robot, of type TwistStamped or Twist"
        there = "it has no topics"
        if topics_seen:
            there = f"its topics are {printable(', '.join(sorted(topics_seen)), 500)}"
        raise ValueError(f"{bag}: it has no velocity; expected {wanted}; {there}")


def _messages(bag: Path, topics_seen: set[str]) -> Iterator[tuple[Connection, int, Any]]:
    """Yield the velocities and scenarios of a bag: connection, time in ns, message.

    Adds all topics of the bag to `topics_seen`. Raises ValueError if the bag cannot be read.
    """
    try:
        with AnyReader([bag if bag.is_dir() else regular(bag)]) as reader:
            wanted = list[Connection]()
            for connection in reader.connections:
                topics_seen.add(f"{connection.topic} ({connection.msgtype})")
                is_scenario = connection.topic == f"/{SCENARIO.name}"
                if is_scenario or _robot_of(connection.topic, connection.msgtype):
                    wanted.append(connection)
            if not wanted:
                # Without a connection the reader would yield all messages.
                return
            for connection, time, data in reader.messages(wanted):
                yield connection, time, reader.deserialize(data, connection.msgtype)
    except Exception as error:
        # For a damaged file rosbags may raise an error of any type, such as KeyError.
        why = _why_unreadable(error) if bag.exists() else "no such file or folder"
        raise ValueError(f"{bag}: {why}; expected {A_BAG}") from error


def _why_unreadable(error: Exception) -> str:
    """Return why a bag cannot be read, from the error of its library."""
    fault = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return f"it cannot be read as a bag: {fault}"


def _scenario(text: str, source: str) -> Scenario:
    """Return the scenario in a JSON text. Raises ValueError if it is none."""
    try:
        return check(msgspec.json.decode(text), source)
    except (msgspec.MsgspecError, RecursionError) as error:
        raise ValueError(f"{source}: it cannot be read as JSON: {error}") from error


def check_robots(bag: Path, commands: Commands, names: Mapping[str, int]) -> None:
    """Raise ValueError if the bag drives bodies that are not in the orchard."""
    unknown = sorted(commands.velocities.keys() - names.keys())
    if unknown:
        robots = [name for name in names if kind_of(name) in VEHICLES]
        drives = (
            f"it drives {printable(', '.join(unknown), 500)}, not in this orchard: its robots are"
            f" {', '.join(robots)}"
        )
        raise ValueError(
            f"{bag}: {drives}; expected the orchard of the bag: its scenario, or --pickers and"
            " --carriers as there"
        )


def _robot_of(topic: str, kind: str) -> str:
    """Return the robot that a topic drives; '' if it has no velocities. `kind`: of its messages."""
    robot, _, rest = topic.removeprefix("/").partition("/")
    if rest == "cmd_vel" and kind in VELOCITIES:
        return robot
    return ""


def _stamp_of(message: Any, time: int) -> int:
    """Return the stamp of a velocity, or the message's `time` if it has none, in ns."""
    if not hasattr(message, "header"):
        return time
    stamp = message.header.stamp
    nanoseconds = int(stamp.sec * 10**9 + stamp.nanosec)
    # A stamp of 0 is none.
    return nanoseconds or time


def _twist_of(message: Any, where: str) -> Twist:
    """Return a velocity. Raises ValueError for one that no robot can have."""
    # A message with a stamp has its velocity in `twist`; another one is the velocity.
    velocity = getattr(message, "twist", message)
    twist = Twist(velocity.linear.x, velocity.linear.y, velocity.angular.z)
    if not all(math.isfinite(part) and abs(part) <= FASTEST for part in twist):
        raise ValueError(
            f"{where}: a velocity of {tuple(twist)}; expected numbers from {-FASTEST:g} to"
            f" {FASTEST:g}"
        )
    return twist
