"""MQTT clients that connect again by themselves.

What they send is written at once; one thread reads for all of them.

With a thread for each, as `loop_start` of paho makes it, each message that a client sends would
wake its thread, and wait until that has let go of the interpreter.
"""

import sys
from collections.abc import Callable, Sequence
from select import select
from threading import Event, RLock, Thread
from time import monotonic
from typing import Any

from paho.mqtt.client import Client

KEEPALIVE_SECONDS = 5  # a broker takes a client for lost after 1.5 times this
AGAIN_SECONDS = 1.0  # between two tries of a client to connect
CONNECT_SECONDS = 2.0  # that one try takes, at most: meanwhile nothing is read
MOST_DROPS = (
    3  # times that the broker lets a client in and drops it at once, after which that is told
)
LOOK_SECONDS = 0.05  # until a socket that has just been opened is read, at most
CARE_SECONDS = 0.5  # between two looks at what is due


class Connection:
    """The connection of a client.

    Vehicles write in one thread, the network reads in another one: a lock lets one at a time work
    on it.
    """

    def __init__(
        self, client: Client, host: str, port: int, greet: Callable[[Client], None]
    ) -> None:
        """`greet`: called each time that it is connected."""
        client.connect_timeout = CONNECT_SECONDS
        client.connect_async(host, port, KEEPALIVE_SECONDS)
        client.on_connect, client.on_disconnect = self._connected, self._dropped
        self._client, self._greet, self._lock = client, greet, RLock()
        self._refusal = ""  # why the broker does not let it in
        self._since, self._drops = (
            0.0,
            0,
        )  # since when it is there, 0: it is not; how often it was dropped at once
        self.again = 0.0  # when it tries to connect

    def _connected(
        self, client: Client, _data: Any, _flags: Any, reason: Any, _properties: Any
    ) -> None:
        if reason.is_failure:
            self._refusal = f"refuses: {reason}"
        else:
            self._refusal, self._since = "", monotonic()
            self._greet(client)

    def _dropped(
        self, _client: Client, _data: Any, _flags: Any, reason: Any, _properties: Any
    ) -> None:
        if self._since:
            self._drops = self._drops + 1 if monotonic() - self._since < KEEPALIVE_SECONDS else 0
            self._since = 0.0
        elif not self._refusal:
            self._refusal = f"gives no answer to vehicles that connect: {reason}"

    @property
    def is_there(self) -> bool:
        return bool(self._client.is_connected()) and self.socket is not None

    @property
    def trouble(self) -> str:
        """What is wrong with the broker, for people; '' for nothing."""
        is_steady = self._since and monotonic() - self._since >= KEEPALIVE_SECONDS
        if self._drops >= MOST_DROPS and not is_steady:
            return (
                "drops vehicles that it has just let in: does another bridge have their names, its"
                " --interface and its --manufacturer?"
            )
        return self._refusal

    def publish(
        self, topic: str, payload: bytes, quality: int = 0, is_retained: bool = False
    ) -> None:
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
        socket = self._client.socket()
        return socket if socket is not None and socket.fileno() >= 0 else None

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
            while (socket := self.socket) is not None and getattr(
                socket, "pending", int
            )():  # what TLS has read already
                self._client.loop_read()

    def ping(self) -> None:
        """Send a ping if one is due."""
        with self._lock:
            self._client.loop_misc()

    def connect(self) -> None:
        """Raises OSError or ValueError if the broker is not there."""
        self.again = monotonic() + AGAIN_SECONDS
        with self._lock:
            self._client.reconnect()

    def give_up(self, why: Exception) -> None:
        """Close the socket: what came is not MQTT."""
        with self._lock:
            if (socket := self.socket) is not None:
                socket.close()
            self._since, self._refusal = 0.0, f"is not one of MQTT: {why!r}"


class Network:
    """Keeps all connections to the broker, and reads for them.

    It begins when it is opened: a bridge whose robots are driven by another one must not take their
    places at the broker.
    """

    def __init__(self) -> None:
        self._connections: Sequence[Connection] = ()
        self._told = ""
        self._due = self._again = 0.0  # when it looks at what is due, and when it tries to connect
        self._is_open, self._is_over = False, Event()
        self._thread = Thread(target=self._run, name="network", daemon=True)

    def open(self) -> None:
        """Begin to connect, if it has not begun."""
        if not self._is_open:
            self._is_open = True
            self._thread.start()

    def keep(self, connection: Connection) -> None:
        """Connect, and connect again, until all is closed."""
        self._connections = [*self._connections, connection]

    def close(self) -> None:
        self._is_over.set()
        if self._is_open:
            self._thread.join()
        for connection in self._connections:
            connection.close()

    def _run(self) -> None:
        while not self._is_over.is_set():
            if (now := monotonic()) >= self._due:
                self._due = now + CARE_SECONDS
                self._care(now)
            open_ones = {
                socket: connection
                for connection in self._connections
                if (socket := connection.socket) is not None
            }
            waiting = [
                socket for socket, connection in open_ones.items() if connection.has_to_write
            ]
            try:
                readable, writable, _ = select(open_ones, waiting, [], LOOK_SECONDS)
            except (
                OSError,
                ValueError,
            ):  # a write that failed in the other thread has closed one of them
                continue
            for socket in readable:
                self._read(open_ones[socket])
            for socket in writable:
                open_ones[socket].write()

    @staticmethod
    def _read(connection: Connection) -> None:
        """What a server that is no broker sends may raise any error in the client: the others must
        go on.
        """
        try:
            connection.read()
        except Exception as error:
            connection.give_up(error)

    def _care(self, now: float) -> None:
        """Look after all connections."""
        for connection in self._connections:
            if connection.socket is not None:
                connection.ping()
        why = self._connect(now) if now >= self._again else ""
        why = why or next((one.trouble for one in self._connections if one.trouble), "")
        if why != self._told and (why or all(one.is_there for one in self._connections)):
            said = f"{why}; trying again" if why else "is there"
            print(f"orchard-vda5050: the broker {said}", file=sys.stderr, flush=True)
            self._told = why

    def _connect(self, now: float) -> str:
        """Connect those that are away, for as long as the others need not be read.

        While the broker is away, one of them tries it for all.

        Return why it is not there; '' if it is.
        """
        away = [one for one in self._connections if one.socket is None and now >= one.again]
        for connection in sorted(away, key=lambda one: one.again):
            if monotonic() - now > CARE_SECONDS:
                break
            try:
                connection.connect()
            except (
                OSError,
                ValueError,
            ) as error:  # ValueError: a name that cannot be one of a host
                self._again = monotonic() + AGAIN_SECONDS
                return f"is not there: {error}"
        return ""
