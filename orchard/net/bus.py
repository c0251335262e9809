"""The bus: how the processes of a run send and receive, and the clock that they read.

`ZenohBus` (zenoh_bus.py) is the one over Zenoh; tests and chaos/simulated have others.

All that arrives becomes an item in one inbox, in the order of arrival, and one thread reads it.
"""

import ctypes
import signal
from abc import ABC, abstractmethod
from collections import deque
from concurrent.futures import Executor
from contextlib import suppress
from math import inf
from threading import Lock, get_ident
from time import monotonic
from typing import Any, NamedTuple, Protocol

# s after which a get (a query that this process sends) ends without an answer. It is far above
# mailbox.LOST_SECONDS, and not longer, because zenoh keeps some 700 bytes of each get until then.
GET_SECONDS = 10.0
# The error of a get without an answer in time, in Zenoh's word.
TIMED_OUT = "Timeout"


# -- what arrives


class Sample(NamedTuple):
    """A payload that another session published on a key."""

    key: str
    payload: bytes


class Alive(NamedTuple):
    """A liveliness token appeared (`up`) or disappeared."""

    key: str
    up: bool


class Query(ABC):
    """A received query.

    Send any number of replies, then call `drop`, or the querier waits until its timeout.
    """

    key: str
    payload: bytes

    @abstractmethod
    def reply(self, payload: bytes) -> None:
        """Send a reply. More may follow."""

    @abstractmethod
    def refuse(self, reason: str) -> None:
        """Send an error reply, and drop the query."""

    @abstractmethod
    def drop(self) -> None:
        """End the query: the querier waits for no more replies."""


class Replied(NamedTuple):
    """A reply to the query with a ticket; `error` is '' unless it is an error reply."""

    # What `Bus.ask` was given, to tell to which query the reply belongs.
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
    """The items that have arrived, in their order.

    Putting is safe in any thread and in a signal handler.

    Waking a thread costs more than handling a message. So an item can be put quietly: it wakes the
    reader only if as many items are there as the reader has said that it needs.
    """

    LOOK = 0.05  # s between two looks of a reader that quiet items do not wake

    def __init__(self) -> None:
        self._items: deque[Item] = deque()
        # The reader waits by acquiring this lock, which is locked until the reader is to wake up.
        # SimpleQueue.get would be simpler, but may overlook its timeout (Python 3.11).
        self._unwoken = Lock()
        self._unwoken.acquire()
        # How many items wake the reader if they come quietly.
        self._enough = 1
        # Ids of the threads whose Python state is kept.
        self._settled: set[int] = set()

    def _settle(self) -> None:
        """Keep the Python state of the calling thread, if it is one of zenoh.

        To create and delete it at each call from that thread costs more than the message.
        """
        thread = get_ident()
        if thread not in self._settled:
            self._settled.add(thread)
            # Python deletes the state when as many calls have released it as have ensured it. This
            # call is never released.
            ctypes.pythonapi.PyGILState_Ensure()

    def forget(self) -> None:
        """Drop all that an earlier session has left here. Requests to end stay."""
        for _ in range(len(self._items)):
            item = self._items.popleft()
            if isinstance(item, Signal):
                self._items.append(item)

    def __len__(self) -> int:
        return len(self._items)

    def take_signals(self) -> None:
        """Let SIGINT and SIGTERM arrive as items from now on."""
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._take_signal)

    def _take_signal(self, number: int, frame: object) -> None:
        """Put a signal that has come to this process."""
        self.put(Signal(number))

    def put(self, item: Item) -> None:
        """Put an item, and wake the reader."""
        self._settle()
        self._items.append(item)
        self._wake()

    def put_quietly(self, item: Item) -> None:
        """Put an item. Wake the reader only if the inbox holds as many items as it waits for."""
        self._settle()
        self._items.append(item)
        if len(self._items) >= self._enough:
            self._wake()

    def _wake(self) -> None:
        """Wake the reader, or make its next wait end at once."""
        if self._unwoken.locked():
            # RuntimeError: another thread has released the lock in between.
            with suppress(RuntimeError):
                self._unwoken.release()

    def take(self, seconds: float = inf, enough: int = 1, look: float = LOOK) -> Item | None:
        """Return the next item, None if none arrives in `seconds`.

        `enough`: how many quiet items wake the reader. For fewer it looks each `look` seconds.
        """
        self._enough = enough
        deadline = monotonic() + seconds
        while not self._items:
            remaining = deadline - monotonic()
            if remaining <= 0.0:
                return None
            self._unwoken.acquire(timeout=min(remaining, look))
        return self._items.popleft()


class Bus(Protocol):
    """A session of one process at the router of its run.

    All that it receives arrives in `inbox`.
    """

    inbox: Inbox
    #: The endpoint of the router.
    endpoint: str
    #: The id of the session.
    id: str
    #: Runs one job after the other beside the caller, such as the writing of a file.
    executor: Executor

    # -- time

    def clock(self) -> float:
        """Return the time, s. It never goes back."""

    def sleep(self, seconds: float) -> None:
        """Wait for so many seconds of `clock`."""

    # -- publish and query

    def publish(self, key: str, payload: bytes, newest_wins: bool = False) -> None:
        """Publish a payload, without loss.

        `newest_wins`: slow subscribers miss messages. The first call for a key decides for all.
        """

    def retire(self, key: str) -> None:
        """Remove the publisher of a key that will not be used again, or not for some time."""

    def is_heard(self, keys: str) -> bool:
        """Whether another session subscribes to any of these keys."""

    def ask(self, key: str, payload: bytes, ticket: Any, seconds: float = GET_SECONDS) -> None:
        """Send a query.

        Its replies and their end arrive as Replied and Final with `ticket`. `seconds`: its timeout.
        """

    # -- subscribe and answer

    def subscribe(self, keys: str, quietly: bool = False) -> None:
        """Subscribe to keys: each sample arrives as a Sample.

        `quietly`: samples are put with `Inbox.put_quietly`.
        """

    def answer(self, key: str) -> None:
        """Declare a queryable on a key: each query arrives as a Query."""

    def watch(self, tokens: str) -> None:
        """Subscribe to liveliness tokens.

        Each change arrives as an Alive, and so do the present tokens.
        """

    def declare_alive(self, token: str) -> None:
        """Declare a liveliness token, which lasts until the session ends, or `withdraw`.

        Call it after all subscriptions: others send as soon as they see the token.
        """

    def withdraw(self, token: str) -> None:
        """Remove a liveliness token."""
