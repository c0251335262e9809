"""What physics says to all: what is to be seen, the clock, what happened, who is lost. What nobody listens to is not even packed."""

import logging
from collections.abc import Collection, Iterable, Mapping
from typing import TYPE_CHECKING

import msgspec

from orchard import wire
from orchard.bus import Bus
from orchard.keys import Keys
from orchard.kinds import KINDS
from orchard.layout import Layout
from orchard.messages import Written, pack
from orchard.sights import Sights

if TYPE_CHECKING:
    from orchard.events import Event

log = logging.getLogger("orchard")

class Announcer:
    """What physics says."""

    def __init__(self, bus: Bus, keys: Keys, run: str, layout: Layout, newest_wins: bool = False) -> None:
        """With `newest_wins` a tick's poses, scans and clock hold nobody up: who is slow misses some."""
        self._bus, self._keys, self.run, self._layout = bus, keys, run, layout
        self._newest_wins = newest_wins
        self._robots = f"{keys.prefix}/*/*"
        self._robots_heard = False  # whether anybody listens to any robot's key, at the present tick

    # -- a tick

    def look(self, seen: Sights, holders: Mapping[str, Collection[str]], recall: bool) -> None:
        """What is to be seen: to each session what concerns its agents; each pose and scan to whoever listens; and then the clock."""
        for holder, names in holders.items():
            self._show(seen, holder, names, recall)
        self._robots_heard = self._bus.is_heard(self._robots)
        for what in ("pose", "scan") if self._robots_heard else ():
            for body, name in enumerate(seen.names):
                self._show_alone(what, seen, body, name)
        if self.is_heard("clock"):
            sec, tenths = divmod(seen.tick, 10)
            self._put(self._keys.of("clock"), wire.Clock(self.run, seen.tick, wire.Stamp(sec, tenths * 10**8)))

    def _show(self, seen: Sights, holder: str, names: Iterable[str], recall: bool) -> None:
        bodies = [self._layout.index[name] for name in names if name in self._layout.index]
        self._put(self._keys.of("seen", session=holder), wire.seen_of(self.run, seen, bodies, recall))

    def _show_alone(self, what: str, seen: Sights, body: int, name: str) -> None:
        key = self._keys.of(what, name)
        if not self._bus.is_heard(key):
            return
        if what == "pose":
            self._put(key, wire.odometry_of(self.run, seen[name]))
        else:
            laser = KINDS[self._layout.starts[body].kind].laser
            self._put(key, wire.scan_of(self.run, seen[name], laser, KINDS["bin"].laser))

    def driven(self, velocities: wire.Velocities) -> None:
        """Each velocity of a session to those who listen on its robot's key."""
        if self._robots_heard:
            for name in velocities.velocities:
                key = self._keys.of("velocity", name)
                if self._bus.is_heard(key):
                    self._bus.publish(key, pack(wire.velocity_of(velocities, name)))

    def _put(self, key: str, message: wire.Message) -> None:
        self._bus.publish(key, pack(message), self._newest_wins)

    # -- what happened

    def happened(self, tick: int, events: "list[Event]") -> None:
        if events:
            self.say("events", wire.Events(self.run, tick, msgspec.to_builtins(events)))

    def wrote(self, tick: int, letters: dict[str, Written]) -> None:
        if letters and self.is_heard("letters"):
            self.say("letters", wire.Letters(self.run, tick, letters))

    def lost(self, tick: int, released: dict[str, list[str]]) -> None:
        for holder, names in released.items():
            log.warning("no answer to tick %d from %s: no longer waited for", tick, ", ".join(names))
            self.say("lost", wire.Lost(self.run, tick, names, holder))

    def is_heard(self, what: str) -> bool:
        """Whether somebody listens to a key of that kind."""
        return self._bus.is_heard(self._keys.of(what))

    def say(self, what: str, message: wire.Message) -> None:
        self._bus.publish(self._keys.of(what), pack(message))
