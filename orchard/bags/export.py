"""Writes a recording as a bag: for each tick the clock, transforms, odometry and wanted velocities.

`drives.py` has read the recording. A topic is the name and the type under which ROS publishes
messages (`plain/topics.py`); in a bag each topic is a connection.
"""

from array import array
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import Any, Literal

import numpy as np
from rosbags.interfaces import (
    Connection,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from orchard.bags.drives import STILL, Drives, State, ranges_of
from orchard.bags.plain import bodies, cdr, field, messages, topics
from orchard.bags.replay import SCENARIO
from orchard.contract.events import Velocities
from orchard.field.kinds import KINDS, LASER_NEAREST, LASER_RANGE, VEHICLES, kind_of, select_agents
from orchard.field.layout import lay_out
from orchard.view.recorder import SCAN_BEAMS

VERSION: Literal[9] = 9  # of a bag's metadata: that of ROS 2 Jazzy
# No deadline and no end of life: the largest seconds and nanoseconds, as rosbag2 writes infinity.
NEVER = QosTime(2**31 - 1, 2**32 - 1)


class Bag(AbstractContextManager["Bag"]):
    """A bag that is written. If the context ends with an error, no file is left. Raises OSError."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self.count = 0
        self._store = get_typestore(Stores.ROS2_JAZZY)
        # The bag is made in a hidden folder beside its place, and moved there when it is whole.
        self._folder = TemporaryDirectory(dir=file.parent, prefix=f".{file.name}.")
        self._writer = Writer(
            Path(self._folder.name) / "bag", version=VERSION, storage_plugin=StoragePlugin.MCAP
        )
        self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        self._writer.open()
        self._connections: dict[tuple[topics.Topic, str], Connection] = {}

    def write(self, topic: topics.Topic, robot: str, tick: int, message: messages.Message) -> None:
        """Write a message at the time of a tick. `robot`: '' for a topic of no robot."""
        connection = self._connections.get((topic, robot)) or self._connect(topic, robot)
        self._writer.write(connection, tick * messages.TICK_NANOSECONDS, cdr.encoded(message))
        self.count += 1

    def _connect(self, topic: topics.Topic, robot: str) -> Connection:
        name = "/" + topic.of(robot).removeprefix("/")
        made = self._writer.add_connection(
            name, topic.type, typestore=self._store, offered_qos_profiles=[_qos(topic.qos)]
        )
        self._connections[topic, robot] = made
        return made

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        with self._folder:
            self._writer.close()
            if kind is None:
                (written,) = Path(self._folder.name).glob("bag/*.mcap")
                written.replace(self._file)


def _qos(qos: topics.QoS) -> Qos:
    reliability = QosReliability.RELIABLE if qos.reliable else QosReliability.BEST_EFFORT
    durability = QosDurability.TRANSIENT_LOCAL if qos.latched else QosDurability.VOLATILE
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=qos.depth,
        reliability=reliability,
        durability=durability,
        deadline=NEVER,
        lifespan=NEVER,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=NEVER,
        avoid_ros_namespace_conventions=False,
    )


# Takes ticks and their number, returns the same ticks, and shows how many of them are done.
Track = Callable[[Iterable[Any], int], Iterable[Any]]


def chosen(drives: Drives, words: Sequence[str]) -> list[str]:
    """Return the bodies of these names or kinds; without any, the robots that drive.

    Raises ValueError.
    """
    names = select_agents(drives.names, list(words), [])
    return [name for name in names if words or kind_of(name) in VEHICLES]


def export(drives: Drives, robots: Sequence[str], file: Path, track: Track) -> int:
    """Write a bag, and return the number of its messages.

    Scans are in it if `drives` has them. Raises OSError.

    A velocity has the time at which the step with it begins, all else that of its tick. Of a body
    that never drove there is no velocity.
    """
    with Bag(file) as bag:
        _begin(bag, drives, robots)
        for tick, poses, velocities in track(drives.ticks(), drives.last + 1 - drives.first):
            # The step that ends at this tick began at the tick before.
            if tick > drives.first:
                _commands(bag, tick - 1, velocities, robots)
            _tick(bag, tick, poses, velocities, robots)
            _scans(bag, tick, drives.points.get(tick, {}), robots)
        return bag.count


def _begin(bag: Bag, drives: Drives, robots: Sequence[str]) -> None:
    """Write what does not change: scenario, map, shapes of the robots, places of their lasers."""
    first = drives.first
    bag.write(SCENARIO, "", first, messages.text(drives.scenario.model_dump_json()))
    bag.write(
        topics.GRID, "", first, field.grid_of(lay_out(drives.scenario.without_code).walls.tolist())
    )
    for name in robots:
        kind = KINDS[kind_of(name)]
        shape = bodies.description(
            name, (kind.length, kind.width, kind.height), kind.colour, kind.laser.ahead
        )
        bag.write(topics.ROBOT_DESCRIPTION, name, first, messages.text(shape))
    lasers = [(name, KINDS[kind_of(name)].laser.ahead) for name in robots]
    bag.write(topics.TF_STATIC, "", first, messages.static_transforms(lasers))


def _commands(
    bag: Bag, tick: int, velocities: Mapping[str, Velocities], robots: Sequence[str]
) -> None:
    """Write the velocities that were wanted for the step from a tick on."""
    for name in robots:
        if name in velocities:
            # Three velocities as done, then the three that were wanted.
            forward, left, turn = velocities[name][3:]
            bag.write(
                topics.CMD_VEL, name, tick, messages.velocity(name, tick, forward, turn, left)
            )


def _tick(
    bag: Bag,
    tick: int,
    poses: Mapping[str, State],
    velocities: Mapping[str, Velocities],
    robots: Sequence[str],
) -> None:
    """Write the clock, and where the robots are and how they drove at a tick."""
    states = {}
    for name in robots:
        if name in poses:
            forward, left, turn = velocities.get(name, STILL)[:3]
            states[name] = (*poses[name], forward, left, turn)
    bag.write(topics.CLOCK, "", tick, messages.clock(tick))
    bag.write(topics.TF, "", tick, messages.transforms(tick, states))
    for name, state in states.items():
        bag.write(topics.ODOM, name, tick, messages.odometry(name, tick, state))


def _scans(bag: Bag, tick: int, points: Mapping[str, np.ndarray], robots: Sequence[str]) -> None:
    """Write the scans as they are recorded: every second beam, twice a second, to 1/32 m."""
    for name in robots:
        if name in points:
            laser = KINDS[kind_of(name)].laser
            ranges = array("f", ranges_of(points[name], laser, SCAN_BEAMS).tobytes())
            scan = messages.scan(
                name,
                tick,
                ranges,
                angle_min=laser.first,
                angle_increment=laser.increment * SCAN_BEAMS,
                range_min=LASER_NEAREST,
                range_max=LASER_RANGE,
            )
            bag.write(topics.SCAN, name, tick, scan)
