"""Publishes the messages of physics. Most are packed only if a session subscribes to them.

Sessions with agents get what these observe. Observers, such as the logger and viewers, get events,
letters and pictures, several ticks in one message, the bundle: ten small messages cost six times as
much as one.
"""

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

# s, on the clock of the bus, between two checks for subscribers.
RECHECK_SECONDS = 0.05
# A bundle is sent after so many ticks, or after so many seconds, on the clock of the bus.
BUNDLE_TICKS = 10
BUNDLE_SECONDS = 0.05


class Publisher:
    """Publishes the messages of physics."""

    def __init__(
        self, bus: Bus, keys: Keys, run: str, layout: Layout, newest_wins: bool = False
    ) -> None:
        """`newest_wins`: publish what belongs to a tick without waiting for slow subscribers: they
        miss some ticks then.
        """
        self._bus = bus
        self._keys = keys
        self.run = run
        self._layout = layout
        self._newest_wins = newest_wins
        # Keys -> whether a session subscribes, as of the last check.
        self._heard: dict[str, bool] = {}
        self._recheck_at = 0.0  # s, on the clock of the bus
        # Kind -> messages that wait to be sent in the next bundle, in the order of its fields.
        self._bundle: dict[str, list[Any]] = {"events": [], "letters": [], "picture": []}
        self._bundled_at = 0.0  # s, on the clock of the bus, when a bundle was last sent

    # -- a tick

    def show(
        self, seen: Observations, due: Mapping[str, Sequence[str]], asked: Sequence[AskedOf]
    ) -> None:
        """Send each session what its agents observe that are asked, and the requests to them.

        `due`: session id -> its agents that are asked. `asked`: all requests of the tick before.
        """
        for owner, names in due.items():
            heard = [request for request in asked if request.to in names]
            self._put(self._keys.of("seen", session=owner), seen_of(self.run, seen, names, heard))

    def publish_tick(
        self, seen: Observations, others: Mapping[str, Callable[[], Observations]]
    ) -> None:
        """Publish poses, scans, other views and the clock: each if a session subscribes to it.

        `others`: 'truth', 'odometry' -> what makes the view.
        """
        if self._bus.clock() >= self._recheck_at:
            self.refresh_subscribers()
        if self.are_robots_heard():
            self._put_poses("pose", seen)
            for kind, make_view in others.items():
                if self.is_heard(kind):
                    self._put_poses(kind, make_view())
            self._put_scans(seen)
        if self.is_heard("clock"):
            seconds, ticks = divmod(seen.tick, TICKS_PER_SECOND)
            stamp = Stamp(seconds, ticks * (10**9 // TICKS_PER_SECOND))
            self._put(self._keys.of("clock"), Clock(self.run, seen.tick, stamp))

    def retire(self, owners: Iterable[str]) -> None:
        """Remove the publishers of sessions that do not own an agent any more."""
        for owner in owners:
            self._bus.retire(self._keys.of("seen", session=owner))

    def _put_poses(self, kind: str, seen: Observations) -> None:
        """Publish the pose of each body on its key of a kind, if a session subscribes to it."""
        for name in seen.names:
            key = self._keys.of(kind, name)
            if self._is_heard(key):
                self._put(key, odometry_of(self.run, seen[name]))

    def _put_scans(self, seen: Observations) -> None:
        """Publish the scan of each body, if a session subscribes to it."""
        for name, start in zip(seen.names, self._layout.starts, strict=True):
            key = self._keys.of("scan", name)
            if self._is_heard(key):
                laser = KINDS[start.kind].laser
                self._put(key, scan_of(self.run, seen[name], laser, KINDS["bin"].laser))

    def publish_velocity(self, name: str, owner: str, tick: int, report: Report) -> None:
        """Publish the velocity of one agent of a session, if a session subscribes to it."""
        key = self._keys.of("velocity", name)
        if self._is_heard(key):
            x, y, turn = report.twist
            velocity = Velocity(
                run=self.run,
                tick=tick,
                linear=Linear(x, y),
                angular=Angular(turn),
                owner=owner,
                once=report.once,
                deeds=report.deeds,
            )
            self._bus.publish(key, pack(velocity))

    def _put(self, key: str, message: SubMessage) -> None:
        """Publish what belongs to a tick."""
        self._bus.publish(key, pack(message), self._newest_wins)

    def publish_lost(self, tick: int, released: dict[str, list[str]]) -> None:
        """Tell sessions that physics no longer waits for their agents, session id -> names."""
        self.send_bundle(tick)
        for owner, names in released.items():
            log.warning(
                "no answer to tick %d from %s: no longer waited for", tick, ", ".join(names)
            )
            self.publish("lost", Lost(self.run, tick, names, owner))

    # -- what observers get

    def tell(self, kind: str, message: Callable[[], Message]) -> None:
        """Publish what belongs to a step, on the key of its kind and in the next bundle.

        It does each only if a session subscribes to it; but events, which are rare, always have
        their key. `message`: makes the message.
        """
        is_on_its_key = kind == "events" or self.is_heard(kind)
        is_bundled = self.is_heard("bundle")
        if not is_on_its_key and not is_bundled:
            return
        news = message()
        if is_on_its_key:
            self.publish(kind, news)
        if is_bundled:
            self._bundle[kind].append(news)

    def is_bundle_due(self) -> bool:
        """Whether enough messages wait to be sent, or whether the last bundle is long ago."""
        is_late = self._bus.clock() >= self._bundled_at + BUNDLE_SECONDS
        return is_late or len(self._bundle["picture"]) >= BUNDLE_TICKS

    def send_bundle(self, tick: int) -> None:
        """Send what waits to be sent.

        It is called, too, before a message that a logger must hear after what waits.
        """
        self._bundled_at = self._bus.clock()
        if any(self._bundle.values()):
            self.publish("bundle", Bundle(self.run, tick, *self._bundle.values()))
            for kind in self._bundle:
                self._bundle[kind] = []

    # -- subscribers

    def refresh_subscribers(self) -> None:
        """Forget which keys have subscribers, so that the bus is asked again.

        That is done every RECHECK_SECONDS, and when a tick is sent again.
        """
        self._heard = {}
        self._recheck_at = self._bus.clock() + RECHECK_SECONDS

    def is_heard(self, kind: str) -> bool:
        """Whether a session subscribes to a kind of key of `wire.keys.TABLE`."""
        return self._is_heard(self._keys.of(kind))

    def are_robots_heard(self) -> bool:
        """Whether a session subscribes to any key of a robot: its pose, scan or velocity."""
        return self._is_heard(f"{self._keys.prefix}/*/*")

    def _is_heard(self, keys: str) -> bool:
        """Whether a session subscribes to these keys, as of the last check."""
        if keys not in self._heard:
            self._heard[keys] = self._bus.is_heard(keys)
        return self._heard[keys]

    def publish(self, kind: str, message: Message) -> None:
        """Publish a message on a kind of key."""
        self._bus.publish(self._keys.of(kind), pack(message))
