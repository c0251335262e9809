"""Publishes observations, the clock, events, frames and figures. Most are packed only if a session subscribes to them."""

import logging
import time
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

from orchard.contract.agent import Action, Observations
from orchard.contract.messages import Written, pack
from orchard.field.kinds import KINDS
from orchard.field.layout import Layout
from orchard.field.scenario import TICKS_PER_SECOND
from orchard.net.bus import Bus
from orchard.net.refusals import RefusalTotals
from orchard.net.roster import RecoveryLog
from orchard.server.figures import RunFigures
from orchard.sim.frames import FrameBuilder
from orchard.wire.codec import odometry_of, picture_of, scan_of, seen_of
from orchard.wire.keys import Keys
from orchard.wire.messages import AskedOf, Clock, Events, Letters, Lost, Stamp, Velocity
from orchard.wire.types import Message

if TYPE_CHECKING:
    from orchard.contract.events import Event
    from orchard.sim.engine import Engine

log = logging.getLogger("orchard")

RECHECK_SECONDS = 0.05  # between two checks for subscribers


class Publisher:
    """Publishes the messages of physics."""

    def __init__(self, bus: Bus, keys: Keys, run: str, layout: Layout, newest_wins: bool = False) -> None:
        """`newest_wins`: publish a tick's observations, poses, scans and clock without waiting; a slow subscriber misses some."""
        self._bus, self._keys, self.run, self._layout = bus, keys, run, layout
        self._newest_wins = newest_wins
        self._robots = f"{keys.prefix}/*/*"
        self._heard: dict[str, bool] = {}  # keys -> whether a session subscribes, as of the last check
        self._recheck_at = 0.0  # s, monotonic clock

    # -- a tick

    def publish_tick(self, seen: Observations, holders: Mapping[str, Collection[str]], asked: Sequence[AskedOf]) -> None:
        """Send each session the observations of its agents and the requests to them; then single poses and scans; then the clock.

        `holders`: session id -> the names that it holds. `asked`: the requests of the last tick.
        """
        if time.monotonic() >= self._recheck_at:
            self.refresh_subscribers()
        for holder, names in holders.items():
            self._put_seen(seen, holder, names, [of for of in asked if of.to in names])
        for what in ("pose", "scan") if self.are_robots_heard() else ():
            for body, name in enumerate(seen.names):
                self._put_single(what, seen, body, name)
        if self.is_heard("clock"):
            sec, ticks = divmod(seen.tick, TICKS_PER_SECOND)
            self._put(self._keys.of("clock"), Clock(self.run, seen.tick, Stamp(sec, ticks * (10**9 // TICKS_PER_SECOND))))

    def _put_seen(self, seen: Observations, holder: str, names: Collection[str], asked: list[AskedOf]) -> None:
        bodies = [self._layout.index[name] for name in names if name in self._layout.index]
        self._put(self._keys.of("seen", session=holder), seen_of(self.run, seen, bodies, asked))

    def retire(self, holders: Iterable[str]) -> None:
        """Remove the publishers of sessions that do not hold an agent any more."""
        for holder in holders:
            self._bus.retire(self._keys.of("seen", session=holder))

    def _put_single(self, what: str, seen: Observations, body: int, name: str) -> None:
        key = self._keys.of(what, name)
        if not self._is_heard(key):
            return
        if what == "pose":
            self._put(key, odometry_of(self.run, seen[name]))
        else:
            laser = KINDS[self._layout.starts[body].kind].laser
            self._put(key, scan_of(self.run, seen[name], laser, KINDS["bin"].laser))

    def publish_velocity(self, name: str, velocity: Velocity) -> None:
        """Publish a velocity that came in a session's message on the key of its robot, if a session subscribes to that."""
        if self._is_heard(self._keys.of("velocity", name)):
            self._bus.publish(self._keys.of("velocity", name), pack(velocity))

    def _put(self, key: str, message: Message) -> None:
        self._bus.publish(key, pack(message), self._newest_wins)

    # -- results of steps

    def publish_events(self, tick: int, events: "list[Event]") -> None:
        """Publish the events of the step from `tick`, if there are any."""
        if events:
            self.publish("events", Events(self.run, tick, events))

    def publish_letters(self, tick: int, letters: dict[str, Written]) -> None:
        """Publish the letters of a tick, if there are any. `letters`: sender -> its letters."""
        if letters and self.is_heard("letters"):
            self.publish("letters", Letters(self.run, tick, letters))

    def publish_lost(self, tick: int, released: dict[str, list[str]]) -> None:
        """Publish and log that agents have lost their holder. `released`: session id -> the names that it held."""
        for holder, names in released.items():
            log.warning("no answer to tick %d from %s: no longer waited for", tick, ", ".join(names))
            self.publish("lost", Lost(self.run, tick, names, holder))

    # -- subscribers

    def refresh_subscribers(self) -> None:
        """Forget which keys have subscribers, so that they are checked again: every RECHECK_SECONDS, and when a tick is sent again."""
        self._heard, self._recheck_at = {}, time.monotonic() + RECHECK_SECONDS

    def is_heard(self, what: str) -> bool:
        """Whether a session subscribes to a key of `wire.keys.TABLE`."""
        return self._is_heard(self._keys.of(what))

    def are_robots_heard(self) -> bool:
        """Whether a session subscribes to any key of a robot, such as its pose, scan or velocity."""
        return self._is_heard(self._robots)

    def _is_heard(self, keys: str) -> bool:
        if keys not in self._heard:
            self._heard[keys] = self._bus.is_heard(keys)
        return self._heard[keys]

    def publish(self, what: str, message: Message) -> None:
        """Publish a message. `what`: its key in `wire.keys.TABLE`."""
        self._bus.publish(self._keys.of(what), pack(message))


class FinishedStep(NamedTuple):
    """A step: its tick, its events, and the actions that it applied."""

    tick: int
    events: "list[Event]"
    actions: dict[str, Action]


class StepReporter:
    """Reports each step later, while the agents think about the next one."""

    def __init__(
        self, engine: "Engine", account: RunFigures, publisher: Publisher, ledger: RecoveryLog, refusal_totals: RefusalTotals
    ) -> None:
        self._engine, self._publisher, self._ledger, self._refusal_totals = engine, publisher, ledger, refusal_totals
        self.account, self.frame_builder = account, FrameBuilder(engine.world)
        self._pending: FinishedStep | None = None  # not reported yet

    def begin(self) -> None:
        """Start the figures' wall clock, and publish the first figures."""
        self.account.begin()
        self._publish_figures()

    def add(self, step: FinishedStep) -> None:
        """Store a step for the next call of `report`."""
        self._pending = step

    def report(self) -> None:
        """Count and publish the results of the stored step, if there is one."""
        if self._pending is None:
            return
        (tick, events, actions), self._pending = self._pending, None
        self.account.update(events, actions)
        self._publisher.publish_events(tick, events)
        self._publisher.publish_letters(tick, self._ledger.letters.get(tick, {}))
        if self._publisher.is_heard("picture"):
            frame = self.frame_builder.frame(self._engine.scans, actions, events)
            self._publisher.publish("picture", picture_of(self._publisher.run, frame))
        if self.account.is_due():
            self._publish_figures()

    def _publish_figures(self) -> None:
        self._publisher.publish("figures", self.account.message(self._publisher.run, self._refusal_totals.total()))
