"""Sending and receiving with Zenoh. Only this module imports zenoh.

All that arrives becomes an item in one inbox, in the order of arrival. Handlers only store the item and wake the reader, which does
the rest in its own thread. So no lock is needed, and none is held during a get, a reply or a drop.
"""

import ctypes
import json
import logging
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from math import inf
from threading import Lock, get_ident
from time import monotonic
from typing import Any, NamedTuple

import zenoh
from zenoh.handlers import Callback

from orchard.net.endpoints import IN_USE, LOOPBACK, NO_ENDPOINT, BusError, check_security, is_public, with_port
from orchard.security.identity import Identity, why_no_trust
from orchard.security.roles import AUTHORITY, CERTIFICATE, KEY

log = logging.getLogger("orchard.net.bus")

CONNECT_SECONDS = 7.0  # how long a client tries to connect to its router
LISTEN_SECONDS = 1.0  # how long a router tries to get its port
LEASE_MS = 2000  # a neighbour that is silent for this long counts as gone
MOST_SILENT = 10_000  # connections that have not said what they are; at the default of 100 no other client gets in for 10 s
FULL_QUEUE_US = 300_000  # how long the router waits for a neighbour that receives nothing, before it closes the link
GET_SECONDS = 10.0  # far above mailbox.DOUBT_SECONDS; zenoh keeps some 700 bytes of each get until then, answered or not
TIMED_OUT = "Timeout"  # zenoh's error for a get without an answer in time
_ASKING: dict[str, Any] = {
    "target": zenoh.QueryTarget.ALL,
    "consolidation": zenoh.ConsolidationMode.NONE,  # AUTO would hold the first reply back until the last
    "congestion_control": zenoh.CongestionControl.BLOCK,
}
_OTHERS = zenoh.Locality.REMOTE  # a session does not receive its own samples
_OPEN = "any client that reaches this address can drive every robot and end the run; --secure DIR admits only known clients"


# -- what arrives


class Sample(NamedTuple):
    """A payload that another session published on a key."""

    key: str
    payload: bytes


class Alive(NamedTuple):
    """A liveliness token appeared (`up`) or disappeared."""

    key: str
    up: bool


class Query:
    """A received query. Send any number of replies, then call `drop`; without it the querier waits until its timeout."""

    def __init__(self, key: str, query: zenoh.Query) -> None:
        self.key = key
        self.payload = b"" if query.payload is None else query.payload.to_bytes()
        self._query = query

    def reply(self, payload: bytes) -> None:
        with _errors_ignored("a reply"):
            self._query.reply(self.key, payload)

    def refuse(self, reason: str) -> None:
        """Send an error reply, and drop the query."""
        with _errors_ignored("a refusal"):
            self._query.reply_err(reason.encode())
        self.drop()

    def drop(self) -> None:
        with _errors_ignored("the end of a query"):
            self._query.drop()  # type: ignore[no-untyped-call]


class Replied(NamedTuple):
    """A reply to the query with a ticket; `error` is '' unless it is an error reply."""

    ticket: Any
    payload: bytes
    error: str


class Final(NamedTuple):
    """The end of the replies to the query with a ticket."""

    ticket: Any


class Signal(NamedTuple):
    """A signal that asks the process to stop."""

    number: int


Item = Sample | Alive | Query | Replied | Final | Signal


class Inbox:
    """The items that have arrived, in their order. Putting is safe in any thread and in a signal handler.

    Waking a thread costs more than handling a message. So a reader that needs several quiet items passes their number to `take`.
    """

    POLL = 0.05  # s between two checks of a reader that is not woken

    def __init__(self) -> None:
        self._items: deque[Item] = deque()
        self._unwoken = Lock()  # locked until the reader is woken; SimpleQueue.get may overlook its timeout (Python 3.11)
        self._unwoken.acquire()
        self._enough = 1
        self._settled: set[int] = set()  # thread ids

    def _settle(self) -> None:
        """Keep the Python state of a zenoh thread: to create and delete it at each call from that thread costs more than the message.

        A state that is ensured once more than it is released lives as long as its thread.
        """
        thread = get_ident()
        if thread not in self._settled:
            self._settled.add(thread)
            ctypes.pythonapi.PyGILState_Ensure()

    def forget(self) -> None:
        """Drop all that an earlier session has left here. Requests to end stay."""
        for _ in range(len(self._items)):
            if isinstance(item := self._items.popleft(), Signal):
                self._items.append(item)

    def __len__(self) -> int:
        return len(self._items)

    def put(self, item: Item) -> None:
        self._settle()
        self._items.append(item)
        self._wake()

    def put_quietly(self, item: Item) -> None:
        """Put an item, and wake the reader only if the inbox holds as many items as it waits for."""
        self._settle()
        self._items.append(item)
        if len(self._items) >= self._enough:
            self._wake()

    def _wake(self) -> None:
        """Wake the reader, or make its next wait end at once."""
        if self._unwoken.locked():
            with suppress(RuntimeError):  # another thread has just woken it
                self._unwoken.release()

    def take(self, seconds: float = inf, enough: int = 1) -> Item | None:
        """Return the next item, or None if none arrives in `seconds`; 0 does not wait. `enough`: quiet items that wake the reader."""
        self._enough = enough
        deadline = monotonic() + seconds
        while not self._items:
            left = deadline - monotonic()
            if left <= 0.0:
                return None
            self._unwoken.acquire(timeout=min(left, self.POLL))
        return self._items.popleft()


@contextmanager
def _errors_ignored(what: str) -> Iterator[None]:
    """Ignore errors of zenoh: a peer that is gone, or a session that closes, is no reason to stop."""
    try:
        yield
    except zenoh.ZError as error:
        log.debug("%s was not sent: %s", what, error)


# -- sending


class Bus:
    """A Zenoh session. All that it receives arrives in `inbox`."""

    def __init__(self, session: zenoh.Session, inbox: Inbox, endpoint: str) -> None:
        self.inbox, self.endpoint, self.id, self._session = inbox, endpoint, str(session.zid()), session
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._listeners: dict[str, zenoh.Publisher] = {}  # publishers that only check for subscribers
        self._kept: list[Any] = []  # declarations, which end when they are no longer referenced
        self._tokens: dict[str, zenoh.LivelinessToken] = {}

    # -- publish and query

    def publish(self, key: str, payload: bytes, newest_wins: bool = False) -> None:
        """Publish a payload: in order and without loss, waiting for slow subscribers.

        With `newest_wins` it does not wait, and a slow subscriber loses messages. The first message on a key decides for the key.
        """
        if key not in self._publishers:
            control = zenoh.CongestionControl.DROP if newest_wins else zenoh.CongestionControl.BLOCK
            self._publishers[key] = self._session.declare_publisher(key, congestion_control=control, allowed_destination=_OTHERS)
        try:
            self._publishers[key].put(payload)
        except zenoh.ZError as error:
            log.debug("%s was not sent: %s", key, error)

    def retire(self, key: str) -> None:
        """Remove the publisher of a key that will not be used again, or not for some time."""
        if (publisher := self._publishers.pop(key, None)) is not None:
            with _errors_ignored("the end of a publisher"):
                publisher.undeclare()  # type: ignore[no-untyped-call]

    def is_heard(self, keys: str) -> bool:
        """Whether another session subscribes to any of these keys."""
        if keys not in self._listeners:
            self._listeners[keys] = self._session.declare_publisher(keys, allowed_destination=_OTHERS)
        return bool(self._listeners[keys].matching_status.matching)  # type: ignore[attr-defined]  # zenoh's stub is wrong

    def ask(self, key: str, payload: bytes, ticket: Any, seconds: float = GET_SECONDS) -> None:
        """Send a query. Its replies and their end arrive in the inbox as Replied and Final with `ticket`. `seconds`: its timeout."""
        put = self.inbox.put
        handler: Callback[zenoh.Reply] = Callback(lambda reply: put(_replied(ticket, reply)), lambda: put(Final(ticket)), indirect=False)
        try:
            self._session.get(key, handler, payload=payload, timeout=seconds, **_ASKING)
        except zenoh.ZError as error:
            log.debug("the query of %s was not sent: %s", key, error)
            put(Final(ticket))

    # -- subscribe and answer

    def subscribe(self, keys: str, quietly: bool = False) -> None:
        """Subscribe to keys: each sample arrives as a Sample. `quietly`: samples are put with `Inbox.put_quietly`."""
        self._kept.append(self._session.declare_subscriber(keys, self._into(_sample, quietly)))

    def answer(self, key: str) -> None:
        """Declare a queryable on a key: each query arrives as a Query."""
        self._kept.append(self._session.declare_queryable(key, self._into(_question)))

    def watch(self, tokens: str) -> None:
        """Subscribe to liveliness tokens: each change arrives as an Alive, and so do the present tokens."""
        self._kept.append(self._session.liveliness().declare_subscriber(tokens, self._into(_alive), history=True))

    def declare_alive(self, token: str) -> None:
        """Declare a liveliness token, which lasts as long as the session, or until `withdraw`. Call it after all subscriptions."""
        self._tokens[token] = self._session.liveliness().declare_token(token)

    def withdraw(self, token: str) -> None:
        """Remove a liveliness token."""
        with _errors_ignored("the end of a token"):
            self._tokens.pop(token).undeclare()  # type: ignore[no-untyped-call]

    def _into(self, item_of: Callable[[Any], Item], quietly: bool = False) -> "Callback[Any]":
        put = self.inbox.put_quietly if quietly else self.inbox.put
        return Callback(lambda arrived: put(item_of(arrived)), indirect=False)


def _question(query: zenoh.Query) -> Query:
    """Convert a query. Its key is the one that the client asked, which may have wildcards, and not that of the queryable."""
    return Query(str(query.key_expr), query)


def _sample(sample: zenoh.Sample) -> Sample:
    return Sample(str(sample.key_expr), sample.payload.to_bytes())


def _alive(sample: zenoh.Sample) -> Alive:
    return Alive(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)


def _replied(ticket: Any, reply: zenoh.Reply) -> Replied:
    if reply.ok is not None:
        return Replied(ticket, reply.ok.payload.to_bytes(), "")
    return Replied(ticket, b"", reply.err.payload.to_bytes().decode(errors="replace") if reply.err else "no reply")


# -- sessions


@contextmanager
def router(endpoint: str = LOOPBACK, inbox: Inbox | None = None, identity: Identity | None = None) -> Iterator[Bus]:
    """Open a router session, and close it at the end. Without `identity` it admits all clients; with it, those that its rules name.

    For port 0 it takes a free port; `bus.endpoint` contains it. Raises BusError if it cannot listen.
    """
    endpoint = with_port(endpoint)
    if identity is None and is_public(endpoint):
        log.warning("%s: %s", endpoint, _OPEN)
    with _session("router", endpoint, 0.0, identity) as session:
        yield Bus(session, Inbox() if inbox is None else inbox, endpoint)


@contextmanager
def client(endpoint: str, inbox: Inbox | None = None, seconds: float | None = None, identity: Identity | None = None) -> Iterator[Bus]:
    """Open a client session, and close it at the end. Raises BusError if it reaches no router in `seconds`, CONNECT_SECONDS by default."""
    with _session("client", endpoint, CONNECT_SECONDS if seconds is None else seconds, identity) as session:
        yield Bus(session, Inbox() if inbox is None else inbox, endpoint)


@contextmanager
def _session(mode: str, endpoint: str, seconds: float, identity: Identity | None) -> Iterator[zenoh.Session]:
    check_security(endpoint, identity is not None)
    try:
        session = zenoh.open(_config(mode, endpoint, seconds, identity))
    except zenoh.ZError as error:
        raise BusError(_explain(mode, endpoint, seconds, identity, str(error))) from error
    try:
        yield session
    finally:
        try:
            session.close()  # type: ignore[no-untyped-call]
        except zenoh.ZError as error:
            log.warning("the session with %s did not close: %s", endpoint, error)


def _explain(mode: str, endpoint: str, seconds: float, identity: Identity | None, error: str) -> str:
    if "must be of the form" in error:
        return f"{endpoint}: {NO_ENDPOINT}"
    if mode == "router":
        return f"{endpoint}: {IN_USE}"
    fault = "" if identity is None else why_no_trust(endpoint, identity.folder)
    return f"{endpoint}: {fault or f'no router answers there; tried for {seconds:g} s'}"


def _config(mode: str, endpoint: str, seconds: float, identity: Identity | None) -> zenoh.Config:
    settings: dict[str, Any] = {
        "mode": mode,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": False,
        "transport/link/tx/lease": LEASE_MS,
    }
    if mode == "router":
        settings |= {"listen/endpoints": [endpoint], "listen/timeout_ms": int(LISTEN_SECONDS * 1000), "listen/exit_on_failure": True}
        settings["transport/link/tx/queue/congestion_control/block/wait_before_close"] = FULL_QUEUE_US
        settings["transport/unicast/accept_pending"] = MOST_SILENT
    else:
        settings |= {"connect/endpoints": [endpoint], "connect/timeout_ms": int(seconds * 1000), "connect/exit_on_failure": True}
        settings["connect/retry"] = {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 1.5}
    if identity is not None:
        settings |= _tls_settings(identity) | ({"access_control": identity.rules()} if mode == "router" else {})
    config = zenoh.Config()
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def _tls_settings(identity: Identity) -> dict[str, Any]:
    """The files with which both sides authenticate each other, and the session id that the rules name."""
    tls: dict[str, Any] = {"root_ca_certificate": str(identity.folder / AUTHORITY), "enable_mtls": True, "verify_name_on_connect": True}
    for side in ("listen", "connect"):
        tls |= {f"{side}_certificate": str(identity.folder / CERTIFICATE), f"{side}_private_key": str(identity.folder / KEY)}
    tls["close_link_on_expiration"] = True
    return {"id": identity.role.session} | {f"transport/link/tls/{key}": value for key, value in tls.items()}
