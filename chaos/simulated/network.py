"""A simulated network: a router, and sessions that are linked to it, with delays and faults, all in
virtual time.

What it does is what Zenoh does, and no better: `tests/net/test_bus_contract.py` runs the same
scripts against both.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from functools import partial
from math import inf
from random import Random

from chaos.simulated.census import Census
from chaos.simulated.link import DOWN, UP, Delays, DirectLink, Link
from chaos.simulated.router import Router
from chaos.simulated.scheduler import Scheduler, Task, VirtualInbox
from chaos.simulated.session import Fuse, SimulatedBus
from chaos.simulated.tearing import NO_TEARS, Tearer
from orchard.net.endpoints import BusError
from orchard.net.zenoh_bus import CONNECT_SECONDS

# s before the first, second, ... try to connect again; the last one for all further tries. It is
# what `connect/retry` of zenoh_bus.py gives: from 100 to 500 ms, each 1.5 times the one before.
RETRY = (0.1, 0.15, 0.225, 0.3375, 0.5)
# s between two tries to connect for the first time.
CONNECT_RETRY = 0.1
# How long it takes until the thread that reads the inbox of the router's own session has the
# processor.
OF_A_THREAD = Delays(typical=2e-5, slow=2e-3, share=0.01)


class Network:
    """The one network of a schedule: its router, if one is there, and the sessions."""

    ENDPOINT = "tcp/127.0.0.1:7447"

    def __init__(
        self, scheduler: Scheduler, seed: str, delays: Delays, pauses: float = 0.01
    ) -> None:
        """`seed`: of all delays. `pauses`: the share of messages before which a sender takes some
        time.
        """
        self.scheduler = scheduler
        self.seed = seed
        self.pauses = pauses
        self._delays = delays
        self.router: Router | None = None
        self.sessions: list[SimulatedBus] = []
        # s by which tokens come later than messages.
        self.late = 0.0
        # How often payloads change on their way, and how many have.
        self.tears = NO_TEARS
        self.torn = 0
        # The lines of the trace, which are written if it is wanted.
        self.lines: list[str] = []
        self.is_traced = False
        self.census = Census()
        # Name of a process -> how many sessions it has opened.
        self._ids: dict[str, int] = {}
        # The last number that was given to a query or a link.
        self._number = 0
        # Name of a process -> s, virtual, until which it cannot connect.
        self._cut_until: dict[str, float] = {}
        # Name of a process -> how many faults freeze it.
        self._frozen: dict[str, int] = {}

    def trace(self, line: str) -> None:
        """Write a line of the trace."""
        if self.is_traced:
            self.lines.append(f"{self.scheduler.now:10.4f}  {line}")

    def new_id(self, name: str) -> str:
        """Return the id of a new session of a process: "agents 1" gives "agents1x1"."""
        self._ids[name] = self._ids.get(name, 0) + 1
        return f"{''.join(filter(str.isalnum, name))}x{self._ids[name]}"

    def next_number(self) -> int:
        """Return a number that no query and no link has."""
        self._number += 1
        return self._number

    @contextmanager
    def router_session(
        self, name: str, task: Task, inbox: VirtualInbox, executor: Executor
    ) -> Iterator[SimulatedBus]:
        """Open a router with a session of its own. Raises BusError if there is one already."""
        router = self.start_router(name)
        bus = SimulatedBus(self, name, task, inbox, executor)
        self.sessions.append(bus)
        bus.use(DirectLink(bus, router, OF_A_THREAD, Random(f"{self.seed} {bus.id}")))
        try:
            yield bus
        finally:
            self.end(bus)
            router.close()

    @contextmanager
    def client_session(
        self,
        name: str,
        task: Task,
        inbox: VirtualInbox,
        executor: Executor,
        seconds: float = CONNECT_SECONDS,
    ) -> Iterator[SimulatedBus]:
        """Open a session at the router. Raises BusError if there is none within `seconds`."""
        bus = SimulatedBus(self, name, task, inbox, executor)
        deadline = self.scheduler.now + seconds
        while not self._can_connect(bus):
            if self.scheduler.now >= deadline:
                raise BusError(f"{self.ENDPOINT}: no router answers there; tried for {seconds:g} s")
            bus.sleep(CONNECT_RETRY)
        self.sessions.append(bus)
        self._connect(bus)
        try:
            yield bus
        finally:
            self.end(bus)

    def open(self, name: str, inbox: VirtualInbox) -> SimulatedBus:
        """Open a session for a caller that is no task, and so cannot wait.

        It is linked as soon as there is a router.
        """
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
        """Whether a session can be linked now: a router is there, and no fault keeps it away."""
        if self.router is None or not self.router.is_open:
            return False
        if self.scheduler.now < self._cut_until.get(bus.name, -inf):
            return False
        return not self._frozen.get(bus.name) and not self._frozen.get(self.router.owner)

    def _connect(self, bus: SimulatedBus) -> None:
        """Link a session to the router."""
        assert self.router is not None
        number = self.next_number()
        link = Link(bus, self.router, self._delays, Random(f"{self.seed} {bus.id} {number}"))
        if self.tears:
            random = Random(f"tears {self.seed} {bus.id} {number}")
            link.tearer = Tearer(self.tears, random, partial(self._tear, bus))
        old = self.router.links.get(bus.id)
        if old is not None:
            # The router has not noticed yet that the session has lost it.
            old.close(session=False)
        self.trace(f"{bus.id} is linked")
        bus.use(link)

    def _tear(self, bus: SimulatedBus) -> None:
        """Count a payload that has changed."""
        self.torn += 1
        self.trace(f"a payload changes on the link of {bus.id}")

    def connect_again(self, bus: SimulatedBus, tries: int = 0) -> None:
        """Try to connect a session again, until that succeeds. `tries`: that failed so far."""
        seconds = RETRY[min(tries, len(RETRY) - 1)]
        self.scheduler.after(seconds, lambda: self._try_again(bus, tries))

    def _try_again(self, bus: SimulatedBus, tries: int) -> None:
        """Connect a session, or try it again later."""
        if bus.is_dead or bus.link is not None:
            return
        if self._can_connect(bus):
            self._connect(bus)
        else:
            self.connect_again(bus, tries + 1)

    # -- faults

    def start_router(self, name: str) -> Router:
        """Start the router of a process. Raises BusError if there is one already."""
        if self.has_router:
            raise BusError(f"{self.ENDPOINT}: another program listens there")
        self.router = Router(self.scheduler, name, self.late)
        return self.router

    def end_router(self, name: str, share: float = 1.0) -> None:
        """End the router of a process. `share`: how much of what it has sent still arrives."""
        if self.router is not None and self.router.owner == name:
            self.router.close(share)

    @property
    def has_router(self) -> bool:
        """Whether a router listens."""
        return self.router is not None and self.router.is_open

    def links_of(self, name: str) -> list[Link]:
        """Return the links of a process, without the direct one of a router's own session."""
        links = []
        for bus in self.sessions:
            if bus.name != name or bus.link is None or isinstance(bus.link, DirectLink):
                continue
            links.append(bus.link)
        return links

    def cut(self, name: str, seconds: float) -> None:
        """Close the links of a process; it cannot connect again for so long."""
        self._cut_until[name] = self.scheduler.now + seconds
        for link in self.links_of(name):
            link.close()

    def freeze(self, name: str) -> Callable[[], None]:
        """Let a process take no part. Return a function that ends that.

        If the process has the router, no link works meanwhile.
        """
        self._frozen[name] = self._frozen.get(name, 0) + 1
        has_router = any(
            bus.name == name and isinstance(bus.link, DirectLink) for bus in self.sessions
        )
        if has_router and self.router is not None:
            links = list(self.router.links.values())
        else:
            links = self.links_of(name)
        speak = self._silenced(links, (UP, DOWN))

        def thaw() -> None:
            self._frozen[name] -= 1
            speak()

        return thaw

    def after_messages(
        self, name: str, count: int, act: Callable[[], None], only_queries: bool
    ) -> None:
        """Let `act` happen when a process is about to send its `count`-th message from now on.

        `only_queries`: only queries count.
        """
        for bus in self.sessions:
            if bus.name == name:
                bus.fuse = Fuse(count, act, only_queries)

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
