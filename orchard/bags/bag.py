"""Writes ROS 2 messages into a bag: one MCAP file, compressed with zstd, that is there whole or not at all."""

from contextlib import AbstractContextManager
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import Literal

from orchard_ros2.cdr import encoded
from orchard_ros2.messages import TICK_NANOSECONDS, Message
from orchard_ros2.topics import QoS, Topic
from rosbags.interfaces import Connection, Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

VERSION: Literal[9] = 9  # of a bag's metadata: that of ROS 2 Jazzy
NEVER = QosTime(2**31 - 1, 2**32 - 1)  # no deadline, no end of life: what rosbag2 writes for infinity


class Bag(AbstractContextManager["Bag"]):
    """A bag that is written. If the context ends with an error, no file is left. Raises OSError."""

    def __init__(self, file: Path) -> None:
        self._file, self.count = file, 0
        self._store = get_typestore(Stores.ROS2_JAZZY)
        self._folder = TemporaryDirectory(dir=file.parent, prefix=f".{file.name}.")
        self._writer = Writer(Path(self._folder.name) / "bag", version=VERSION, storage_plugin=StoragePlugin.MCAP)
        self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        self._writer.open()
        self._connections: dict[tuple[Topic, str], Connection] = {}

    def write(self, topic: Topic, robot: str, tick: int, message: Message) -> None:
        """Write a message at the time of a tick. `robot`: '' for a topic of no robot."""
        connection = self._connections.get((topic, robot)) or self._connect(topic, robot)
        self._writer.write(connection, tick * TICK_NANOSECONDS, encoded(message))
        self.count += 1

    def _connect(self, topic: Topic, robot: str) -> Connection:
        name = "/" + topic.of(robot).removeprefix("/")
        made = self._writer.add_connection(name, topic.type, typestore=self._store, offered_qos_profiles=[_qos(topic.qos)])
        self._connections[topic, robot] = made
        return made

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        with self._folder:
            self._writer.close()
            if kind is None:
                (written,) = Path(self._folder.name).glob("bag/*.mcap")
                written.replace(self._file)


def _qos(qos: QoS) -> Qos:
    reliability = QosReliability.RELIABLE if qos.reliable else QosReliability.BEST_EFFORT
    durability = QosDurability.TRANSIENT_LOCAL if qos.latched else QosDurability.VOLATILE
    return Qos(QosHistory.KEEP_LAST, qos.depth, reliability, durability, NEVER, NEVER, QosLiveliness.AUTOMATIC, NEVER, False)
