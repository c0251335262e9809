"""MQTT clients that connect again by themselves.

What they send is written at once; one thread reads for all of them.

With a thread for each, as `loop_start` of paho makes it, each message that a client sends would
wake its thread, and wait until that has let go of the interpreter.
"""

import sys
from collections.abc import Callable, Sequence
from select import select
from ssl import SSLSocket
from threading import Event, RLock, Thread
from time import monotonic
from typing import Any

from paho.mqtt.client import Client

# A broker takes a client for lost after 1.5 times this.
KEEPALIVE_SECONDS = 5
# Between two tries of a client to connect.
AGAIN_SECONDS = 1.0
# One try takes at most this long. Meanwhile nothing is read.
CONNECT_SECONDS = 2.0
# If the broker lets a client in and drops it at once, so often, the bridge says so.
MOST_DROPS = 3
# A socket that has just been opened is read after at most this long.
LOOK_SECONDS = 0.05
# Between two looks at what is due.
CARE_SECONDS = 0.5


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
        client.on_connect = self._connected
        client.on_disconnect = self._dropped
        self._client = client
        self._greet = greet
        self._lock = RLock()
        # Why the broker does not let it in.
        self._refusal = ""
        # Since when it is connected; 0: it is not.
        self._connected_since = 0.0
        # How often the broker has dropped it at once, one time after the other.
        self._drops = 0
        # When it tries to connect next.
        self.next_try = 0.0

    # paho gives both functions more than they need.

    def _connected(self, client: Client, _data: Any, _flags: Any, reason: Any, *_: Any) -> None:
        if reason.is_failure:
            self._refusal = f"refuses: {reason}"
        else:
            self._refusal = ""
            self._connected_since = monotonic()
            self._greet(client)

    def _dropped(self, _client: Client, _data: Any, _flags: Any, reason: Any, *_: Any) -> None:
        if self._connected_since:
            self._drops = 0 if self._is_steady else self._drops + 1
            self._connected_since = 0.0
        elif not self._refusal:
            self._refusal = f"gives no answer to vehicles that connect: {reason}"

    @property
    def _is_steady(self) -> bool:
        """Whether it has been connected for some time."""
        if not self._connected_since:
            return False
        return monotonic() - self._connected_since >= KEEPALIVE_SECONDS

    @property
    def is_there(self) -> bool:
        """Whether it is connected, so that it can send."""
        return bool(self._client.is_connected()) and self.socket is not None

    @property
    def trouble(self) -> str:
        """What is wrong with the broker, for people; '' for nothing."""
        if self._drops >= MOST_DROPS and not self._is_steady:
            return (
                "drops vehicles that it has just let in: does another bridge have their names, its"
                " --interface and its --manufacturer?"
            )
        return self._refusal

    def publish(
        self, topic: str, payload: bytes, quality: int = 0, is_retained: bool = False
    ) -> None:
        """Send a message. `quality`: 1 for at least once, 0 for at most once."""
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
        """Write what was not written at once."""
        with self._lock:
            self._client.loop_write()

    def read(self) -> None:
        """Read what has come, also what TLS has read from the socket already."""
        with self._lock:
            self._client.loop_read()
            while self._has_decrypted():
                self._client.loop_read()

    def _has_decrypted(self) -> bool:
        """Whether TLS has read more than was taken from it."""
        socket = self.socket
        return isinstance(socket, SSLSocket) and socket.pending() > 0

    def ping(self) -> None:
        """Send a ping if one is due."""
        with self._lock:
            self._client.loop_misc()

    def connect(self) -> None:
        """Connect. Raises OSError or ValueError if the broker is not there."""
        self.next_try = monotonic() + AGAIN_SECONDS
        with self._lock:
            self._client.reconnect()

    def give_up(self, why: Exception) -> None:
        """Close the socket: what came is not MQTT."""
        with self._lock:
            socket = self.socket
            if socket is not None:
                socket.close()
            self._connected_since = 0.0
            self._refusal = f"is not one of MQTT: {why!r}"


class Network:
    """Keeps all connections to the broker, and reads for them.

    It begins when it is opened. If another bridge drives the robots, this one must not take their
    places at the broker.
    """

    def __init__(self) -> None:
        self._connections: Sequence[Connection] = ()
        # What people were told last of the broker; '' that it is there, or nothing yet.
        self._reported = ""
        # When it looks at what is due, and when it tries to connect.
        self._next_look = 0.0
        self._next_try = 0.0
        self._is_open = False
        self._is_over = Event()
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
        """Say goodbye to the broker for all, and end the thread."""
        self._is_over.set()
        if self._is_open:
            self._thread.join()
        for connection in self._connections:
            connection.close()

    def _run(self) -> None:
        """Keep the connections, and read for them, until all is closed."""
        while not self._is_over.is_set():
            now = monotonic()
            if now >= self._next_look:
                self._next_look = now + CARE_SECONDS
                self._care(now)
            self._read_and_write()

    def _read_and_write(self) -> None:
        """Read what comes within a moment, and write what is left to write."""
        by_socket: dict[Any, Connection] = {}
        for connection in self._connections:
            socket = connection.socket
            if socket is not None:
                by_socket[socket] = connection
        to_write = [socket for socket in by_socket if by_socket[socket].has_to_write]
        try:
            readable, writable, _ = select(by_socket, to_write, [], LOOK_SECONDS)
        except (OSError, ValueError):
            # A write that failed in the other thread has closed one of them.
            return
        for socket in readable:
            self._read(by_socket[socket])
        for socket in writable:
            by_socket[socket].write()

    @staticmethod
    def _read(connection: Connection) -> None:
        """Read what has come for a connection.

        What a server that is no broker sends may raise any error in the client. The other
        connections must go on.
        """
        try:
            connection.read()
        except Exception as error:
            connection.give_up(error)

    def _care(self, now: float) -> None:
        """Look after all connections, and tell people what is wrong with the broker."""
        for connection in self._connections:
            if connection.socket is not None:
                connection.ping()
        trouble = self._connect(now) if now >= self._next_try else ""
        trouble = trouble or self._trouble()
        if trouble == self._reported:
            return
        if trouble:
            self._report(trouble, f"{trouble}; trying again")
        elif all(connection.is_there for connection in self._connections):
            self._report("", "is there")

    def _trouble(self) -> str:
        """Return what is wrong with the first connection that has trouble; '' if none has."""
        for connection in self._connections:
            trouble = connection.trouble
            if trouble:
                return trouble
        return ""

    def _report(self, trouble: str, predicate: str) -> None:
        """Tell people how the broker is. `predicate`: the rest of a sentence on it."""
        print(f"orchard-vda5050: the broker {predicate}", file=sys.stderr, flush=True)
        self._reported = trouble

    def _connect(self, now: float) -> str:
        """Connect those that are away, for as long as the others need not be read.

        While the broker is away, one of them tries it for all. Return why the broker is not there;
        '' if it is.
        """
        due = []
        for connection in self._connections:
            if connection.socket is None and now >= connection.next_try:
                due.append(connection)
        for connection in sorted(due, key=lambda connection: connection.next_try):
            if monotonic() - now > CARE_SECONDS:
                break
            try:
                connection.connect()
            except (OSError, ValueError) as error:
                # A name that cannot be one of a host raises ValueError.
                self._next_try = monotonic() + AGAIN_SECONDS
                return f"is not there: {error}"
        return ""
