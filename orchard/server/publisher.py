"""What physics says to all: what is to be seen, the clock, what happened, who is lost. What nobody listens to is not even packed."""

import logging
import time
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from orchard.contract.messages import Written, pack
from orchard.contract.observations import Observations
from orchard.field.kinds import KINDS
from orchard.field.layout import Layout
from orchard.net.bus import Bus
from orchard.wire.codec import odometry_of, scan_of, seen_of
from orchard.wire.keys import Keys
from orchard.wire.messages import AskedOf, Clock, Events, Letters, Lost, Stamp, Velocity
from orchard.wire.types import Message

if TYPE_CHECKING:
    from orchard.contract.events import Event

log = logging.getLogger("orchard")

EARS_SECONDS = 0.05  # between two looks who listens


class Publisher:
    """What physics says."""

    def __init__(self, bus: Bus, keys: Keys, run: str, layout: Layout, newest_wins: bool = False) -> None:
        """With `newest_wins` a tick's poses, scans and clock hold nobody up: who is slow misses some."""
        self._bus, self._keys, self.run, self._layout = bus, keys, run, layout
        self._newest_wins = newest_wins
        self._robots = f"{keys.prefix}/*/*"
        self._heard: dict[str, bool] = {}  # keys -> whether anybody listens, as of the last look
        self._look_again = 0.0  # on the clock

    # -- a tick

    def look(self, seen: Observations, holders: Mapping[str, Collection[str]], asked: Sequence[AskedOf]) -> None:
        """What is to be seen and who was asked, to each session what concerns it; each pose and scan to whoever listens; then the clock."""
        if time.monotonic() >= self._look_again:
            self.listen()
        for holder, names in holders.items():
            self._show(seen, holder, names, [of for of in asked if of.to in names])
        for what in ("pose", "scan") if self.are_robots_heard() else ():
            for body, name in enumerate(seen.names):
                self._show_alone(what, seen, body, name)
        if self.is_heard("clock"):
            sec, tenths = divmod(seen.tick, 10)
            self._put(self._keys.of("clock"), Clock(self.run, seen.tick, Stamp(sec, tenths * 10**8)))

    def _show(self, seen: Observations, holder: str, names: Collection[str], asked: list[AskedOf]) -> None:
        bodies = [self._layout.index[name] for name in names if name in self._layout.index]
        self._put(self._keys.of("seen", session=holder), seen_of(self.run, seen, bodies, asked))

    def part(self, holders: Iterable[str]) -> None:
        """These sessions hold nothing any more: nothing is to be shown to them."""
        for holder in holders:
            self._bus.retire(self._keys.of("seen", session=holder))

    def _show_alone(self, what: str, seen: Observations, body: int, name: str) -> None:
        key = self._keys.of(what, name)
        if not self._is_heard(key):
            return
        if what == "pose":
            self._put(key, odometry_of(self.run, seen[name]))
        else:
            laser = KINDS[self._layout.starts[body].kind].laser
            self._put(key, scan_of(self.run, seen[name], laser, KINDS["bin"].laser))

    def driven(self, name: str, velocity: Velocity) -> None:
        """A velocity that came with others, to those who listen on its robot's key."""
        if self._is_heard(self._keys.of("velocity", name)):
            self._bus.publish(self._keys.of("velocity", name), pack(velocity))

    def _put(self, key: str, message: Message) -> None:
        self._bus.publish(key, pack(message), self._newest_wins)

    # -- what happened

    def happened(self, tick: int, events: "list[Event]") -> None:
        if events:
            self.say("events", Events(self.run, tick, events))

    def wrote(self, tick: int, letters: dict[str, Written]) -> None:
        if letters and self.is_heard("letters"):
            self.say("letters", Letters(self.run, tick, letters))

    def lost(self, tick: int, released: dict[str, list[str]]) -> None:
        for holder, names in released.items():
            log.warning("no answer to tick %d from %s: no longer waited for", tick, ", ".join(names))
            self.say("lost", Lost(self.run, tick, names, holder))

    # -- who listens

    def listen(self) -> None:
        """Find out anew who listens: that is done now and then, and when a session joins."""
        self._heard, self._look_again = {}, time.monotonic() + EARS_SECONDS

    def is_heard(self, what: str) -> bool:
        """Whether somebody listens to a key of that kind."""
        return self._is_heard(self._keys.of(what))

    def are_robots_heard(self) -> bool:
        """Whether somebody listens to a robot's pose, scan or velocity."""
        return self._is_heard(self._robots)

    def _is_heard(self, keys: str) -> bool:
        if keys not in self._heard:
            self._heard[keys] = self._bus.is_heard(keys)
        return self._heard[keys]

    def say(self, what: str, message: Message) -> None:
        self._bus.publish(self._keys.of(what), pack(message))
