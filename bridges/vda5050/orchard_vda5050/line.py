"""The lines to fleet control: one MQTT client for each vehicle, because the broker speaks for each one that it loses.

A client connects again by itself. What is said while the broker is away is not kept: the next state says all.
"""

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import count
from queue import Empty, SimpleQueue
from typing import Any
from urllib.parse import urlsplit

import msgspec
from paho.mqtt.client import Client, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion

from orchard_vda5050.messages import Message, connection_of
from orchard_vda5050.older import older

VERSIONS: Mapping[str, Callable[[str, Message], Message]] = {"3.0.0": lambda _topic, message: message, "2.1.0": older}  # and its words
KEEPALIVE_SECONDS = 5  # a broker takes a client for lost after 1.5 times this
AGAIN_SECONDS = 1  # at least, between two tries to connect
AGAIN_MOST = 5  # at most
RETAINED = ("connection", "factsheet")
AT_LEAST_ONCE = 1  # quality of service of `connection`; of all others 0


@dataclass(frozen=True)
class Broker:
    """Where the broker is, and how to log in. `interface` and `manufacturer`: parts of the topics."""

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
    """Return the broker at a URL such as mqtt://user:password@127.0.0.1:1883. Raises ValueError for one that cannot be."""
    if version not in VERSIONS:
        raise ValueError(f"version {version}: there are {', '.join(VERSIONS)}")
    parts = urlsplit(url)
    if parts.scheme not in ("mqtt", "mqtts") or not parts.hostname or parts.path not in ("", "/"):
        raise ValueError(f"broker {url!r}: must be as mqtt://127.0.0.1:1883 or, with TLS, mqtts://user:password@broker.example:8883")
    if wrong := [word for word in (interface, manufacturer) if not word or set(word) & set("/+#$")]:
        raise ValueError(f"{wrong[0]!r}: a part of a topic needs characters, but none of / + # $")
    is_secure = parts.scheme == "mqtts"
    port = parts.port or (8883 if is_secure else 1883)
    return Broker(parts.hostname, port, is_secure, parts.username, parts.password, interface, manufacturer, version)


def _client(broker: Broker, name: str) -> Client:
    client = Client(CallbackAPIVersion.VERSION2, client_id=f"{broker.manufacturer}-{name}")
    client.username_pw_set(broker.user, broker.password)
    if broker.is_secure:
        client.tls_set()
    client.reconnect_delay_set(AGAIN_SECONDS, AGAIN_MOST)
    return client


def _begin(client: Client, broker: Broker) -> None:
    client.connect_async(broker.host, broker.port, KEEPALIVE_SECONDS)
    client.loop_start()


class Line:
    """A vehicle's port to fleet control. `subscribes`: the topics that it takes; `greets`: what it sends when it has connected."""

    def __init__(self, broker: Broker, serial: str, subscribes: Sequence[str], greets: Sequence[tuple[str, Message]]) -> None:
        self._broker, self._serial, self._subscribes, self._greets = broker, serial, subscribes, greets
        self._taken: SimpleQueue[tuple[str, bytes]] = SimpleQueue()
        self._numbers: dict[str, Any] = defaultdict(count)  # topic -> the headerIds
        self.state_header_id = 0
        self._client = _client(broker, serial)
        will = self._payload("connection", connection_of("CONNECTION_BROKEN"))
        self._client.will_set(broker.topic(serial, "connection"), will, AT_LEAST_ONCE, retain=True)
        self._client.on_connect, self._client.on_message = self._connected, self._arrived
        _begin(self._client, broker)

    def take(self) -> list[tuple[str, bytes]]:
        """Return what has come since the last call: topic and payload."""
        taken = []
        while True:
            try:
                taken.append(self._taken.get_nowait())
            except Empty:
                return taken

    def send(self, topic: str, message: Message) -> None:
        """Send a message, if the broker is there."""
        if self._client.is_connected():
            quality = AT_LEAST_ONCE if topic == "connection" else 0
            self._client.publish(self._broker.topic(self._serial, topic), self._payload(topic, message), quality, topic in RETAINED)

    def close(self) -> None:
        """Say goodbye, and close the line."""
        self.send("connection", connection_of("OFFLINE"))
        self._client.disconnect()
        self._client.loop_stop()

    def _payload(self, topic: str, message: Message) -> bytes:
        number = next(self._numbers[topic]) % 2**32
        if topic == "state":
            self.state_header_id = number
        at = datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
        header = {"headerId": number, "timestamp": at, "version": self._broker.version, "manufacturer": self._broker.manufacturer}
        body = VERSIONS[self._broker.version](topic, message)
        return msgspec.json.encode(header | {"serialNumber": self._serial} | body)

    def _connected(self, client: Client, *_: Any) -> None:
        for topic in self._subscribes:
            client.subscribe(self._broker.topic(self._serial, topic))
        for greeting in self._greets:
            self.send(*greeting)

    def _arrived(self, _client: Client, _data: Any, message: MQTTMessage) -> None:
        self._taken.put((message.topic.rsplit("/", 1)[1], bytes(message.payload)))


class Notices:
    """The line for the list of full bins that wait. It is no topic of VDA 5050: interface/calls, JSON, retained."""

    def __init__(self, broker: Broker) -> None:
        self._topic, self._newest = f"{broker.interface}/calls", b"[]"
        self._client = _client(broker, "calls")
        self._client.on_connect = lambda *_: self._publish()
        _begin(self._client, broker)

    def tell(self, waiting: list[Message]) -> None:
        """Publish the list."""
        self._newest = msgspec.json.encode(waiting)
        self._publish()

    def _publish(self) -> None:
        if self._client.is_connected():
            self._client.publish(self._topic, self._newest, retain=True)

    def close(self) -> None:
        self._client.disconnect()
        self._client.loop_stop()
