"""A link between a session and the router of the simulated network, with delays and faults.

- A link has two directions, and each has two lanes: declarations (subscribers, queryables, tokens)
  may overtake data, and data never declarations. A lane keeps its order.
- A link that is silent for LEASE seconds is closed by each side that notices it; what is under way
  is lost; the client connects again.
- A receiver that takes nothing fills its link: samples that may be dropped are lost, others close
  the link after a moment.
- A large payload takes longer than a small one, and what is sent after it waits.
"""

from collections.abc import Callable, Iterable
from functools import partial
from math import inf
from random import Random
from typing import NamedTuple, Protocol

from chaos.simulated.scheduler import Scheduler
from chaos.simulated.tearing import Tearer
from orchard.net.zenoh_bus import FULL_QUEUE_US, LEASE_MS

LEASE = LEASE_MS / 1000.0  # s
FULL_SECONDS = FULL_QUEUE_US / 1e6  # s that a full link may stay full
ROOM = 40  # messages that a silent link holds in each direction
# Lanes.
DATA = 0
CONTROL = 1
# Directions: to the router, and from it.
UP = 0
DOWN = 1


# The bytes of a payload from which on its size counts: a smaller one is sent together with others.
LARGE = 1500
# The bytes of the messages of a tick that wait for each other on a link, in the scenes of
# schedules.
OF_A_TICK = 20_000


class Delays(NamedTuple):
    """How long messages take on one link.

    `typical`, `slow`: s; `share`: of messages that are slow.
    """

    typical: float = 1e-3
    slow: float = 0.1
    share: float = 0.02
    bytes_per_second: float = inf

    @property
    def there_and_back(self) -> float:
        """How long a message and its reply take on average, s."""
        size = OF_A_TICK / self.bytes_per_second
        return self.share * self.slow + 2.0 * (self.typical + size)

    def draw(self, random: Random) -> float:
        return random.random() * (self.slow if random.random() < self.share else 2.0 * self.typical)

    def to_send(self, size: int) -> float:
        """Return how long a payload of so many bytes keeps the link busy, s."""
        return size / self.bytes_per_second if size >= LARGE else 0.0


class SessionSide(Protocol):
    """What a link needs of the session at its one side: what the router sends there."""

    id: str

    def hear_sample(self, key: str, payload: bytes) -> None:
        """Take what was published."""

    def hear_token(self, token: str, up: bool) -> None:
        """Take a liveliness token that appeared (`up`) or is gone."""

    def hear_subscribers(self, keys: list[str]) -> None:
        """Take the keys to which others subscribe."""

    def hear_query(self, link: "Link", number: int, key: str, payload: bytes) -> None:
        """Take a query. Replies go back by the link, with the number."""

    def hear_reply(self, number: int, payload: bytes, error: str) -> None:
        """Take a reply to a query of its own."""

    def hear_final(self, number: int) -> None:
        """Know that no more replies come to a query of its own."""

    def lose(self, link: "Link") -> None:
        """Know that the link is closed."""


class RouterSide(Protocol):
    """What a link needs of the router at its other side: what a session sends there."""

    @property
    def scheduler(self) -> Scheduler:
        """The clock of both."""

    def connect(self, link: "Link") -> None:
        """Take a new link, with nothing declared yet."""

    def subscribe(self, link: "Link", keys: str) -> None:
        """Send what is published on some keys by the link."""

    def answer(self, link: "Link", key: str) -> None:
        """Send queries for a key by the link."""

    def interest(self, link: "Link") -> None:
        """Send by the link to which keys others subscribe."""

    def watch(self, link: "Link", tokens: str) -> None:
        """Send by the link which liveliness tokens appear and go."""

    def token(self, link: "Link", token: str, up: bool) -> None:
        """Take a liveliness token of the session, or its end."""

    def subscribers_beside(self, session: str) -> list[str]:
        """Return the keys to which other sessions subscribe."""

    def publish(self, link: "Link", key: str, payload: bytes, may_drop: bool) -> None:
        """Pass on what the session publishes."""

    def ask(self, link: "Link", number: int, key: str, payload: bytes) -> None:
        """Pass on a query of the session."""

    def reply(self, number: int, key: str, payload: bytes, error: str) -> None:
        """Pass on a reply to a query."""

    def finish(self, number: int, session: str) -> None:
        """Know that a session has replied to a query for the last time."""

    def forget_query(self, number: int) -> None:
        """Pass on no more replies to a query."""

    def lose(self, link: "Link") -> None:
        """Know that the link is closed."""


class Link:
    """A connection between a session and the router, from its opening until it is closed."""

    def __init__(
        self, session: SessionSide, router: RouterSide, delays: Delays, random: Random
    ) -> None:
        self.session = session
        self.router = router
        self._scheduler = router.scheduler
        self._delays = delays
        self._random = random
        self.is_open = [True, True]  # as the session sees it, as the router sees it
        self._last = [[0.0, 0.0], [0.0, 0.0]]  # direction -> lane -> s: the newest arrival
        self._free_at = [0.0, 0.0]  # direction -> s: when all that was sent has left
        self._silent = [0, 0]  # how many faults silence each direction
        self._since = [0, 0]  # the number of the silence that lasts, 0 without one
        self._silences = 0
        self._waiting: list[list[Callable[[], None]]] = [[], []]
        self._is_full = False
        self.tearer: Tearer | None = None

    def carried(self, key: str, payload: bytes, is_reply: bool = False) -> bytes:
        """Return a payload as it arrives at the other side, in either direction."""
        return payload if self.tearer is None else self.tearer.carry(key, payload, is_reply)

    def send(
        self,
        way: int,
        act: Callable[[], None],
        lane: int = DATA,
        may_drop: bool = False,
        size: int = 0,
    ) -> None:
        """Let `act` happen at the other side, unless the message is lost.

        `size`: of its payload, bytes.
        """
        if not self.is_open[way]:
            return
        if self._silent[way] and len(self._waiting[way]) >= ROOM:
            if may_drop:
                return
            self._close_if_full()  # its sender waits until then
        last = self._last[way]
        now = self._scheduler.now
        before = last[CONTROL] if lane == CONTROL else max(last)
        leaves_at = max(now, self._free_at[way]) + self._delays.to_send(size)
        self._free_at[way] = leaves_at
        at = max(before, leaves_at + self._delays.draw(self._random))
        last[lane] = at
        self._scheduler.after(at - now, partial(self._arrive, way, act))

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
        """Let nothing through until `speak`.

        After LEASE the side that hears nothing closes the link.
        """
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
                waiting = self._waiting[way]
                self._waiting[way] = []
                self._is_full = False
                self._since[way] = 0
                for act in waiting:
                    if all(self.is_open):
                        act()
        if not all(self.is_open):
            self._close_if_heard()

    def _close_if_silent(self, way: int, number: int) -> None:
        if 0 < self._since[way] <= number:
            self.close(session=way == DOWN, router=way == UP)

    def end(self, way: int, share: float) -> None:
        """Close it from the side that sends in a direction.

        `share`: how much of what it has sent still arrives.

        The other side of a silent link does not hear of it: it notices after LEASE, or as the
        silence ends.
        """
        under_way = max(self._last[way]) - self._scheduler.now
        self.is_open[way] = False
        self._scheduler.after(max(0.0, under_way) * share, self._close_if_heard)
        self._scheduler.after(LEASE, self.close)

    def _close_if_heard(self) -> None:
        if not any(self._silent):
            self.close()

    def close(self, session: bool = True, router: bool = True) -> None:
        """Close it, as one side or both see it.

        A side that it is not closed for notices soon: the other's socket is gone.
        """
        if router and self.is_open[1]:
            self.is_open[1] = False
            self.router.lose(self)
        if session and self.is_open[0]:
            self.is_open[0] = False
            self.session.lose(self)
        if any(self.is_open):
            self._scheduler.after(0.01 if not any(self._silent) else LEASE, self.close)


class DirectLink(Link):
    """The link of a router's own session: it has no fault.

    What the session sends is at the router at once. What arrives for it comes from another thread:
    a moment later.
    """

    def silence(self, ways: Iterable[int]) -> None:
        pass

    def speak(self, ways: Iterable[int]) -> None:
        pass

    def send(
        self,
        way: int,
        act: Callable[[], None],
        lane: int = DATA,
        may_drop: bool = False,
        size: int = 0,
    ) -> None:
        if way == DOWN:
            super().send(way, act, lane, may_drop)
        elif all(self.is_open):
            act()
