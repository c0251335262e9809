"""A link between a session and the router of the simulated network, with delays and faults.

session.py stands at one side of a link, router.py at the other. What is sent is a function that is
called when it arrives.

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
# s after which the other side of a link notices that one side has closed it.
NOTICED_SECONDS = 0.01
# Lanes.
DATA = 0
CONTROL = 1
# Directions: to the router, and from it. They are, too, the indices of the side that sends in that
# direction: the session is 0, the router 1.
UP = 0
DOWN = 1


# Bytes of a payload from which on its size counts, as those of a packet on Ethernet: a smaller one
# is sent together with others.
LARGE = 1500
# Bytes of the messages of a tick that wait for each other on a link, in the scenes of schedules.
OF_A_TICK = 20_000


class Delays(NamedTuple):
    """How long messages take on one link."""

    typical: float = 1e-3  # s, the mean of most messages
    slow: float = 0.1  # s, the most that a slow message takes
    share: float = 0.02  # of messages that are slow
    bytes_per_second: float = inf

    @property
    def there_and_back(self) -> float:
        """How long a message and its reply take on average, s."""
        size = OF_A_TICK / self.bytes_per_second
        return self.share * self.slow + 2.0 * (self.typical + size)

    def draw(self, random: Random) -> float:
        """Return how long a message takes, s."""
        part = random.random()
        if random.random() < self.share:
            return part * self.slow
        return part * 2.0 * self.typical

    def to_send(self, size: int) -> float:
        """Return how long a payload of so many bytes keeps the link busy, s."""
        if size < LARGE:
            return 0.0
        return size / self.bytes_per_second


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
        # Whether it is open as the session sees it, and as the router sees it.
        self.is_open = [True, True]
        # Direction -> lane -> s, virtual: the newest arrival.
        self._last = [[0.0, 0.0], [0.0, 0.0]]
        # Direction -> s, virtual: when all that was sent has left.
        self._free_at = [0.0, 0.0]
        # Direction -> how many faults silence it.
        self._silent = [0, 0]
        # Direction -> the number of the silence that lasts; 0 without one.
        self._since = [0, 0]
        # How many silences have begun.
        self._silences = 0
        # Direction -> what waits for the end of its silence.
        self._waiting: list[list[Callable[[], None]]] = [[], []]
        # Whether a sender waits, because a silent direction holds ROOM messages.
        self._is_full = False
        # What changes payloads on their way; None: nothing does.
        self.tearer: Tearer | None = None

    def carried(self, key: str, payload: bytes, is_reply: bool = False) -> bytes:
        """Return a payload as it arrives at the other side, in either direction."""
        if self.tearer is None:
            return payload
        return self.tearer.carry(key, payload, is_reply)

    def send(
        self,
        way: int,
        act: Callable[[], None],
        lane: int = DATA,
        may_drop: bool = False,
        size: int = 0,
    ) -> None:
        """Let `act` happen at the other side, unless the message is lost.

        `way`: the direction. `may_drop`: the message is lost if the link is full. `size`: of its
        payload, bytes.
        """
        if not self.is_open[way]:
            return
        if self._silent[way] and len(self._waiting[way]) >= ROOM:
            if may_drop:
                return
            self._close_if_full()
        last = self._last[way]
        now = self._scheduler.now
        # It arrives after all that it must not overtake.
        before = max(last)
        if lane == CONTROL:
            before = last[CONTROL]
        leaves_at = max(now, self._free_at[way]) + self._delays.to_send(size)
        self._free_at[way] = leaves_at
        at = max(before, leaves_at + self._delays.draw(self._random))
        last[lane] = at
        self._scheduler.after(at - now, partial(self._arrive, way, act))

    def _close_if_full(self) -> None:
        """Close the link after FULL_SECONDS, unless it takes messages again by then."""

        def close_now() -> None:
            if self._is_full:
                self.close()

        if not self._is_full:
            self._is_full = True
            self._scheduler.after(FULL_SECONDS, close_now)

    def _arrive(self, way: int, act: Callable[[], None]) -> None:
        """Let a message arrive, or wait for the end of a silence."""
        receiver = 1 - way
        if self._silent[way]:
            self._waiting[way].append(act)
        elif self.is_open[receiver]:
            act()

    def silence(self, ways: Iterable[int]) -> None:
        """Let nothing through until `speak`.

        After LEASE the side that hears nothing closes the link.
        """
        for way in ways:
            self._silent[way] += 1
            self._silences += 1
            self._scheduler.after(LEASE, partial(self._close_if_silent, way, self._silences))
            # A silence that begins while another one lasts is part of that.
            if self._since[way] == 0:
                self._since[way] = self._silences

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
        """Close a link at the side that hears nothing, if a silence lasts.

        `number`: of the silence that began LEASE ago. One that has begun later does not count.
        """
        if 0 < self._since[way] <= number:
            self.close(session=way == DOWN, router=way == UP)

    def end(self, way: int, share: float) -> None:
        """Close it from the side that sends in a direction.

        `share`: how much of what that side has sent still arrives.

        The other side of a silent link does not hear that it is closed. It notices that after
        LEASE, or when the silence ends.
        """
        under_way = max(self._last[way]) - self._scheduler.now
        self.is_open[way] = False
        self._scheduler.after(max(0.0, under_way) * share, self._close_if_heard)
        self._scheduler.after(LEASE, self.close)

    def _close_if_heard(self) -> None:
        """Close it at both sides, unless a silence keeps that from the other side."""
        if not any(self._silent):
            self.close()

    def close(self, session: bool = True, router: bool = True) -> None:
        """Close it, as one side or both see it.

        If only one side sees it closed, the other one notices soon that the socket is gone, or
        after LEASE if the link is silent.
        """
        if router and self.is_open[DOWN]:
            self.is_open[DOWN] = False
            self.router.lose(self)
        if session and self.is_open[UP]:
            self.is_open[UP] = False
            self.session.lose(self)
        if any(self.is_open):
            noticed_after = NOTICED_SECONDS
            if any(self._silent):
                noticed_after = LEASE
            self._scheduler.after(noticed_after, self.close)


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
