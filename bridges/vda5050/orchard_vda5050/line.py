"""The lines to fleet control: one MQTT client for each vehicle.

The broker speaks for each client that it loses, so a vehicle needs one of its own. What is sent
while the broker is away is not kept: the next state says all.
"""

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import count
from queue import Empty, SimpleQueue
from typing import Any
from urllib.parse import unquote, urlsplit

import msgspec
from paho.mqtt.client import Client, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion

from orchard_vda5050.messages import Message, connection_of
from orchard_vda5050.network import Connection, Network
from orchard_vda5050.older import older, oldest


def newest(_topic: str, message: Message) -> Message:
    """Return a message as it is: vehicles write version 3.0."""
    return message


# Version -> the function that says a message in its words. It takes the topic, too.
VERSIONS: Mapping[str, Callable[[str, Message], Message]] = {
    "3.0.0": newest,
    "2.1.0": older,
    "2.0.0": oldest,
}
# Topics of which the broker keeps the newest message.
RETAINED = ("connection", "factsheet")
# Quality of service of `connection`; that of all others is 0.
AT_LEAST_ONCE = 1
# Characters that mean something in a topic.
RESERVED = set("/+#$")
# Scheme of a broker's URL -> its port, unless the URL names one.
PORTS = {"mqtt": 1883, "mqtts": 8883}


@dataclass(frozen=True)
class Broker:
    """Where the broker is, and how to log in.

    `interface` and `manufacturer`: parts of the topics.
    """

    host: str
    port: int
    is_secure: bool = False
    user: str | None = None
    password: str | None = None
    interface: str = "vda5050"
    manufacturer: str = "orchard"
    version: str = "3.0.0"

    def topic(self, serial: str, topic: str) -> str:
        """Return the full name of a vehicle's topic."""
        return f"{self.interface}/v{self.version[0]}/{self.manufacturer}/{serial}/{topic}"


def broker_at(url: str, interface: str, manufacturer: str, version: str) -> Broker:
    """Return the broker at a URL such as mqtt://user:password@127.0.0.1:1883.

    Raises ValueError for one that cannot be.
    """
    if version not in VERSIONS:
        raise ValueError(f"version {version}: there are {', '.join(VERSIONS)}")
    parts = urlsplit(url)
    if parts.scheme not in PORTS or not parts.hostname or parts.path not in ("", "/"):
        raise ValueError(
            f"broker {url!r}: must be as mqtt://127.0.0.1:1883 or, with TLS,"
            " mqtts://user:password@broker.example:8883"
        )
    for word in (interface, manufacturer):
        if not word or RESERVED.intersection(word):
            raise ValueError(f"{word!r}: a part of a topic needs characters, but none of / + # $")
    return Broker(
        host=parts.hostname,
        port=parts.port or PORTS[parts.scheme],
        is_secure=parts.scheme == "mqtts",
        user=_unquoted(parts.username),
        password=_unquoted(parts.password),
        interface=interface,
        manufacturer=manufacturer,
        version=version,
    )


def _unquoted(word: str | None) -> str | None:
    """Return a part of a URL as it is meant; None if it is not there."""
    return None if word is None else unquote(word)


def _client(broker: Broker, name: str) -> Client:
    """Return a client of a broker, which has not connected. `name`: of what it speaks for."""
    client_id = f"{broker.interface}-{broker.manufacturer}-{name}"
    client = Client(CallbackAPIVersion.VERSION2, client_id=client_id)
    client.username_pw_set(broker.user, broker.password)
    if broker.is_secure:
        client.tls_set()
    return client


class Line:
    """A vehicle's port to fleet control."""

    def __init__(
        self,
        network: Network,
        broker: Broker,
        serial: str,
        subscribes: Sequence[str],
        greets: Sequence[tuple[str, Message]],
    ) -> None:
        """`serial`: the name of the vehicle. `subscribes`: the topics that it takes. `greets`: what
        it sends when it has connected.
        """
        self._network = network
        self._broker = broker
        self._serial = serial
        self._subscribes = subscribes
        self._greets = greets
        self._inbox: SimpleQueue[tuple[str, bytes]] = SimpleQueue()
        # Topic -> the headerIds of its messages.
        self._numbers: dict[str, Any] = defaultdict(count)
        self.state_header_id = 0
        client = _client(broker, serial)
        will = self._payload("connection", connection_of("CONNECTION_BROKEN"))
        client.will_set(broker.topic(serial, "connection"), will, AT_LEAST_ONCE, retain=True)
        client.on_message = self._arrived
        self._connection = Connection(client, broker.host, broker.port, self._greet)
        network.keep(self._connection)

    def take(self) -> list[tuple[str, bytes]]:
        """Return what has come since the last call: topic and payload.

        The first call opens the line.
        """
        self._network.open()
        messages = []
        while True:
            try:
                messages.append(self._inbox.get_nowait())
            except Empty:
                return messages

    def send(self, topic: str, message: Message) -> None:
        """Send a message, if the broker is there."""
        if self._connection.is_there:
            self._connection.publish(
                self._broker.topic(self._serial, topic),
                self._payload(topic, message),
                quality=AT_LEAST_ONCE if topic == "connection" else 0,
                is_retained=topic in RETAINED,
            )

    def leave(self) -> None:
        """Say that the vehicle goes offline."""
        self.send("connection", connection_of("OFFLINE"))

    def _payload(self, topic: str, message: Message) -> bytes:
        """Return a message with its header, as JSON in the words of the broker's version."""
        header_id = next(self._numbers[topic]) % 2**32
        if topic == "state":
            self.state_header_id = header_id
        now = datetime.now(UTC).isoformat(timespec="milliseconds")
        header = {
            "headerId": header_id,
            "timestamp": now.replace("+00:00", "Z"),
            "version": self._broker.version,
            "manufacturer": self._broker.manufacturer,
            "serialNumber": self._serial,
        }
        body = VERSIONS[self._broker.version](topic, message)
        return msgspec.json.encode(header | body)

    def _greet(self, client: Client) -> None:
        """Subscribe to what comes, and say that the vehicle is there."""
        for topic in self._subscribes:
            client.subscribe(self._broker.topic(self._serial, topic))
        for topic, message in self._greets:
            self.send(topic, message)

    def _arrived(self, _client: Client, _data: Any, message: MQTTMessage) -> None:
        topic = message.topic.rsplit("/", 1)[1]
        self._inbox.put((topic, bytes(message.payload)))


class Notices:
    """The line for the list of full bins that wait.

    It is no topic of VDA 5050: interface/calls, JSON, retained.
    """

    def __init__(self, network: Network, broker: Broker) -> None:
        """`network`: keeps the connection."""
        self._topic = f"{broker.interface}/calls"
        self._newest = b"[]"
        client = _client(broker, "calls")
        self._connection = Connection(client, broker.host, broker.port, self._greet)
        network.keep(self._connection)

    def tell(self, waiting: list[Message]) -> None:
        """Publish the list."""
        self._newest = msgspec.json.encode(waiting)
        self._publish()

    def _greet(self, _client: Client) -> None:
        self._publish()

    def _publish(self) -> None:
        """Publish the newest list, if the broker is there. When it comes, it gets the list."""
        if self._connection.is_there:
            self._connection.publish(self._topic, self._newest, is_retained=True)
