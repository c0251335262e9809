"""A client of the Orchard: Zenoh and msgpack, as keyspace.md describes.

What arrives waits in one queue, in the order in which it came.

A tick has tens of messages, and to wake a thread costs more than to handle a message. So a message
that is heard `quietly` does not wake the reader. It waits for the next message that does, such as
the clock, which comes last in a tick.
"""

import ctypes
import json
from collections.abc import Iterator
from contextlib import contextmanager
from queue import Full, Queue
from threading import Lock, get_ident
from typing import Any, NamedTuple

import msgpack
import zenoh
from zenoh.handlers import Callback

from orchard_ros2.role import MADE_BY, Role

# The prefix of the keys, unless a run is started with another one.
PREFIX = "orchard"
# For this long it tries to connect.
CONNECT_MS = 2000
# A neighbour that is silent for this long counts as gone.
LEASE_MS = 2000
# For this long a query waits for its reply.
ASK_SECONDS = 5.0
# Between two looks at whether the session closes.
ROOM_SECONDS = 0.5
# Zenoh's error for a query without a reply in time.
TIMED_OUT = "Timeout"
# Messages that wait for the clock.
MOST_QUIET = 100
# Times that many messages wait in the queue. A run in lockstep waits for a slower client.
WAITING = 10

#: A key, and the payload there, or whether a liveliness token is there.
Arrived = tuple[str, bytes | bool]


class Refused(Exception):
    """The run is not there, or refuses a query. The text says why."""


class Heard(NamedTuple):
    """What has arrived: the parts of its key after the prefix, and its message.

    For a liveliness token the message is `{"up": bool}`.
    """

    key: tuple[str, ...]
    message: dict[str, Any]


class Client:
    """A session in the runs below a prefix."""

    def __init__(self, session: "zenoh.Session", prefix: str) -> None:
        """`prefix`: of all keys."""
        self._session = session
        self._prefix = prefix
        # Zenoh ends a subscription that nothing refers to.
        self._subscriptions: list[Any] = []
        self._queue: Queue[list[Arrived]] = Queue(WAITING)
        self._quiet: list[Arrived] = []
        # Zenoh calls from more than one thread.
        self._lock = Lock()
        self._zenoh_threads: set[int] = set()
        self._is_gone = False

    def hear(self, key: str, quietly: bool = False) -> None:
        """Subscribe to a key, in which * stands for any part, such as */pose.

        `quietly`: what arrives waits for the next message that is not quiet.
        """
        handler = Callback(self._arrived_quietly if quietly else self._arrived, indirect=False)
        subscription = self._session.declare_subscriber(f"{self._prefix}/{key}", handler)
        self._subscriptions.append(subscription)

    def watch(self, key: str) -> None:
        """Subscribe to a liveliness token."""
        handler = Callback(self._changed, indirect=False)
        liveliness = self._session.liveliness()
        subscription = liveliness.declare_subscriber(f"{self._prefix}/{key}", handler, history=True)
        self._subscriptions.append(subscription)

    def leave(self) -> None:
        """Take no more of what arrives."""
        self._is_gone = True

    def _arrived(self, sample: "zenoh.Sample") -> None:
        self._keep((str(sample.key_expr), sample.payload.to_bytes()))

    def _arrived_quietly(self, sample: "zenoh.Sample") -> None:
        self._keep((str(sample.key_expr), sample.payload.to_bytes()), MOST_QUIET)

    def _changed(self, sample: "zenoh.Sample") -> None:
        self._keep((str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT))

    def _keep(self, item: Arrived, enough: int = 1) -> None:
        """Keep what has arrived, in order, until there is enough to hand over.

        This runs in a thread of Zenoh.
        """
        self._settle()
        with self._lock:
            self._quiet.append(item)
            if len(self._quiet) >= enough:
                self._hand_over()

    def _hand_over(self) -> None:
        """Wait for room in the queue. The thread must come free when the session closes."""
        batch = self._quiet
        self._quiet = []
        while not self._is_gone:
            try:
                self._queue.put(batch, timeout=ROOM_SECONDS)
            except Full:
                continue
            return

    def _settle(self) -> None:
        """Keep the Python state of a thread of Zenoh.

        Else it is made and deleted at each call, which costs more than the message.
        """
        thread = get_ident()
        if thread not in self._zenoh_threads:
            self._zenoh_threads.add(thread)
            ctypes.pythonapi.PyGILState_Ensure()

    def arrivals(self) -> Iterator[Heard]:
        """Yield what arrives, without end. What is not msgpack is passed over."""
        while True:
            for key, payload in self._queue.get():
                message = {"up": payload} if isinstance(payload, bool) else unpacked(payload)
                if isinstance(message, dict):
                    parts = key.removeprefix(f"{self._prefix}/").split("/")
                    yield Heard(tuple(parts), message)

    def put(self, key: str, message: dict[str, Any]) -> None:
        """Publish a message that must not be lost."""
        payload = msgpack.packb(message)
        self._session.put(
            f"{self._prefix}/{key}", payload, congestion_control=zenoh.CongestionControl.BLOCK
        )

    def ask(self, key: str, message: dict[str, Any] | None = None) -> dict[str, Any]:
        """Return the reply to a query. Raises Refused."""
        payload = None if message is None else msgpack.packb(message)
        replies = self._session.get(
            f"{self._prefix}/{key}",
            payload=payload,
            timeout=ASK_SECONDS,
            target=zenoh.QueryTarget.ALL,
        )
        # The first reply; None if the query ends without one.
        reply = next(iter(replies), None)
        if reply is None:
            raise Refused(f"{self._prefix}/{key}: no reply: is the run under way?")
        if reply.ok is not None:
            return dict(unpacked(reply.ok.payload.to_bytes()))
        why = reply.err.payload.to_string() if reply.err is not None else ""
        if why == TIMED_OUT:
            why = f"{self._prefix}/{key}: no reply within {ASK_SECONDS:g} s"
        raise Refused(why)


def unpacked(payload: bytes) -> Any:
    """Return what is in a payload; None if it is not msgpack."""
    try:
        return msgpack.unpackb(payload)
    except ValueError:
        return None


@contextmanager
def connected(endpoint: str, prefix: str, role: Role | None = None) -> Iterator[Client]:
    """Open a session with the physics process or the router that listens at an endpoint.

    `role`: for a secured run.

    Raises Refused if none does (yet), ValueError if that is no endpoint, or not one for this role.
    """
    _check_endpoint(endpoint, prefix, role)
    config = _config(endpoint, role)
    try:
        session = zenoh.open(config)
    except zenoh.ZError:
        raise _why_not_open(endpoint, role) from None
    with session:
        client = Client(session, prefix)
        try:
            yield client
        finally:
            client.leave()


def _check_endpoint(endpoint: str, prefix: str, role: Role | None) -> None:
    """Raise ValueError for an endpoint, or a prefix, that does not fit the role."""
    is_secure = endpoint.startswith("tls/")
    if role is None and is_secure:
        raise ValueError(f"{endpoint}: tls needs certificates: -p secure:=DIR/NAME; {MADE_BY}")
    if role is not None and (not is_secure or prefix != PREFIX):
        raise ValueError(
            f"{endpoint}, prefix {prefix}: a secured run has an endpoint such as"
            f" tls/127.0.0.1:7447, and the prefix {PREFIX}"
        )


def _config(endpoint: str, role: Role | None) -> "zenoh.Config":
    """Return the settings of a session. Raises ValueError if that is no endpoint."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("connect/timeout_ms", str(CONNECT_MS))
    config.insert_json5("transport/link/tx/lease", str(LEASE_MS))
    if role is not None:
        for setting, value in role.settings().items():
            config.insert_json5(setting, json.dumps(value))
    try:
        config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    except zenoh.ZError:
        raise ValueError(f"endpoint {endpoint!r}: must be as tcp/127.0.0.1:7447") from None
    return config


def _why_not_open(endpoint: str, role: Role | None) -> Exception:
    """Return the error of a session that does not open: ValueError if it never will."""
    if role is None:
        return Refused(f"nothing answers at {endpoint}")
    why = role.why_no_trust(endpoint)
    if why:
        return ValueError(f"{endpoint}: {why}")
    return Refused(
        f"nothing at {endpoint} accepts the role {role.name} yet; does another process use it?"
    )
