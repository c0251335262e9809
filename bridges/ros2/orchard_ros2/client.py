"""A client of the Orchard: Zenoh and msgpack, as keyspace.md describes.

What arrives waits in one queue, in the order in which it came.

Of a tick there are tens of messages, and to wake a thread costs more than to handle one. So a
message that is heard `quietly` waits for the next one that is not, as the clock, which comes last.
"""

import ctypes
import json
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from queue import Full, Queue
from threading import Lock, get_ident
from typing import Any, NamedTuple

import msgpack
import zenoh
from zenoh.handlers import Callback

from orchard_ros2.role import MADE_BY, Role

PREFIX = "orchard"  # of the keys, if a run is not told another one
CONNECT_MS = 2000  # how long it tries to connect
LEASE_MS = 2000  # a neighbour that is silent for this long counts as gone
ASK_SECONDS = 5.0  # how long a query waits for its reply
ROOM_SECONDS = 0.5  # between two looks at whether the session closes
TIMED_OUT = "Timeout"  # zenoh's error for a query without a reply in time
MOST_QUIET = 100  # messages that wait for the clock
WAITING = (
    10  # times MOST_QUIET messages; a run in lockstep waits for a client that is slower than it
)

Arrived = tuple[
    str, bytes | bool
]  # the key, and the payload, or whether a liveliness token is there


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
        self._session, self._prefix, self._declared = session, prefix, []  # type: ignore[var-annotated]
        self._queue: Queue[list[Arrived]] = Queue(WAITING)
        self._quiet: list[Arrived] = []
        self._lock = Lock()  # Zenoh calls from more than one thread
        self._settled: set[int] = set()  # the ids of Zenoh's threads
        self._is_gone = False

    def hear(self, key: str, quietly: bool = False) -> None:
        """Subscribe to a key, in which * stands for any part, such as */pose.

        `quietly`: with the next one that is not.
        """
        handler = Callback(self._arrived_quietly if quietly else self._arrived, indirect=False)
        self._declared.append(self._session.declare_subscriber(f"{self._prefix}/{key}", handler))

    def watch(self, key: str) -> None:
        """Subscribe to a liveliness token."""
        liveliness = self._session.liveliness()
        self._declared.append(
            liveliness.declare_subscriber(
                f"{self._prefix}/{key}", Callback(self._changed, indirect=False), history=True
            )
        )

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

        Zenoh's thread is here.
        """
        self._settle()
        with self._lock:
            self._quiet.append(item)
            if len(self._quiet) >= enough:
                self._hand_over()

    def _hand_over(self) -> None:
        """Wait for room in the queue. The thread must come free when the session closes."""
        together, self._quiet = self._quiet, []
        while not self._is_gone:
            with suppress(Full):
                return self._queue.put(together, timeout=ROOM_SECONDS)

    def _settle(self) -> None:
        """Keep the Python state of a Zenoh thread, which else is made and deleted at each call:
        that costs more than the message.
        """
        if (thread := get_ident()) not in self._settled:
            self._settled.add(thread)
            ctypes.pythonapi.PyGILState_Ensure()

    def arrivals(self) -> Iterator[Heard]:
        """Yield what arrives, without end. What is not msgpack is passed over."""
        while True:
            for key, payload in self._queue.get():
                message = {"up": payload} if isinstance(payload, bool) else unpacked(payload)
                if isinstance(message, dict):
                    yield Heard(tuple(key.removeprefix(f"{self._prefix}/").split("/")), message)

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
        reply = next(iter(replies), None)
        if reply is None:
            raise Refused(f"{self._prefix}/{key}: no reply: is the run under way?")
        if reply.ok is not None:
            return dict(unpacked(reply.ok.payload.to_bytes()))
        why = reply.err.payload.to_string() if reply.err is not None else ""
        raise Refused(
            f"{self._prefix}/{key}: no reply within {ASK_SECONDS:g} s" if why == TIMED_OUT else why
        )


def unpacked(payload: bytes) -> Any:
    """Return what is in a payload; nil if it is not msgpack."""
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
    if role is None and endpoint.startswith("tls/"):
        raise ValueError(f"{endpoint}: tls needs certificates: -p secure:=DIR/NAME; {MADE_BY}")
    if role is not None and (not endpoint.startswith("tls/") or prefix != PREFIX):
        raise ValueError(
            f"{endpoint}, prefix {prefix}: a secured run has an endpoint such as"
            f" tls/127.0.0.1:7447, and the prefix {PREFIX}"
        )
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("connect/timeout_ms", str(CONNECT_MS))
    config.insert_json5("transport/link/tx/lease", str(LEASE_MS))
    for setting, value in (role.settings() if role else {}).items():
        config.insert_json5(setting, json.dumps(value))
    try:
        config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    except zenoh.ZError:
        raise ValueError(f"endpoint {endpoint!r}: must be as tcp/127.0.0.1:7447") from None
    try:
        session = zenoh.open(config)
    except zenoh.ZError:
        if role is None:
            raise Refused(f"nothing answers at {endpoint}") from None
        if why := role.why_no_trust(endpoint):
            raise ValueError(f"{endpoint}: {why}") from None
        raise Refused(
            f"nothing at {endpoint} accepts the role {role.name} yet; does another process use it?"
        ) from None
    with session:
        client = Client(session, prefix)
        try:
            yield client
        finally:
            client.leave()
