"""The lines to fleet control: one MQTT client for each vehicle, because the broker speaks for each
one that it loses.

What is said while the broker is away is not kept: the next state says all.
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

VERSIONS: Mapping[str, Callable[[str, Message], Message]] = {
    "3.0.0": lambda _topic, message: message,
    "2.1.0": older,
    "2.0.0": oldest,
}  # and its words
RETAINED = ("connection", "factsheet")
AT_LEAST_ONCE = 1  # quality of service of `connection`; of all others 0


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
    if parts.scheme not in ("mqtt", "mqtts") or not parts.hostname or parts.path not in ("", "/"):
        raise ValueError(
            f"broker {url!r}: must be as mqtt://127.0.0.1:1883 or, with TLS, mqtts://user:password@broker.example:8883"
        )
    if wrong := [word for word in (interface, manufacturer) if not word or set(word) & set("/+#$")]:
        raise ValueError(f"{wrong[0]!r}: a part of a topic needs characters, but none of / + # $")
    is_secure = parts.scheme == "mqtts"
    port = parts.port or (8883 if is_secure else 1883)
    user, password = (
        word if word is None else unquote(word) for word in (parts.username, parts.password)
    )
    return Broker(parts.hostname, port, is_secure, user, password, interface, manufacturer, version)


def _client(broker: Broker, name: str) -> Client:
    client = Client(
        CallbackAPIVersion.VERSION2, client_id=f"{broker.interface}-{broker.manufacturer}-{name}"
    )
    client.username_pw_set(broker.user, broker.password)
    if broker.is_secure:
        client.tls_set()
    return client


class Line:
    """A vehicle's port to fleet control.

    `subscribes`: the topics that it takes; `greets`: what it sends when it has connected.
    """

    def __init__(
        self,
        network: Network,
        broker: Broker,
        serial: str,
        subscribes: Sequence[str],
        greets: Sequence[tuple[str, Message]],
    ) -> None:
        self._network, self._broker, self._serial, self._subscribes, self._greets = (
            network,
            broker,
            serial,
            subscribes,
            greets,
        )
        self._taken: SimpleQueue[tuple[str, bytes]] = SimpleQueue()
        self._numbers: dict[str, Any] = defaultdict(count)  # topic -> the headerIds
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
        taken = []
        while True:
            try:
                taken.append(self._taken.get_nowait())
            except Empty:
                return taken

    def send(self, topic: str, message: Message) -> None:
        """Send a message, if the broker is there."""
        if self._connection.is_there:
            quality = AT_LEAST_ONCE if topic == "connection" else 0
            self._connection.publish(
                self._broker.topic(self._serial, topic),
                self._payload(topic, message),
                quality,
                topic in RETAINED,
            )

    def leave(self) -> None:
        """Say that the vehicle goes offline."""
        self.send("connection", connection_of("OFFLINE"))

    def _payload(self, topic: str, message: Message) -> bytes:
        number = next(self._numbers[topic]) % 2**32
        if topic == "state":
            self.state_header_id = number
        at = datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
        header = {
            "headerId": number,
            "timestamp": at,
            "version": self._broker.version,
            "manufacturer": self._broker.manufacturer,
        }
        body = VERSIONS[self._broker.version](topic, message)
        return msgspec.json.encode(header | {"serialNumber": self._serial} | body)

    def _greet(self, client: Client) -> None:
        for topic in self._subscribes:
            client.subscribe(self._broker.topic(self._serial, topic))
        for greeting in self._greets:
            self.send(*greeting)

    def _arrived(self, _client: Client, _data: Any, message: MQTTMessage) -> None:
        self._taken.put((message.topic.rsplit("/", 1)[1], bytes(message.payload)))


class Notices:
    """The line for the list of full bins that wait.

    It is no topic of VDA 5050: interface/calls, JSON, retained.
    """

    def __init__(self, network: Network, broker: Broker) -> None:
        self._topic, self._newest = f"{broker.interface}/calls", b"[]"
        self._connection = Connection(
            _client(broker, "calls"), broker.host, broker.port, lambda _: self._publish()
        )
        network.keep(self._connection)

    def tell(self, waiting: list[Message]) -> None:
        """Publish the list."""
        self._newest = msgspec.json.encode(waiting)
        self._publish()

    def _publish(self) -> None:
        if self._connection.is_there:
            self._connection.publish(self._topic, self._newest, is_retained=True)
