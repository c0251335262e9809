"""The Zenoh side of sending and hearing. The one place for zenoh.

Whatever arrives becomes an item in one inbox, in the order of its arrival: handlers store and signal, and everything else
happens in the thread that reads the inbox. So no lock is needed, and none is held over a get, a reply or a drop.
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
from orchard.security.identity import Identity
from orchard.security.roles import AUTHORITY, CERTIFICATE, KEY

log = logging.getLogger("orchard.net.bus")

CONNECT_SECONDS = 7.0  # for how long a client looks for its router
LISTEN_SECONDS = 1.0  # for how long a router tries to get its port
LEASE_MS = 2000  # after which a silent neighbour counts as gone
FULL_QUEUE_US = 300_000  # how long the router waits for a neighbour that takes nothing before it cuts it off
GET_SECONDS = 10.0  # far longer than a reader waits before it doubts; zenoh remembers every get until then, some 700 bytes, answered or not


TIMED_OUT = "Timeout"  # the error with which zenoh ends a get that nobody has answered in time
_ASKING: dict[str, Any] = {
    "target": zenoh.QueryTarget.ALL,
    "consolidation": zenoh.ConsolidationMode.NONE,  # AUTO would hold the first reply back until the last
    "congestion_control": zenoh.CongestionControl.BLOCK,
}


_OTHERS = zenoh.Locality.REMOTE  # a session does not hear itself
_OPEN = "whoever reaches this address may drive every robot and end the run; --secure DIR lets in only whom you know"


# -- what arrives


class Sample(NamedTuple):
    """Somebody put a payload on a key."""

    key: str
    payload: bytes


class Alive(NamedTuple):
    """A liveliness token came or went."""

    key: str
    up: bool


class Query:
    """A query that waits: any number of replies, then `drop`, or the asker waits out its time-out."""

    def __init__(self, key: str, query: zenoh.Query) -> None:
        self.key = key
        self.payload = b"" if query.payload is None else query.payload.to_bytes()
        self._query = query

    def reply(self, payload: bytes) -> None:
        with _shrugging("a reply"):
            self._query.reply(self.key, payload)

    def refuse(self, reason: str) -> None:
        """An error reply, and the end."""
        with _shrugging("a refusal"):
            self._query.reply_err(reason.encode())
        self.drop()

    def drop(self) -> None:
        with _shrugging("the end of a query"):
            self._query.drop()  # type: ignore[no-untyped-call]


class Replied(NamedTuple):
    """A reply to what was asked with a ticket; error is '' unless it is an error reply."""

    ticket: Any
    payload: bytes
    error: str


class Final(NamedTuple):
    """No more replies will come for a ticket."""

    ticket: Any


class Signal(NamedTuple):
    """The process is asked to stop."""

    number: int


Item = Sample | Alive | Query | Replied | Final | Signal


class Inbox:
    """Everything that arrives, in its order. Putting is safe in any thread and in a signal handler.

    Waking a thread costs more than handling a message, so a reader that can do nothing before several quiet items are
    there says how many it waits for.
    """

    POLL = 0.05  # s, after which a reader looks by itself

    def __init__(self) -> None:
        self._items: deque[Item] = deque()
        self._silence = Lock()  # held by the reader while nobody rings; a SimpleQueue's get may overlook its time-out (Python 3.11)
        self._silence.acquire()
        self._enough = 1
        self._settled: set[int] = set()  # threads

    def _settle(self) -> None:
        """Let a thread of zenoh's keep its Python state.

        Python makes one whenever such a thread calls it, with memory of its own, and undoes it afterwards: that costs more than
        the message. A state that is asked for once more than it is given back stays for as long as its thread.
        """
        thread = get_ident()
        if thread not in self._settled:
            self._settled.add(thread)
            ctypes.pythonapi.PyGILState_Ensure()

    def __len__(self) -> int:
        return len(self._items)

    def put(self, item: Item) -> None:
        self._settle()
        self._items.append(item)
        self._ring()

    def put_quietly(self, item: Item) -> None:
        """Put without waking the reader, unless that is enough for it."""
        self._settle()
        self._items.append(item)
        if len(self._items) >= self._enough:
            self._ring()

    def _ring(self) -> None:
        """Wake the reader, or let it not fall asleep; rung once is enough."""
        if self._silence.locked():
            with suppress(RuntimeError):  # another thread has just rung
                self._silence.release()

    def take(self, seconds: float = inf, enough: int = 1) -> Item | None:
        """The next item; None if none comes in time. At once with 0 seconds."""
        self._enough = enough
        deadline = monotonic() + seconds
        while not self._items:
            left = deadline - monotonic()
            if left <= 0.0:
                return None
            self._silence.acquire(timeout=min(left, self.POLL))
        return self._items.popleft()


@contextmanager
def _shrugging(what: str) -> Iterator[None]:
    """What concerns a peer that is gone, or a session that is closing, is no reason to stop."""
    try:
        yield
    except zenoh.ZError as error:
        log.debug("%s was not sent: %s", what, error)


# -- sending


class Bus:
    """One session: what it sends, and what it wants to hear in its inbox."""

    def __init__(self, session: zenoh.Session, inbox: Inbox, endpoint: str) -> None:
        self.inbox = inbox
        self.endpoint = endpoint
        self.id = str(session.zid())
        self._session = session
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._listeners: dict[str, zenoh.Publisher] = {}  # publishers that only look who listens
        self._kept: list[Any] = []  # what zenoh forgets when nobody refers to it

    # put and get

    def publish(self, key: str, payload: bytes, newest_wins: bool = False) -> None:
        """Never lost, in order: a subscriber that is slow is waited for; or, if the newest wins, it gets what it can take.

        Which of both it is, is settled by the first message on a key.
        """
        if key not in self._publishers:
            control = zenoh.CongestionControl.DROP if newest_wins else zenoh.CongestionControl.BLOCK
            self._publishers[key] = self._session.declare_publisher(key, congestion_control=control, allowed_destination=_OTHERS)
        try:
            self._publishers[key].put(payload)
        except zenoh.ZError as error:
            log.debug("%s was not sent: %s", key, error)

    def retire(self, key: str) -> None:
        """Nothing more is to be published on a key, or not for long."""
        if (publisher := self._publishers.pop(key, None)) is not None:
            with _shrugging("the end of a publisher"):
                publisher.undeclare()  # type: ignore[no-untyped-call]

    def is_heard(self, keys: str) -> bool:
        """Whether another session listens to any of these keys."""
        if keys not in self._listeners:
            self._listeners[keys] = self._session.declare_publisher(keys, allowed_destination=_OTHERS)
        return bool(self._listeners[keys].matching_status.matching)  # type: ignore[attr-defined]  # zenoh's stub is wrong

    def ask(self, key: str, payload: bytes, ticket: Any, seconds: float = GET_SECONDS) -> None:
        """One get; its replies and its end arrive in the inbox with the ticket."""
        put = self.inbox.put
        handler: Callback[zenoh.Reply] = Callback(lambda reply: put(_replied(ticket, reply)), lambda: put(Final(ticket)), indirect=False)
        try:
            self._session.get(key, handler, payload=payload, timeout=seconds, **_ASKING)
        except zenoh.ZError as error:
            log.debug("%s was not asked: %s", key, error)
            put(Final(ticket))

    # what to hear

    def subscribe(self, keys: str, quietly: bool = False) -> None:
        """Hear what is put on these keys; quietly, if something else wakes the reader when it is time."""
        put = self.inbox.put_quietly if quietly else self.inbox.put
        handler: Callback[zenoh.Sample] = Callback(lambda sample: put(_sample(sample)), indirect=False)
        self._kept.append(self._session.declare_subscriber(keys, handler))

    def answer(self, key: str) -> None:
        """Be asked on a key: each query arrives as a Query."""
        self._kept.append(self._session.declare_queryable(key, self._into(lambda query: _question(key, query))))

    def watch(self, tokens: str) -> None:
        """Hear of liveliness tokens, those included that are there already."""
        self._kept.append(self._session.liveliness().declare_subscriber(tokens, self._into(_alive), history=True))

    def declare_alive(self, token: str) -> None:
        """Tell that this process is here, until it is not. After all that it wants to hear."""
        self._kept.append(self._session.liveliness().declare_token(token))

    def _into(self, item_of: Callable[[Any], Item]) -> "Callback[Any]":
        put = self.inbox.put
        return Callback(lambda arrived: put(item_of(arrived)), indirect=False)


def _question(key: str, query: zenoh.Query) -> Query:
    """A query on a key, or on one of many keys that are answered together."""
    return Query(str(query.key_expr) if "*" in key else key, query)


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
    """A session that routes for others: for everybody, or as an identity for those whom its rules name.

    Port 0 takes a free one; `bus.endpoint` tells which.
    """
    endpoint = with_port(endpoint)
    if identity is None and is_public(endpoint):
        log.warning("%s: %s", endpoint, _OPEN)
    with _session("router", endpoint, 0.0, identity) as session:
        yield Bus(session, Inbox() if inbox is None else inbox, endpoint)


@contextmanager
def client(endpoint: str, inbox: Inbox | None = None, seconds: float | None = None, identity: Identity | None = None) -> Iterator[Bus]:
    """A session that talks through a router, for which it looks that long."""
    with _session("client", endpoint, CONNECT_SECONDS if seconds is None else seconds, identity) as session:
        yield Bus(session, Inbox() if inbox is None else inbox, endpoint)


@contextmanager
def _session(mode: str, endpoint: str, seconds: float, identity: Identity | None) -> Iterator[zenoh.Session]:
    session = _open(mode, endpoint, seconds, identity)
    try:
        yield session
    finally:
        try:
            session.close()  # type: ignore[no-untyped-call]
        except zenoh.ZError as error:
            log.warning("the session with %s did not close: %s", endpoint, error)


def _open(mode: str, endpoint: str, seconds: float, identity: Identity | None) -> zenoh.Session:
    check_security(endpoint, identity is not None)
    try:
        return zenoh.open(_config(mode, endpoint, seconds, identity))
    except zenoh.ZError as error:
        raise BusError(_explain(mode, endpoint, seconds, identity, str(error))) from error


def _explain(mode: str, endpoint: str, seconds: float, identity: Identity | None, error: str) -> str:
    if "must be of the form" in error:
        return f"{endpoint}: {NO_ENDPOINT}"
    if mode == "router":
        return f"{endpoint}: {IN_USE}"
    return f"{endpoint}: {_distrust(endpoint, identity) or f'nobody listens there; tried for {seconds:g} s'}"


def _distrust(endpoint: str, identity: Identity | None) -> str:
    if identity is None:
        return ""
    from orchard.security.handshake import why_no_trust  # late: Python's ssl takes a tenth of a process' start, and only this needs it

    return why_no_trust(endpoint, identity.folder)


def _config(mode: str, endpoint: str, seconds: float, identity: Identity | None) -> zenoh.Config:
    settings = {
        "mode": mode,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": False,
        "transport/link/tx/lease": LEASE_MS,
    }
    settings |= _listening(endpoint) if mode == "router" else _connecting(endpoint, seconds)
    if identity is not None:
        settings |= _proving(identity) | (_guarding(identity) if mode == "router" else {})
    config = zenoh.Config()
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def _listening(endpoint: str) -> dict[str, Any]:
    return {
        "listen/endpoints": [endpoint],
        "listen/timeout_ms": int(LISTEN_SECONDS * 1000),
        "listen/exit_on_failure": True,
        "transport/link/tx/queue/congestion_control/block/wait_before_close": FULL_QUEUE_US,
    }


def _connecting(endpoint: str, seconds: float) -> dict[str, Any]:
    return {
        "connect/endpoints": [endpoint],
        "connect/timeout_ms": int(seconds * 1000),
        "connect/exit_on_failure": True,
        "connect/retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 1.5},
    }


def _proving(identity: Identity) -> dict[str, Any]:
    """By which files each side knows the other, and the session id that the rules name."""
    tls: dict[str, Any] = {"root_ca_certificate": str(identity.folder / AUTHORITY), "enable_mtls": True, "verify_name_on_connect": True}
    for side in ("listen", "connect"):
        tls |= {f"{side}_certificate": str(identity.folder / CERTIFICATE), f"{side}_private_key": str(identity.folder / KEY)}
    tls["close_link_on_expiration"] = True
    return {"id": identity.role.session} | {f"transport/link/tls/{key}": value for key, value in tls.items()}


def _guarding(identity: Identity) -> dict[str, Any]:
    """Who may do what, at a router."""
    return {"access_control": identity.rules()}
