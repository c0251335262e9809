"""What a node publishes and how: types, qualities of service, and messages as bytes."""

import importlib
from collections.abc import Callable
from functools import lru_cache
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from orchard_ros2.plain import cdr, topics
from orchard_ros2.plain.messages import Message
from orchard_ros2.plain.topics import QoS, Topic

NO_TF2 = (
    "tf2_msgs cannot be imported: /tf and /tf_static are not published. Install ROS 2's package"
    " tf2_msgs, and source its setup"
)


@lru_cache
def type_of(name: str) -> Any:
    """Return the class of a message type. Raises ImportError if its package is not installed."""
    package, _, kind = name.partition("/msg/")
    return getattr(importlib.import_module(f"{package}.msg"), kind)


def profile(qos: QoS) -> QoSProfile:
    """Return a quality of service as rclpy knows it."""
    reliability = ReliabilityPolicy.RELIABLE if qos.reliable else ReliabilityPolicy.BEST_EFFORT
    durability = DurabilityPolicy.TRANSIENT_LOCAL if qos.latched else DurabilityPolicy.VOLATILE
    return QoSProfile(depth=qos.depth, reliability=reliability, durability=durability)


class Publishers:
    """The publishers of a node, by the names of their topics."""

    def __init__(self, node: Node) -> None:
        """`node`: the one that publishes."""
        self._node = node
        self._by_name: dict[str, Publisher] = {}

    def can_publish_tf(self) -> bool:
        """Whether the package of /tf is installed. If it is not, the log says so."""
        try:
            type_of(topics.TF.type)
        except ImportError:
            self._node.get_logger().warning(NO_TF2)
            return False
        return True

    def announce(self, topic: Topic, robot: str = "") -> Publisher:
        """Return the publisher of a topic, which is made when it is first asked for."""
        name = topic.of(robot)
        if name not in self._by_name:
            kind = type_of(topic.type)
            self._by_name[name] = self._node.create_publisher(kind, name, profile(topic.qos))
        return self._by_name[name]

    def publish(self, topic: Topic, make: Callable[[], Message], robot: str = "") -> None:
        """Publish a message as bytes: rclpy's objects cost five times as much.

        `make`: returns the message. It is not called if nothing subscribes to the topic, unless the
        topic is latched.
        """
        publisher = self.announce(topic, robot)
        if topic.qos.latched or publisher.get_subscription_count():
            publisher.publish(cdr.encoded(make()))
