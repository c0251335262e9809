"""What physics says to all: poses and scans, the clock, what happened, who is lost."""

import logging
from collections.abc import Container
from typing import TYPE_CHECKING

import msgspec

from orchard import wire
from orchard.agent import Observation
from orchard.bus import Bus
from orchard.keys import Keys
from orchard.kinds import KINDS, Laser
from orchard.layout import Layout
from orchard.messages import pack

if TYPE_CHECKING:
    from orchard.events import Event

log = logging.getLogger("orchard")


class Announcer:
    """What physics says."""

    def __init__(self, bus: Bus, keys: Keys, run: str, layout: Layout, newest_wins: bool = False) -> None:
        """With `newest_wins` a tick's poses, scans and clock hold nobody up: who is slow misses some."""
        self._bus, self._keys, self.run = bus, keys, run
        self._newest_wins = newest_wins
        self._bodies = [(s.name, KINDS[s.kind].laser, keys.of("pose", s.name), keys.of("scan", s.name)) for s in layout.starts]

    def look(self, tick: int, seen: dict[str, Observation], holders: dict[str, list[str]], names: Container[str] | None = None) -> None:
        """Poses and scans of a tick, all or those of some, each on its key; all of a session's together; and then the clock."""
        sent = {body[0]: self._show(seen[body[0]], *body[1:]) for body in self._bodies if names is None or body[0] in names}
        for holder, held in holders.items():
            if len(held) > 1:
                bodies = {name: sent[name] for name in held if name in sent}
                self._bus.publish(self._keys.of("seen", session=holder), pack(wire.Seen(self.run, tick, bodies)), self._newest_wins)
        sec, tenths = divmod(tick, 10)
        clock = wire.Clock(self.run, tick, wire.Stamp(sec, tenths * 10**8))
        self._bus.publish(self._keys.of("clock"), pack(clock), self._newest_wins)

    def _show(self, seen: Observation, laser: Laser, pose_key: str, scan_key: str) -> tuple[bytes, bytes]:
        pose = pack(wire.odometry_of(self.run, seen))
        scan = pack(wire.scan_of(self.run, seen, laser, KINDS["bin"].laser))
        self._bus.publish(pose_key, pose, self._newest_wins)
        self._bus.publish(scan_key, scan, self._newest_wins)
        return pose, scan

    def happened(self, tick: int, events: "list[Event]") -> None:
        if events:
            self.say("events", wire.Events(self.run, tick, msgspec.to_builtins(events)))

    def lost(self, tick: int, released: dict[str, list[str]]) -> None:
        for holder, names in released.items():
            log.warning("no answer to tick %d from %s: no longer waited for", tick, ", ".join(names))
            self.say("lost", wire.Lost(self.run, tick, names, holder))

    def say(self, what: str, message: wire.Message) -> None:
        self._bus.publish(self._keys.of(what), pack(message))
