"""MQTT clients that connect again by themselves. What they send is written at once; one thread reads for all of them.

With a thread for each, as `loop_start` of paho makes it, each message that a client sends would wake its thread, and wait until that has
let go of the interpreter.
"""

import sys
from collections.abc import Callable, Sequence
from select import select
from threading import Event, RLock, Thread
from time import monotonic
from typing import Any

from paho.mqtt.client import Client

KEEPALIVE_SECONDS = 5  # a broker takes a client for lost after 1.5 times this
AGAIN_SECONDS = 1.0  # between two tries to connect
LOOK_SECONDS = 0.05  # until a socket that has just been opened is read, at most
CARE_SECONDS = 0.5  # between two looks at what is due


class Connection:
    """The connection of a client. Vehicles write in one thread, the network reads in another one: a lock lets one at a time work on it."""

    def __init__(self, client: Client, host: str, port: int, greet: Callable[[Client], None]) -> None:
        """`greet`: called each time that it is connected."""
        client.connect_async(host, port, KEEPALIVE_SECONDS)
        client.on_connect = self._connected
        self._client, self._greet, self._lock = client, greet, RLock()
        self.refusal = ""  # why the broker does not let it in

    def _connected(self, client: Client, _data: Any, _flags: Any, reason: Any, _properties: Any) -> None:
        self.refusal = str(reason) if reason.is_failure else ""
        if not self.refusal:
            self._greet(client)

    @property
    def is_there(self) -> bool:
        return bool(self._client.is_connected())

    def publish(self, topic: str, payload: bytes, quality: int = 0, is_retained: bool = False) -> None:
        with self._lock:
            self._client.publish(topic, payload, quality, is_retained)

    def close(self) -> None:
        """Say goodbye to the broker."""
        with self._lock:
            self._client.disconnect()

    # -- for the thread of the network

    @property
    def socket(self) -> Any:
        """Its socket; None without one."""
        return self._client.socket()

    @property
    def has_to_write(self) -> bool:
        """Whether something is left that was not written at once."""
        return bool(self._client.want_write())

    def write(self) -> None:
        with self._lock:
            self._client.loop_write()

    def read(self) -> None:
        with self._lock:
            self._client.loop_read()
            while (socket := self.socket) is not None and getattr(socket, "pending", int)():  # what TLS has read already
                self._client.loop_read()

    def ping(self) -> None:
        """Send a ping if one is due."""
        with self._lock:
            self._client.loop_misc()

    def connect(self) -> None:
        """Raises OSError if the broker is not there."""
        with self._lock:
            self._client.reconnect()


class Network:
    """Keeps all connections to the broker, and reads for them."""

    def __init__(self) -> None:
        self._connections: Sequence[Connection] = ()
        self._told = ""
        self._due = self._again = 0.0  # when it looks at what is due, and when it tries to connect
        self._is_over = Event()
        self._thread = Thread(target=self._run, name="network", daemon=True)
        self._thread.start()

    def keep(self, connection: Connection) -> None:
        """Connect, and connect again, until all is closed."""
        self._connections = [*self._connections, connection]

    def close(self) -> None:
        self._is_over.set()
        self._thread.join()
        for connection in self._connections:
            connection.close()

    def _run(self) -> None:
        while not self._is_over.is_set():
            if (now := monotonic()) >= self._due:
                self._due = now + CARE_SECONDS
                self._care(now)
            open_ones = {socket: connection for connection in self._connections if (socket := connection.socket) is not None}
            waiting = [socket for socket, connection in open_ones.items() if connection.has_to_write]
            try:
                readable, writable, _ = select(open_ones, waiting, [], LOOK_SECONDS)
            except (OSError, ValueError):  # a write that failed in the other thread has closed one of them
                continue
            for socket in readable:
                open_ones[socket].read()
            for socket in writable:
                open_ones[socket].write()

    def _care(self, now: float) -> None:
        """Look after all connections. While the broker is away, one of them tries it for all."""
        may_connect, why = now >= self._again, ""
        for connection in self._connections:
            if connection.socket is not None:
                connection.ping()
            elif may_connect:
                try:
                    connection.connect()
                except OSError as error:
                    may_connect, self._again, why = False, now + AGAIN_SECONDS, f"is not there: {error}"
        why = why or next((f"refuses: {one.refusal}" for one in self._connections if one.refusal), "")
        if why != self._told and (why or all(one.is_there for one in self._connections)):
            said = f"{why}; trying again" if why else "is there"
            print(f"orchard-vda5050: the broker {said}", file=sys.stderr, flush=True)
            self._told = why
