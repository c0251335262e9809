"""A simulated network: a router, and sessions that are linked to it, with delays and faults, all in virtual time.

What it does is what Zenoh does, and no better: `tests/net/test_bus_contract.py` runs the same scripts against both.

- A link has two directions, and each has two lanes: declarations (subscribers, queryables, tokens) may overtake data, and data never
  declarations. A lane keeps its order.
- A link that is silent for LEASE seconds is closed by each side that notices it; what is under way is lost; the client connects again.
- A receiver that takes nothing fills its link: samples that may be dropped are lost, others close the link after a moment.
"""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from functools import lru_cache, partial
from math import inf
from random import Random
from typing import Any, NamedTuple

import zenoh

from chaos.simulated.scheduler import Scheduler, Task, VirtualInbox
from orchard.net.bus import GET_SECONDS, TIMED_OUT, Alive, Bus, Final, Query, Replied, Sample
from orchard.net.endpoints import BusError
from orchard.net.zenoh_bus import CONNECT_SECONDS, FULL_QUEUE_US, LEASE_MS

LEASE = LEASE_MS / 1000.0  # s
FULL_SECONDS = FULL_QUEUE_US / 1e6  # s that a full link may stay full
RETRY = (0.1, 0.15, 0.225, 0.3375, 0.5)  # s between the tries to connect again; the last one for all others
ROOM = 40  # messages that a silent link holds in each direction
DATA, CONTROL = 0, 1  # lanes
UP, DOWN = 0, 1  # directions: to the router, and from it


@lru_cache(maxsize=100_000)
def meets(one: str, other: str) -> bool:
    """Whether two key expressions have a key in common."""
    return bool(zenoh.KeyExpr(one).intersects(zenoh.KeyExpr(other)))


class Delays(NamedTuple):
    """How long messages take on one link. `typical`, `slow`: s; `share`: of messages that are slow."""

    typical: float = 1e-3
    slow: float = 0.1
    share: float = 0.02

    def draw(self, random: Random) -> float:
        return random.random() * (self.slow if random.random() < self.share else 2.0 * self.typical)


class Link:
    """A connection between a session and the router, from its opening until it is closed."""

    def __init__(self, session: "SimulatedBus", router: "Router", delays: Delays, random: Random) -> None:
        self.session, self.router = session, router
        self._scheduler, self._delays, self._random = router.scheduler, delays, random
        self.is_open = [True, True]  # as the session sees it, as the router sees it
        self._last = {(way, lane): 0.0 for way in (UP, DOWN) for lane in (DATA, CONTROL)}  # s: the newest arrival
        self._silent = [0, 0]  # how many faults silence each direction
        self._since = [0, 0]  # the number of the silence that lasts, 0 without one
        self._silences = 0
        self._waiting: list[list[Callable[[], None]]] = [[], []]
        self._is_full = False

    def send(self, way: int, act: Callable[[], None], lane: int = DATA, may_drop: bool = False) -> None:
        """Let `act` happen at the other side, unless the message is lost."""
        if not self.is_open[way]:
            return
        if self._silent[way] and len(self._waiting[way]) >= ROOM:
            if not may_drop:
                self._close_if_full()
            return
        before = self._last[way, CONTROL] if lane == CONTROL else max(self._last[way, DATA], self._last[way, CONTROL])
        at = max(before, self._scheduler.now + self._delays.draw(self._random))
        self._last[way, lane] = at
        self._scheduler.after(at - self._scheduler.now, lambda: self._arrive(way, act))

    def _close_if_full(self) -> None:
        if not self._is_full:
            self._is_full = True
            self._scheduler.after(FULL_SECONDS, lambda: self.close() if self._is_full else None)

    def _arrive(self, way: int, act: Callable[[], None]) -> None:
        if self._silent[way]:
            self._waiting[way].append(act)
        elif self.is_open[1 - way]:
            act()

    def silence(self, ways: Iterable[int]) -> None:
        """Let nothing through until `speak`. After LEASE the side that hears nothing closes the link."""
        for way in ways:
            self._silent[way] += 1
            self._silences += 1
            self._scheduler.after(LEASE, partial(self._close_if_silent, way, self._silences))
            self._since[way] = self._since[way] or self._silences

    def speak(self, ways: Iterable[int]) -> None:
        """End a silence. What has waited arrives."""
        for way in ways:
            self._silent[way] -= 1
            if not self._silent[way]:
                waiting, self._waiting[way], self._is_full, self._since[way] = self._waiting[way], [], False, 0
                for act in waiting:
                    if all(self.is_open):
                        act()

    def _close_if_silent(self, way: int, number: int) -> None:
        if 0 < self._since[way] <= number:
            self.close(session=way == DOWN, router=way == UP)

    def end(self, way: int, share: float) -> None:
        """Close it from the side that sends in a direction. `share`: how much of what it has sent still arrives."""
        under_way = max(self._last[way, DATA], self._last[way, CONTROL]) - self._scheduler.now
        self.is_open[way] = False
        self._scheduler.after(max(0.0, under_way) * share, self.close)

    def close(self, session: bool = True, router: bool = True) -> None:
        """Close it, as one side or both see it. A side that it is not closed for notices soon: the other's socket is gone."""
        if router and self.is_open[1]:
            self.is_open[1] = False
            self.router.lose(self)
        if session and self.is_open[0]:
            self.is_open[0] = False
            self.session.lose(self)
        if any(self.is_open):
            self._scheduler.after(0.01 if not any(self._silent) else LEASE, self.close)


class DirectLink(Link):
    """The link of a router's own session: it has no delay and no fault."""

    def silence(self, ways: Iterable[int]) -> None:
        pass

    def speak(self, ways: Iterable[int]) -> None:
        pass

    def send(self, way: int, act: Callable[[], None], lane: int = DATA, may_drop: bool = False) -> None:
        if all(self.is_open):
            act()


class Router:
    """A router: it passes on what the sessions that are linked to it send and declare."""

    def __init__(self, scheduler: Scheduler, owner: str = "") -> None:
        """`owner`: the name of the process that has it; '' for a router of its own."""
        self.scheduler, self.owner = scheduler, owner
        self.links: dict[str, Link] = {}  # session id ->
        self._subscribers: dict[str, list[str]] = {}  # session id -> keys
        self._queryables: dict[str, list[str]] = {}
        self._watchers: dict[str, list[str]] = {}
        self._tokens: dict[str, list[str]] = {}
        self._interested: set[str] = set()  # sessions that ask who subscribes
        self._pending: dict[int, tuple[str, list[str]]] = {}  # number of a query -> who asks, and the sessions that are to reply
        self.is_open = True

    @property
    def pending(self) -> int:
        """The number of queries that are under way."""
        return len(self._pending)

    def connect(self, link: Link) -> None:
        session = link.session.id
        self.links[session] = link
        for table in (self._subscribers, self._queryables, self._watchers, self._tokens):
            table[session] = []

    def lose(self, link: Link) -> None:
        """Forget a session whose link is closed."""
        session = link.session.id
        if self.links.get(session) is not link:
            return
        del self.links[session]
        self._interested.discard(session)
        for table in (self._subscribers, self._queryables, self._watchers):
            table.pop(session)
        for token in self._tokens.pop(session):
            self._tell_token(token, False)
        for number, (asker, repliers) in list(self._pending.items()):
            if asker == session:
                del self._pending[number]
            elif session in repliers:
                self.finish(number, session)
        self._tell_subscribers()

    def close(self, share: float = 1.0) -> None:
        """End: all links are closed. `share`: how much of what it has sent still arrives."""
        if self.is_open:
            self.is_open = False
            for link in list(self.links.values()):
                link.end(DOWN, share)

    # -- declarations

    def subscribe(self, link: Link, keys: str) -> None:
        if self._is_linked(link):
            self._subscribers[link.session.id].append(keys)
            self._tell_subscribers()

    def answer(self, link: Link, key: str) -> None:
        if self._is_linked(link):
            self._queryables[link.session.id].append(key)

    def interest(self, link: Link) -> None:
        """Tell a session from now on who subscribes to what."""
        if self._is_linked(link):
            self._interested.add(link.session.id)
            self._tell_subscribers()

    def watch(self, link: Link, tokens: str) -> None:
        if self._is_linked(link):
            self._watchers[link.session.id].append(tokens)
            for token in [token for present in self._tokens.values() for token in present if meets(tokens, token)]:
                link.send(DOWN, partial(link.session.hear_token, token, True), CONTROL)

    def knows(self, token: str) -> bool:
        """Whether a liveliness token is there."""
        return any(token in tokens for tokens in self._tokens.values())

    def token(self, link: Link, token: str, up: bool) -> None:
        if not self._is_linked(link):
            return
        tokens = self._tokens[link.session.id]
        if up:
            tokens.append(token)
        elif token in tokens:
            tokens.remove(token)
        self._tell_token(token, up)

    def _is_linked(self, link: Link) -> bool:
        return self.links.get(link.session.id) is link

    def _tell_token(self, token: str, up: bool) -> None:
        for session, keys in list(self._watchers.items()):
            if any(meets(watched, token) for watched in keys):
                link = self.links[session]
                link.send(DOWN, partial(link.session.hear_token, token, up), CONTROL)

    def _tell_subscribers(self) -> None:
        for session in sorted(self._interested & self.links.keys()):
            link, known = self.links[session], [keys for other, keys in self._subscribers.items() if other != session]
            all_keys = [one for keys in known for one in keys]
            link.send(DOWN, partial(link.session.hear_subscribers, all_keys), CONTROL)

    def subscribers_beside(self, session: str) -> list[str]:
        """Return the keys to which other sessions subscribe."""
        return [one for other, keys in self._subscribers.items() if other != session for one in keys]

    # -- data

    def publish(self, link: Link, key: str, payload: bytes, may_drop: bool) -> None:
        for session, keys in list(self._subscribers.items()):
            if session != link.session.id and any(meets(one, key) for one in keys):
                to = self.links[session]
                to.send(DOWN, partial(to.session.hear_sample, key, payload), DATA, may_drop)

    def ask(self, link: Link, number: int, key: str, payload: bytes) -> None:
        asker = link.session.id
        repliers = [session for session, keys in self._queryables.items() if session != asker and any(meets(one, key) for one in keys)]
        self._pending[number] = asker, list(repliers)
        for session in repliers:
            to = self.links[session]
            to.send(DOWN, partial(to.session.hear_query, to, number, key, payload))
        if not repliers:
            self.finish(number, "")

    def reply(self, number: int, payload: bytes, error: str) -> None:
        if number in self._pending and (link := self.links.get(self._pending[number][0])) is not None:
            link.send(DOWN, lambda: link.session.hear_reply(number, payload, error))

    def finish(self, number: int, session: str) -> None:
        """Record that a session has sent all its replies to a query."""
        if number not in self._pending:
            return
        asker, repliers = self._pending[number]
        if session in repliers:
            repliers.remove(session)
        if not repliers:
            del self._pending[number]
            if (link := self.links.get(asker)) is not None:
                link.send(DOWN, lambda: link.session.hear_final(number))

    def forget_query(self, number: int) -> None:
        """Drop a query whose time is over."""
        self._pending.pop(number, None)


class SimulatedQuery(Query):
    """A query that came over a link."""

    def __init__(self, key: str, payload: bytes, reply: Callable[[bytes, str], None], drop: Callable[[], None]) -> None:
        self.key, self.payload = key, payload
        self._reply, self._drop, self._is_dropped = reply, drop, False

    def reply(self, payload: bytes) -> None:
        if not self._is_dropped:
            self._reply(payload, "")

    def refuse(self, reason: str) -> None:
        if not self._is_dropped:
            self._reply(b"", reason)
        self.drop()

    def drop(self) -> None:
        if not self._is_dropped:
            self._is_dropped = True
            self._drop()


class SimulatedBus(Bus):
    """A session in virtual time. It is the same for the code of a process as one of Zenoh."""

    def __init__(self, network: "Network", name: str, task: Task | None, inbox: VirtualInbox, executor: Executor | None) -> None:
        self._network, self._scheduler, self._task = network, network.scheduler, task
        self.inbox, self.endpoint, self.id = inbox, network.ENDPOINT, network.new_id(name)
        if executor is not None:
            self.executor = executor
        self.name, self.is_dead, self.link = name, False, None
        self._random = Random(f"{network.seed} {self.id}")
        self._declared: list[tuple[str, str]] = []  # (what, key), in their order
        self._quiet: set[str] = set()  # subscriptions that do not wake the reader
        self._dropping: dict[str, bool] = {}  # key -> whether a slow subscriber may miss messages
        self._is_interested = False
        self._known: list[str] = []  # the keys to which others subscribe, as far as the session knows
        self._alive: set[str] = set()  # the tokens of others that the session knows
        self._asks: dict[int, tuple[Any, int]] = {}  # number -> ticket, parts that are not final

    link: Link | None

    def clock(self) -> float:
        return self._scheduler.now

    def sleep(self, seconds: float) -> None:
        deadline = self._scheduler.in_future(seconds)
        while self._task is not None and (left := deadline - self._scheduler.now) > 0.0:
            self._task.wait(left)

    def _work(self) -> None:
        """Take some time now and then, so that a process can be killed between two messages that it sends."""
        if self._random.random() < self._network.pauses and not self.is_dead:
            self.sleep(self._random.random() * 2e-3)

    def _send(self, act: Callable[[Link], None], lane: int = DATA, may_drop: bool = False) -> None:
        link = self.link
        if link is not None and not self.is_dead:
            link.send(UP, lambda: act(link), lane, may_drop)

    # -- publish and query

    def publish(self, key: str, payload: bytes, newest_wins: bool = False) -> None:
        self._work()
        may_drop = self._dropping.setdefault(key, newest_wins)
        self._send(lambda link: link.router.publish(link, key, payload, may_drop), DATA, may_drop)

    def retire(self, key: str) -> None:
        self._dropping.pop(key, None)

    def is_heard(self, keys: str) -> bool:
        if isinstance(self.link, DirectLink):
            return any(meets(keys, one) for one in self.link.router.subscribers_beside(self.id))
        if not self._is_interested:
            self._is_interested = True
            self._send(lambda link: link.router.interest(link), CONTROL)
        return any(meets(keys, one) for one in self._known)

    def ask(self, key: str, payload: bytes, ticket: Any, seconds: float = GET_SECONDS) -> None:
        self._work()
        own = [one for what, one in self._declared if what == "answer" and meets(one, key)]
        if self.link is None and not own:
            self.inbox.put(Final(ticket))
            return
        number = self._network.next_number()
        self._asks[number] = ticket, len(own) + (self.link is not None)
        for _ in own:
            self.inbox.put(SimulatedQuery(key, payload, partial(self.hear_reply, number), partial(self.hear_final, number)))
        self._send(lambda link: link.router.ask(link, number, key, payload))
        self._scheduler.after(seconds, lambda: self._time_out(number))

    def _time_out(self, number: int) -> None:
        if number in self._asks and not self.is_dead:
            ticket, _ = self._asks.pop(number)
            if self.link is not None:
                self.link.router.forget_query(number)
            self.inbox.put(Replied(ticket, b"", TIMED_OUT))
            self.inbox.put(Final(ticket))

    # -- subscribe and answer

    def subscribe(self, keys: str, quietly: bool = False) -> None:
        self._quiet |= {keys} if quietly else set()
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
        self._work()
        self._declared.append((what, key))
        self._send_declared(what, key)

    def _send_declared(self, what: str, key: str) -> None:
        if what == "token":
            self._send(lambda link: link.router.token(link, key, True), CONTROL)
        else:
            self._send(lambda link: getattr(link.router, what)(link, key), CONTROL)

    # -- the link

    def use(self, link: Link) -> None:
        """Use a link that has been opened: all that the session has declared is declared there too."""
        self.link = link
        link.router.connect(link)
        for what, key in self._declared:
            self._send_declared(what, key)
        if self._is_interested:
            self._send(lambda link: link.router.interest(link), CONTROL)

    def lose(self, link: Link) -> None:
        """Hear that the link is closed: the others are gone, and the gets that are under way have ended."""
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
        """Take part no more. `share`: how much of what is under way still arrives: all if the process has closed the session."""
        self.is_dead = True
        if self.link is not None:
            self.link.end(UP, share)

    # -- what arrives

    def hear_sample(self, key: str, payload: bytes) -> None:
        for what, keys in self._declared:
            if what == "subscribe" and meets(keys, key):
                (self.inbox.put_quietly if keys in self._quiet else self.inbox.put)(Sample(key, payload))

    def hear_token(self, token: str, up: bool) -> None:
        if up != (token in self._alive):
            (self._alive.add if up else self._alive.discard)(token)
            self.inbox.put(Alive(token, up))

    def hear_subscribers(self, keys: list[str]) -> None:
        self._known = keys

    def hear_query(self, link: Link, number: int, key: str, payload: bytes) -> None:
        declared = [one for what, one in self._declared if what == "answer" and meets(one, key)]
        left = len(declared)

        def reply(payload: bytes, error: str) -> None:
            link.send(UP, lambda: link.router.reply(number, payload, error))

        def drop() -> None:
            nonlocal left
            left -= 1
            if left <= 0:
                link.send(UP, lambda: link.router.finish(number, self.id))

        for _ in declared:
            self.inbox.put(SimulatedQuery(key, payload, reply, drop))
        if not declared:
            drop()

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


class Network:
    """The one network of a schedule: its router, if one is there, and the sessions."""

    ENDPOINT = "tcp/127.0.0.1:7447"

    def __init__(self, scheduler: Scheduler, seed: str, delays: Delays, pauses: float = 0.01) -> None:
        """`seed`: of all delays. `pauses`: the share of messages before which a sender takes some time."""
        self.scheduler, self.seed, self.pauses, self._delays = scheduler, seed, pauses, delays
        self.router: Router | None = None
        self.sessions: list[SimulatedBus] = []
        self.lines: list[str] = []  # the trace
        self.is_traced = False
        self._ids: dict[str, int] = {}
        self._number = 0
        self._cut_until: dict[str, float] = {}  # name of a process -> s
        self._frozen: dict[str, int] = {}  # name of a process -> how often

    def trace(self, line: str) -> None:
        """Write a line of the trace."""
        if self.is_traced:
            self.lines.append(f"{self.scheduler.now:10.4f}  {line}")

    def new_id(self, name: str) -> str:
        self._ids[name] = self._ids.get(name, 0) + 1
        return f"{name.replace('_', '')}x{self._ids[name]}"

    def next_number(self) -> int:
        self._number += 1
        return self._number

    @contextmanager
    def router_session(self, name: str, task: Task, inbox: VirtualInbox, executor: Executor) -> Iterator[SimulatedBus]:
        """Open a router with a session of its own. Raises BusError if there is one already."""
        if self.router is not None and self.router.is_open:
            raise BusError(f"{self.ENDPOINT}: another program listens there")
        router = self.router = Router(self.scheduler, name)
        bus = SimulatedBus(self, name, task, inbox, executor)
        self.sessions.append(bus)
        bus.use(DirectLink(bus, router, Delays(), Random(0)))
        try:
            yield bus
        finally:
            self.end(bus)
            router.close()

    @contextmanager
    def client_session(
        self, name: str, task: Task, inbox: VirtualInbox, executor: Executor, seconds: float = CONNECT_SECONDS
    ) -> Iterator[SimulatedBus]:
        """Open a session at the router. Raises BusError if there is none within `seconds`."""
        bus = SimulatedBus(self, name, task, inbox, executor)
        deadline = self.scheduler.now + seconds
        while not self._can_connect(bus):
            if self.scheduler.now >= deadline:
                raise BusError(f"{self.ENDPOINT}: no router answers there; tried for {seconds:g} s")
            bus.sleep(0.1)
        self.sessions.append(bus)
        self._connect(bus)
        try:
            yield bus
        finally:
            self.end(bus)

    def open(self, name: str, inbox: VirtualInbox) -> SimulatedBus:
        """Open a session that no task waits with. It is linked as soon as there is a router."""
        bus = SimulatedBus(self, name, None, inbox, None)
        self.sessions.append(bus)
        self._try_again(bus, 0)
        return bus

    def end(self, bus: SimulatedBus, share: float = 1.0) -> None:
        """End a session. `share`: how much of what it has sent still arrives."""
        if not bus.is_dead:
            bus.end(share)
        if bus in self.sessions:
            self.sessions.remove(bus)

    def _can_connect(self, bus: SimulatedBus) -> bool:
        if self.router is None or not self.router.is_open or self.scheduler.now < self._cut_until.get(bus.name, -inf):
            return False
        return not self._frozen.get(bus.name) and not self._frozen.get(self.router.owner)

    def _connect(self, bus: SimulatedBus) -> None:
        assert self.router is not None
        link = Link(bus, self.router, self._delays, Random(f"{self.seed} {bus.id} {self.next_number()}"))
        if (old := self.router.links.get(bus.id)) is not None:
            old.close(session=False)
        self.trace(f"{bus.id} is linked")
        bus.use(link)

    def connect_again(self, bus: SimulatedBus, tries: int = 0) -> None:
        """Try to connect a session again, until that succeeds."""
        self.scheduler.after(RETRY[min(tries, len(RETRY) - 1)], lambda: self._try_again(bus, tries))

    def _try_again(self, bus: SimulatedBus, tries: int) -> None:
        if bus.is_dead or bus.link is not None:
            return
        if self._can_connect(bus):
            self._connect(bus)
        else:
            self.connect_again(bus, tries + 1)

    # -- faults

    def start_router(self, name: str) -> None:
        """Start a router of its own."""
        self.router = Router(self.scheduler, name)

    def end_router(self, name: str, share: float = 1.0) -> None:
        """End the router of a process. `share`: how much of what it has sent still arrives."""
        if self.router is not None and self.router.owner == name:
            self.router.close(share)

    def has_token(self, token: str) -> bool:
        """Whether the router knows a liveliness token."""
        return self.router is not None and self.router.is_open and self.router.knows(token)

    def links_of(self, name: str) -> list[Link]:
        """Return the links of a process."""
        return [bus.link for bus in self.sessions if bus.name == name and bus.link is not None and not isinstance(bus.link, DirectLink)]

    def cut(self, name: str, seconds: float) -> None:
        """Close the links of a process; it cannot connect again for so long."""
        self._cut_until[name] = self.scheduler.now + seconds
        for link in self.links_of(name):
            link.close()

    def freeze(self, name: str) -> Callable[[], None]:
        """Let a process take no part. If it has the router, that takes none either. Return a function that ends it."""
        self._frozen[name] = self._frozen.get(name, 0) + 1
        has_router = any(bus.name == name and isinstance(bus.link, DirectLink) for bus in self.sessions)
        links = list(self.router.links.values()) if has_router and self.router is not None else self.links_of(name)
        speak = self._silenced(links, (UP, DOWN))

        def thaw() -> None:
            self._frozen[name] -= 1
            speak()

        return thaw

    def silence(self, name: str, seconds: float, ways: tuple[int, ...] = (UP, DOWN)) -> None:
        """Let nothing through on the links of a process for so long."""
        self.scheduler.after(seconds, self._silenced(self.links_of(name), ways))

    @staticmethod
    def _silenced(links: list[Link], ways: tuple[int, ...]) -> Callable[[], None]:
        """Silence links. Return a function that ends it."""
        for link in links:
            link.silence(ways)

        def speak() -> None:
            for link in links:
                link.speak(ways)

        return speak
