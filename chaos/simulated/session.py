"""The bus in virtual time: a session of the simulated network.

The code of a process uses it as it uses `ZenohBus`. It is linked to the router (link.py).
"""

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from random import Random
from typing import Any, Protocol

from chaos.simulated.census import Census
from chaos.simulated.link import CONTROL, DATA, UP, DirectLink, Link
from chaos.simulated.router import meets
from chaos.simulated.scheduler import Scheduler, Task, VirtualInbox
from orchard.net.bus import GET_SECONDS, TIMED_OUT, Alive, Bus, Final, Query, Replied, Sample


class SimulatedQuery(Query):
    """A query that has arrived, for the code that answers it.

    It comes from a link, or from the own session, whose queryables answer its queries too.
    """

    def __init__(
        self,
        key: str,
        payload: bytes,
        reply: Callable[[bytes, str], None],
        drop: Callable[[], None],
        census: Census,
    ) -> None:
        self.key = key
        self.payload = payload
        self._census = census
        self._reply = reply
        self._drop = drop
        self._is_dropped = False

    def reply(self, payload: bytes) -> None:
        if not self._is_dropped:
            self._census.reply(self.key, payload)
            self._reply(payload, "")

    def refuse(self, reason: str) -> None:
        if not self._is_dropped:
            self._reply(b"", reason)
        self.drop()

    def drop(self) -> None:
        if not self._is_dropped:
            self._is_dropped = True
            self._drop()


@dataclass
class Fuse:
    """Acts when a session is about to send its `left`-th message from now on.

    `only_queries`: only queries count.
    """

    left: int
    act: Callable[[], None]
    only_queries: bool


class SurroundingNetwork(Protocol):
    """What a session needs of its network."""

    @property
    def ENDPOINT(self) -> str:  # noqa: N802 - a constant of the network
        """The endpoint of the router."""

    @property
    def scheduler(self) -> Scheduler:
        """The clock of all sessions."""

    @property
    def seed(self) -> str:
        """The seed of all delays."""

    @property
    def pauses(self) -> float:
        """The share of messages before which a sender takes some time."""

    @property
    def census(self) -> Census:
        """What is counted of the messages."""

    def new_id(self, name: str) -> str:
        """Return the id of a new session of a process."""

    def next_number(self) -> int:
        """Return the number of a new query."""

    def trace(self, line: str) -> None:
        """Write a line of the trace."""

    def connect_again(self, bus: "SimulatedBus") -> None:
        """Connect a session that has lost its link, after a while."""


class SimulatedBus(Bus):
    """A session in virtual time. It is the same for the code of a process as one of Zenoh."""

    link: Link | None
    fuse: Fuse | None

    def __init__(
        self,
        network: SurroundingNetwork,
        name: str,
        task: Task | None,
        inbox: VirtualInbox,
        executor: Executor | None,
    ) -> None:
        self._network = network
        self._scheduler = network.scheduler
        self._task = task
        self.inbox = inbox
        self.endpoint = network.ENDPOINT
        self.id = network.new_id(name)
        if executor is not None:
            self.executor = executor
        self.name = name
        self.is_dead = False
        self.link = None
        self.fuse = None
        self._random = Random(f"{network.seed} {self.id}")
        # (what, key) in their order. `what` is the name of the router's method, or "token".
        self._declared: list[tuple[str, str]] = []
        # Subscriptions that do not wake the reader.
        self._quiet: set[str] = set()
        # Key -> whether each subscription that it meets is quiet. It is computed on demand.
        self._quiet_by_key: dict[str, list[bool]] = {}
        # Key -> whether a slow subscriber may miss messages.
        self._dropping: dict[str, bool] = {}
        # Whether the router tells this session which keys others subscribe to.
        self._is_interested = False
        # Hears all samples, too.
        self.listener: Callable[[str, bytes], None] | None = None
        # Key and payload of each query that has arrived.
        self.queries: list[tuple[str, bytes]] = []
        # The keys to which others subscribe, as far as the session knows.
        self._known: list[str] = []
        # The tokens of others that the session knows.
        self._alive: set[str] = set()
        # Number of a query -> its ticket, and how many still answer: the session's own queryables,
        # and the router.
        self._asks: dict[int, tuple[Any, int]] = {}

    def clock(self) -> float:
        return self._scheduler.now

    def sleep(self, seconds: float) -> None:
        deadline = self._scheduler.in_future(seconds)
        # A session without a task belongs to a caller that cannot wait.
        while self._task is not None and self._scheduler.now < deadline:
            self._task.wait(deadline - self._scheduler.now)

    def _before_sending(self, is_query: bool = False) -> None:
        """Take some time now and then, so that a process can be killed between two messages that it
        sends.
        """
        self._burn_fuse(is_query)
        if self._random.random() < self._network.pauses and not self.is_dead:
            # Up to 2 ms.
            self.sleep(self._random.random() * 2e-3)

    def _burn_fuse(self, is_query: bool) -> None:
        """Count a message for the fuse. After the last one it acts, before the message is sent."""
        fuse = self.fuse
        if fuse is None or self.is_dead or (fuse.only_queries and not is_query):
            return
        fuse.left -= 1
        if fuse.left == 0:
            self._scheduler.after(0.0, fuse.act)
            self.fuse = None
            # The act has its turn while this task sleeps.
            self.sleep(1e-6)

    def _send(
        self,
        act: Callable[[Link], None],
        lane: int = DATA,
        may_drop: bool = False,
        size: int = 0,
    ) -> None:
        """Send something to the router, if the session is linked. `act`: happens there."""
        link = self.link
        if link is not None and not self.is_dead:
            link.send(UP, partial(act, link), lane, may_drop, size)

    # -- publish and query

    def publish(self, key: str, payload: bytes, newest_wins: bool = False) -> None:
        self._before_sending()
        self._network.census.send(key, payload)
        may_drop = self._dropping.setdefault(key, newest_wins)
        self._send(
            lambda link: link.router.publish(link, key, payload, may_drop),
            DATA,
            may_drop,
            len(payload),
        )

    def retire(self, key: str) -> None:
        self._dropping.pop(key, None)

    def is_heard(self, keys: str) -> bool:
        # The session of the router's own process knows at once. Another one asks the router once,
        # and hears of each change from then on.
        if isinstance(self.link, DirectLink):
            return any(meets(keys, one) for one in self.link.router.subscribers_beside(self.id))
        if not self._is_interested:
            self._is_interested = True
            self._send(lambda link: link.router.interest(link), CONTROL)
        return any(meets(keys, one) for one in self._known)

    def ask(self, key: str, payload: bytes, ticket: Any, seconds: float = GET_SECONDS) -> None:
        self._before_sending(is_query=True)
        self._network.census.send(key, payload)
        own = [one for what, one in self._declared if what == "answer" and meets(one, key)]
        if self.link is None and not own:
            self.inbox.put(Final(ticket))
            return
        number = self._network.next_number()
        sides = len(own)
        if self.link is not None:
            sides += 1
        self._asks[number] = ticket, sides
        for _ in own:
            self.inbox.put(
                SimulatedQuery(
                    key,
                    payload,
                    partial(self.hear_reply, number),
                    partial(self.hear_final, number),
                    self._network.census,
                )
            )
        self._send(lambda link: link.router.ask(link, number, key, payload), size=len(payload))
        self._scheduler.after(seconds, lambda: self._time_out(number))

    def _time_out(self, number: int) -> None:
        """End a query that has not ended in its time."""
        if number in self._asks and not self.is_dead:
            ticket, _ = self._asks.pop(number)
            if self.link is not None:
                self.link.router.forget_query(number)
            self.inbox.put(Replied(ticket, b"", TIMED_OUT))
            self.inbox.put(Final(ticket))

    # -- subscribe and answer

    def subscribe(self, keys: str, quietly: bool = False) -> None:
        if quietly:
            self._quiet.add(keys)
        self._declare("subscribe", keys)

    def answer(self, key: str) -> None:
        self._declare("answer", key)

    def watch(self, tokens: str) -> None:
        self._declare("watch", tokens)

    def declare_alive(self, token: str) -> None:
        self._declare("token", token)

    def withdraw(self, token: str) -> None:
        self._declared.remove(("token", token))
        self._send(lambda link: link.router.token(link, token, False), CONTROL)

    def _declare(self, what: str, key: str) -> None:
        """Declare something on a key, now and at each later link. `what`: as in `_declared`."""
        self._before_sending()
        self._declared.append((what, key))
        self._quiet_by_key = {}
        self._send_declared(what, key)

    def _send_declared(self, what: str, key: str) -> None:
        """Tell the router of a declaration."""
        if what == "token":
            self._send(lambda link: link.router.token(link, key, True), CONTROL)
        else:
            self._send(lambda link: getattr(link.router, what)(link, key), CONTROL)

    # -- the link

    def use(self, link: Link) -> None:
        """Use a link that has been opened: all that the session has declared is declared
        there too.
        """
        self.link = link
        link.router.connect(link)
        for what, key in self._declared:
            self._send_declared(what, key)
        if self._is_interested:
            self._send(lambda link: link.router.interest(link), CONTROL)

    def lose(self, link: Link) -> None:
        """Hear that the link is closed.

        All tokens of others go, and so does the router's part of each query that is under way.
        """
        if self.link is not link:
            return
        self.link = None
        self._network.trace(f"{self.id} has lost its link")
        if self.is_dead:
            return
        for token in sorted(self._alive):
            self.hear_token(token, False)
        self._known = []
        for number in list(self._asks):
            self.hear_final(number)
        self._network.connect_again(self)

    def end(self, share: float) -> None:
        """Take part no more.

        `share`: of what is under way, how much still arrives. It is 1 if the process has closed
        the session.
        """
        self.is_dead = True
        if self.link is not None:
            self.link.end(UP, share)

    # -- what arrives

    def hear_sample(self, key: str, payload: bytes) -> None:
        if self.listener is not None:
            self.listener(key, payload)
        sample = Sample(key, payload)
        for is_quiet in self._quietness_of(key):
            if is_quiet:
                self.inbox.put_quietly(sample)
            else:
                self.inbox.put(sample)

    def _quietness_of(self, key: str) -> list[bool]:
        """Return whether each subscription that a key meets is quiet."""
        if key not in self._quiet_by_key:
            self._quiet_by_key[key] = [
                keys in self._quiet
                for what, keys in self._declared
                if what == "subscribe" and meets(keys, key)
            ]
        return self._quiet_by_key[key]

    def hear_token(self, token: str, up: bool) -> None:
        is_known = token in self._alive
        if up == is_known:
            return
        if up:
            self._alive.add(token)
        else:
            self._alive.discard(token)
        self.inbox.put(Alive(token, up))

    def hear_subscribers(self, keys: list[str]) -> None:
        self._known = keys

    def hear_query(self, link: Link, number: int, key: str, payload: bytes) -> None:
        declared = [one for what, one in self._declared if what == "answer" and meets(one, key)]
        unanswered = len(declared)
        self.queries.append((key, payload))

        def reply(payload: bytes, error: str) -> None:
            arrives = partial(link.router.reply, number, key, payload, error)
            link.send(UP, arrives, size=len(payload))

        def finish() -> None:
            link.send(UP, lambda: link.router.finish(number, self.id))

        def drop() -> None:
            nonlocal unanswered
            unanswered -= 1
            if unanswered == 0:
                finish()

        for _ in declared:
            self.inbox.put(SimulatedQuery(key, payload, reply, drop, self._network.census))
        if not declared:
            finish()

    def hear_reply(self, number: int, payload: bytes, error: str) -> None:
        if number in self._asks:
            self.inbox.put(Replied(self._asks[number][0], payload, error))

    def hear_final(self, number: int) -> None:
        if number in self._asks:
            ticket, left = self._asks[number]
            self._asks[number] = ticket, left - 1
            if left <= 1:
                del self._asks[number]
                self.inbox.put(Final(ticket))
