"""Publishes the messages of physics. Most are packed only if a session subscribes to them."""

import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from orchard.contract.agent import Observations
from orchard.contract.messages import pack
from orchard.field.kinds import KINDS
from orchard.field.layout import Layout
from orchard.field.scenario import TICKS_PER_SECOND
from orchard.net.bus import Bus
from orchard.wire.codec import odometry_of, scan_of, seen_of
from orchard.wire.keys import Keys
from orchard.wire.messages import (
    Angular,
    AskedOf,
    Bundle,
    Clock,
    Linear,
    Lost,
    Message,
    Report,
    Stamp,
    SubMessage,
    Velocity,
)

log = logging.getLogger("orchard")

RECHECK_SECONDS = 0.05  # between two checks for subscribers
BUNDLE_TICKS, BUNDLE_SECONDS = 10, 0.05  # of a bundle at most, on the clock of the bus


class Publisher:
    """Publishes the messages of physics."""

    def __init__(
        self, bus: Bus, keys: Keys, run: str, layout: Layout, newest_wins: bool = False
    ) -> None:
        """`newest_wins`: publish what belongs to a tick without waiting; a slow subscriber misses some."""
        self._bus, self._keys, self.run, self._layout, self._newest_wins = (
            bus,
            keys,
            run,
            layout,
            newest_wins,
        )
        self._heard: dict[
            str, bool
        ] = {}  # keys -> whether a session subscribes, as of the last check
        self._recheck_at = 0.0  # s, on the clock of the bus
        self._bundle: dict[str, list[Any]] = {
            "events": [],
            "letters": [],
            "picture": [],
        }  # what is told, and not sent yet
        self._bundled_at = 0.0  # s, on the clock of the bus, when it was last sent

    # -- a tick

    def show(
        self, seen: Observations, due: Mapping[str, Sequence[str]], asked: Sequence[AskedOf]
    ) -> None:
        """Send each session in `due` what its agents observe that are asked; and the requests in `asked` to them."""
        for owner, names in due.items():
            heard = [of for of in asked if of.to in names]
            self._put(self._keys.of("seen", session=owner), seen_of(self.run, seen, names, heard))

    def publish_tick(
        self, seen: Observations, others: Mapping[str, Callable[[], Observations]]
    ) -> None:
        """Publish poses, scans, the views in `others` (`truth`, `odometry`), and the clock: each if a session subscribes to it."""
        if self._bus.clock() >= self._recheck_at:
            self.refresh_subscribers()
        if self.are_robots_heard():
            heard = {what: view() for what, view in others.items() if self.is_heard(what)}
            for what, view in [("pose", seen), *heard.items(), ("scan", seen)]:
                for body, name in enumerate(seen.names):
                    self._put_single(what, view, body, name)
        if self.is_heard("clock"):
            sec, ticks = divmod(seen.tick, TICKS_PER_SECOND)
            self._put(
                self._keys.of("clock"),
                Clock(self.run, seen.tick, Stamp(sec, ticks * (10**9 // TICKS_PER_SECOND))),
            )

    def retire(self, owners: Iterable[str]) -> None:
        """Remove the publishers of sessions that do not own an agent any more."""
        for owner in owners:
            self._bus.retire(self._keys.of("seen", session=owner))

    def _put_single(self, what: str, seen: Observations, body: int, name: str) -> None:
        key = self._keys.of(what, name)
        if self._is_heard(key) and what != "scan":
            self._put(key, odometry_of(self.run, seen[name]))
        elif self._is_heard(key):
            self._put(
                key,
                scan_of(
                    self.run,
                    seen[name],
                    KINDS[self._layout.starts[body].kind].laser,
                    KINDS["bin"].laser,
                ),
            )

    def publish_velocity(self, name: str, owner: str, tick: int, report: Report) -> None:
        if self._is_heard(key := self._keys.of("velocity", name)):
            x, y, turn = report.twist
            self._bus.publish(
                key,
                pack(
                    Velocity(
                        self.run,
                        tick,
                        Linear(x, y),
                        Angular(turn),
                        owner,
                        report.once,
                        report.deeds,
                    )
                ),
            )

    def _put(self, key: str, message: SubMessage) -> None:
        self._bus.publish(key, pack(message), self._newest_wins)

    def publish_lost(self, tick: int, released: dict[str, list[str]]) -> None:
        self.send_bundle(tick)
        for owner, names in released.items():
            log.warning(
                "no answer to tick %d from %s: no longer waited for", tick, ", ".join(names)
            )
            self.publish("lost", Lost(self.run, tick, names, owner))

    # -- what observers get

    def tell(self, what: str, message: Callable[[], Message]) -> None:
        """Publish what belongs to a step, on its own key and in the next bundle: each if a session subscribes to it."""
        alone, together = what == "events" or self.is_heard(what), self.is_heard("bundle")
        if alone or together:
            told = message()
            if alone:
                self.publish(what, told)
            if together:
                self._bundle[what].append(told)

    def is_bundle_due(self) -> bool:
        return (
            len(self._bundle["picture"]) >= BUNDLE_TICKS
            or self._bus.clock() >= self._bundled_at + BUNDLE_SECONDS
        )

    def send_bundle(self, tick: int) -> None:
        """Send what waits to be sent, before all that a logger must hear after it."""
        self._bundled_at = self._bus.clock()
        if any(self._bundle.values()):
            self.publish("bundle", Bundle(self.run, tick, *self._bundle.values()))
            self._bundle = {each: [] for each in self._bundle}

    # -- subscribers

    def refresh_subscribers(self) -> None:
        """Forget which keys have subscribers: every RECHECK_SECONDS, and when a tick is sent again."""
        self._heard, self._recheck_at = {}, self._bus.clock() + RECHECK_SECONDS

    def is_heard(self, what: str) -> bool:
        """Whether a session subscribes to a key of `wire.keys.TABLE`."""
        return self._is_heard(self._keys.of(what))

    def are_robots_heard(self) -> bool:
        """Whether a session subscribes to any key of a robot, such as its pose, scan or velocity."""
        return self._is_heard(f"{self._keys.prefix}/*/*")

    def _is_heard(self, keys: str) -> bool:
        if keys not in self._heard:
            self._heard[keys] = self._bus.is_heard(keys)
        return self._heard[keys]

    def publish(self, what: str, message: Message) -> None:
        self._bus.publish(self._keys.of(what), pack(message))
