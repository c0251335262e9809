"""The bus over Zenoh. Only this module imports zenoh.

Handlers only store what arrives and wake the reader. So no lock is needed, and none is held during
a get, a reply or a drop.
"""

import json
import logging
import os
import re
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, suppress
from functools import cache
from typing import Any

import zenoh
from zenoh.handlers import Callback

from orchard.field.problems import printable
from orchard.net.bus import GET_SECONDS, Alive, Bus, Final, Inbox, Item, Query, Replied, Sample
from orchard.net.endpoints import (
    IN_USE,
    LOOPBACK,
    NO_ENDPOINT,
    ONE_THREAD,
    RUNTIME,
    BusError,
    check_security,
    is_public,
    with_port,
)
from orchard.security.identity import Identity, why_no_trust
from orchard.security.roles import AUTHORITY, CERTIFICATE, KEY

log = logging.getLogger("orchard.net.zenoh_bus")

# CONTRIBUTING.md has the facts of Zenoh from which these follow.
# s that a client tries to connect to its router.
CONNECT_SECONDS = 7.0
# s that a router tries to get its port.
LISTEN_SECONDS = 1.0
# ms after which a silent neighbour counts as gone.
LEASE_MS = 2000
# Connections that have not said yet what they are. With Zenoh's default, 100, a client that opens
# so many keeps all others out for 10 s.
MOST_SILENT = 10_000
# Microseconds that the router waits for a neighbour that receives nothing, before it closes the
# link.
FULL_QUEUE_US = 300_000
# How a query is sent. Any client may reply, so all queryables are asked.
_ASKING: dict[str, Any] = {
    "target": zenoh.QueryTarget.ALL,
    # AUTO would hold the first reply back until the last.
    "consolidation": zenoh.ConsolidationMode.NONE,
    "congestion_control": zenoh.CongestionControl.BLOCK,
}
# Characters of a panic of Zenoh, which is in Rust, that are shown.
MOST_WORDS = 300
# Settings of a session that connects to nothing.
_ALONE: dict[str, Any] = {
    "mode": "peer",
    "listen/endpoints": [],
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
}
# In a value of ZENOH_RUNTIME, which is in RON (Rust Object Notation): a number of threads that is
# 0, in any base, with which nothing can be received.
NO_THREADS = re.compile(r"(worker_threads|max_blocking_threads)\s*:\s*0[xob]?[0_]*\s*[,)]")
# The comments of RON, which may hide it.
COMMENTS = re.compile(r"/\*.*?\*/|//[^\n]*", re.DOTALL)
# A session does not receive its own samples.
_OTHERS = zenoh.Locality.REMOTE
_OPEN = (
    "any client that reaches this address can drive every robot and end the run; "
    "--secure DIR admits only known clients"
)


@contextmanager
def _errors_ignored(what: str) -> Iterator[None]:
    """Ignore errors of zenoh in this context. `what`: what is sent, for the log.

    That a peer is gone, or a session closes, is no reason to stop.
    """
    try:
        yield
    except zenoh.ZError as error:
        log.debug("%s was not sent: %s", what, error)


class ZenohQuery(Query):
    """A question of a client, answered by Zenoh."""

    def __init__(self, query: zenoh.Query) -> None:
        # The key that the client has asked, which may have wildcards.
        self.key = str(query.key_expr)
        if query.payload is None:
            self.payload = b""
        else:
            self.payload = query.payload.to_bytes()
        self._query = query

    def reply(self, payload: bytes) -> None:
        with _errors_ignored("a reply"):
            self._query.reply(self.key, payload)

    def refuse(self, reason: str) -> None:
        with _errors_ignored("a refusal"):
            self._query.reply_err(reason.encode())
        self.drop()

    def drop(self) -> None:
        with _errors_ignored("the end of a query"):
            self._query.drop()  # type: ignore[no-untyped-call]


# -- sending


class ZenohBus(Bus):
    """A Zenoh session."""

    def __init__(self, session: zenoh.Session, inbox: Inbox, endpoint: str) -> None:
        self.inbox = inbox
        self.endpoint = endpoint
        self.id = str(session.zid())
        self._session = session
        self.executor = ThreadPoolExecutor(max_workers=1)
        self._publishers: dict[str, zenoh.Publisher] = {}
        # Publishers that publish nothing: they tell whether a key has subscribers.
        self._probes: dict[str, zenoh.Publisher] = {}
        # Subscribers and queryables, which would end if nothing referred to them.
        self._kept: list[Any] = []
        self._tokens: dict[str, zenoh.LivelinessToken] = {}

    def clock(self) -> float:
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        time.sleep(seconds)

    # -- publish and query

    def publish(self, key: str, payload: bytes, newest_wins: bool = False) -> None:
        if key not in self._publishers:
            if newest_wins:
                control = zenoh.CongestionControl.DROP
            else:
                control = zenoh.CongestionControl.BLOCK
            self._publishers[key] = self._session.declare_publisher(
                key, congestion_control=control, allowed_destination=_OTHERS
            )
        with _errors_ignored(key):
            self._publishers[key].put(payload)

    def retire(self, key: str) -> None:
        publisher = self._publishers.pop(key, None)
        if publisher is not None:
            with _errors_ignored("the end of a publisher"):
                publisher.undeclare()  # type: ignore[no-untyped-call]

    def is_heard(self, keys: str) -> bool:
        if keys not in self._probes:
            self._probes[keys] = self._session.declare_publisher(keys, allowed_destination=_OTHERS)
        # Zenoh's stub has another type for it than its code.
        status: Any = self._probes[keys].matching_status
        return bool(status.matching)

    def ask(self, key: str, payload: bytes, ticket: Any, seconds: float = GET_SECONDS) -> None:
        put = self.inbox.put

        def take(reply: zenoh.Reply) -> None:
            """Put a reply into the inbox."""
            put(_replied(ticket, reply))

        def end() -> None:
            """Put the end of the replies into the inbox."""
            put(Final(ticket))

        handler: Callback[zenoh.Reply] = Callback(take, end, indirect=False)
        try:
            self._session.get(key, handler, payload=payload, timeout=seconds, **_ASKING)
        except zenoh.ZError as error:
            log.debug("the query of %s was not sent: %s", key, error)
            end()

    # -- subscribe and answer

    def subscribe(self, keys: str, quietly: bool = False) -> None:
        self._kept.append(self._session.declare_subscriber(keys, self._into(_sample, quietly)))

    def answer(self, key: str) -> None:
        self._kept.append(self._session.declare_queryable(key, self._into(ZenohQuery)))

    def watch(self, tokens: str) -> None:
        self._kept.append(
            self._session.liveliness().declare_subscriber(tokens, self._into(_alive), history=True)
        )

    def declare_alive(self, token: str) -> None:
        self._tokens[token] = self._session.liveliness().declare_token(token)

    def withdraw(self, token: str) -> None:
        with _errors_ignored("the end of a token"):
            self._tokens.pop(token).undeclare()  # type: ignore[no-untyped-call]

    def _into(self, item_of: Callable[[Any], Item], quietly: bool = False) -> "Callback[Any]":
        """Return what puts all that arrives into the inbox. `item_of`: makes an item of it."""
        if quietly:
            put = self.inbox.put_quietly
        else:
            put = self.inbox.put
        return Callback(lambda arrived: put(item_of(arrived)), indirect=False)


def _sample(sample: zenoh.Sample) -> Sample:
    return Sample(str(sample.key_expr), sample.payload.to_bytes())


def _alive(sample: zenoh.Sample) -> Alive:
    return Alive(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)


def _replied(ticket: Any, reply: zenoh.Reply) -> Replied:
    if reply.ok is not None:
        return Replied(ticket, reply.ok.payload.to_bytes(), "")
    if reply.err is None:
        return Replied(ticket, b"", "no reply")
    return Replied(ticket, b"", reply.err.payload.to_bytes().decode(errors="replace"))


# -- sessions

OpenBus = AbstractContextManager[Bus]


def router(
    endpoint: str = LOOPBACK, inbox: Inbox | None = None, identity: Identity | None = None
) -> OpenBus:
    """Open a router session, and close it at the end.

    Without `identity` it admits all clients; with it, those of its rules.

    For port 0 it takes a free port; `bus.endpoint` contains it. Raises BusError if it cannot
    listen.
    """
    endpoint = with_port(endpoint)
    if identity is None and is_public(endpoint):
        log.warning("%s: %s", endpoint, _OPEN)
    return _opened("router", endpoint, inbox, 0.0, identity)


def client(
    endpoint: str,
    inbox: Inbox | None = None,
    seconds: float = CONNECT_SECONDS,
    identity: Identity | None = None,
) -> OpenBus:
    """Open a client session, and close it at the end.

    Raises BusError without a router in `seconds`.
    """
    return _opened("client", endpoint, inbox, seconds, identity)


@contextmanager
def _opened(
    mode: str, endpoint: str, inbox: Inbox | None, seconds: float, identity: Identity | None
) -> Iterator[Bus]:
    """Open a session, and close it at the end. `mode`: Zenoh's word, "router" or "client"."""
    check_security(endpoint, identity is not None)
    check_runtime()
    try:
        with _panics_explained():
            session = zenoh.open(_config(mode, endpoint, seconds, identity))
    except zenoh.ZError as error:
        raise BusError(_explain(mode, endpoint, seconds, identity, str(error))) from error
    try:
        if inbox is None:
            inbox = Inbox()
        yield ZenohBus(session, inbox, endpoint)
    finally:
        try:
            session.close()  # type: ignore[no-untyped-call]
        except zenoh.ZError as error:
            log.warning("the session with %s did not close: %s", endpoint, error)


def check_runtime() -> None:
    """Raise BusError if Zenoh cannot begin with the user's own ZENOH_RUNTIME."""
    chosen = os.environ.get(RUNTIME, ONE_THREAD)
    if chosen == ONE_THREAD:
        return
    # Zenoh starts these threads when something connects, and ends the process then.
    no_threads = NO_THREADS.search(COMMENTS.sub(" ", chosen))
    if no_threads:
        raise BusError(f"{RUNTIME}={printable(chosen)}: {no_threads[1]} must be 1 or more")
    _begin_with(chosen)


@cache
def _begin_with(chosen: str) -> None:
    """Open a session that connects to nothing, so that Zenoh reads ZENOH_RUNTIME.

    Raises BusError if Zenoh cannot use the value. Zenoh reads it once, at the first session, so
    this is done once, too.
    """
    config = zenoh.Config()
    for key, value in _ALONE.items():
        config.insert_json5(key, json.dumps(value))
    cause = f"{RUNTIME}={printable(chosen)}: expected a value that Zenoh knows, or none; "
    with _panics_explained(cause), _stderr_dropped():
        zenoh.open(config).close()  # type: ignore[no-untyped-call]


@contextmanager
def _panics_explained(cause: str = "") -> Iterator[None]:
    """In this context, a panic of Zenoh becomes a BusError. `cause`: what stands before its words.

    A panic is a BaseException whose class cannot be imported.
    """
    try:
        yield
    except BaseException as error:
        if type(error).__name__ != "PanicException":
            raise
        words = printable(str(error), MOST_WORDS)
        raise BusError(f"{cause}Zenoh cannot begin: {words}") from None


@contextmanager
def _stderr_dropped() -> Iterator[None]:
    """In this context, all that Rust writes to stderr is lost: the many lines of a panic."""
    with suppress(OSError):
        sys.stderr.flush()
    before = os.dup(2)
    try:
        with open(os.devnull, "w") as nothing:
            os.dup2(nothing.fileno(), 2)
        yield
    finally:
        os.dup2(before, 2)
        os.close(before)


def _explain(
    mode: str, endpoint: str, seconds: float, identity: Identity | None, error: str
) -> str:
    """Return, for people, why a session could not be opened. `error`: the words of Zenoh."""
    if "must be of the form" in error:
        return f"{endpoint}: {NO_ENDPOINT}"
    if mode == "router":
        return f"{endpoint}: {IN_USE}"
    fault = "" if identity is None else why_no_trust(endpoint, identity.folder)
    return f"{endpoint}: {fault or f'no router answers there; tried for {seconds:g} s'}"


def _config(mode: str, endpoint: str, seconds: float, identity: Identity | None) -> zenoh.Config:
    """Return the settings of a session. `seconds`: that a client tries to connect."""
    settings: dict[str, Any] = {
        "mode": mode,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": False,
        "transport/link/tx/lease": LEASE_MS,
    }
    if mode == "router":
        settings |= {
            "listen/endpoints": [endpoint],
            "listen/timeout_ms": int(LISTEN_SECONDS * 1000),
            "listen/exit_on_failure": True,
        }
        settings["transport/link/tx/queue/congestion_control/block/wait_before_close"] = (
            FULL_QUEUE_US
        )
        settings["transport/unicast/accept_pending"] = MOST_SILENT
    else:
        settings |= {
            "connect/endpoints": [endpoint],
            "connect/timeout_ms": int(seconds * 1000),
            "connect/exit_on_failure": True,
        }
        settings["connect/retry"] = {
            "period_init_ms": 100,
            "period_max_ms": 500,
            "period_increase_factor": 1.5,
        }
    if identity is not None:
        settings |= _tls_settings(identity)
        if mode == "router":
            settings["access_control"] = identity.rules()
    config = zenoh.Config()
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def _tls_settings(identity: Identity) -> dict[str, Any]:
    """Return the settings with which both sides of a connection show and check certificates."""
    tls: dict[str, Any] = {
        "root_ca_certificate": str(identity.folder / AUTHORITY),
        "enable_mtls": True,
        "verify_name_on_connect": True,
    }
    for side in ("listen", "connect"):
        tls |= {
            f"{side}_certificate": str(identity.folder / CERTIFICATE),
            f"{side}_private_key": str(identity.folder / KEY),
        }
    tls["close_link_on_expiration"] = True
    return {"id": identity.role.session} | {
        f"transport/link/tls/{key}": value for key, value in tls.items()
    }
