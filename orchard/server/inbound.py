"""What arrives at physics, one thing after the other, and whom it concerns: velocities, tokens, queries, signals."""

import math
import time
from contextlib import suppress

import msgspec

from orchard.net.bus import Alive, Bus, Item, Query, Sample, Signal
from orchard.net.endpoints import BusError
from orchard.net.refusals import Refused, read_message
from orchard.server.harvest import Harvest, RunEnded
from orchard.server.queries import Queries
from orchard.wire.keys import LOGGER, PHYSICS, Keys
from orchard.wire.messages import RefusedThere, Velocities, Velocity
from orchard.wire.types import Session

COMPANY_SECONDS = 3.0  # after physics has begun to listen: whose token comes later is the newcomer


class Inbound:
    """Hands on whatever arrives, and counts what is refused."""

    def __init__(self, bus: Bus, keys: Keys, harvest: Harvest) -> None:
        self._bus, self._keys, self._harvest = bus, keys, harvest
        self._queries = Queries(keys, harvest)
        self._alone_from = math.inf  # on the clock: who comes after that must go

    def listen(self) -> None:
        """From now on all of it arrives; the token, which tells the others that physics is there, comes last."""
        self._bus.subscribe(self._keys.of("velocities"), quietly=True)
        self._bus.subscribe(self._keys.of("velocity"), quietly=True)
        self._bus.subscribe(self._keys.of("refused"))
        for key in self._queries.asked():
            self._bus.answer(key)
        self._alone_from = time.monotonic() + COMPANY_SECONDS
        self._bus.watch(self._keys.of("alive"))
        self._bus.declare_alive(self._keys.of("alive", PHYSICS, self._harvest.run))

    def take(self, seconds: float, enough: int = 1) -> bool:
        """Handle one item; False if none came in time. Raises RunEnded where it ends the run."""
        item = self._bus.inbox.take(seconds, enough)
        if item is not None:
            try:
                self._handle(item)
            except Refused as refusal:
                self._harvest.refusal_totals.own.note(getattr(item, "key", ""), refusal)
        return item is not None

    def take_leave(self, seconds: float) -> bool:
        """The same when the run is over: nobody's wishes count any more; False also for a signal."""
        item = self._bus.inbox.take(seconds)
        if isinstance(item, Query):
            item.drop()
        elif isinstance(item, Alive):
            with suppress(Refused):
                self._harvest.drivers.roster.token(*self._whose(item), item.up)
        return item is not None and not isinstance(item, Signal)

    def _handle(self, item: Item) -> None:
        if isinstance(item, Sample):
            self._hear(item)
        elif isinstance(item, Alive):
            self._token(item)
        elif isinstance(item, Query):
            self._queries.reply(item)
        elif isinstance(item, Signal):
            raise RunEnded("stopped")

    def _hear(self, sample: Sample) -> None:
        run = self._harvest.run
        match self._keys.parts(sample.key):
            case ["hosts", session, "refused"]:
                counts = read_message(sample.payload, RefusedThere, run).counts
                self._harvest.refusal_totals.hear(_session(session), counts)
            case [name, "velocity"]:
                self._harvest.drivers.drive(name, read_message(sample.payload, Velocity, run))
            case ["hosts", session, "velocities"]:
                self._drive_all(session, sample)
            case _:
                raise Refused("no such key")

    def _drive_all(self, session: str, sample: Sample) -> None:
        """Who may put on whose key, a secured router sees to."""
        velocities = read_message(sample.payload, Velocities, self._harvest.run)
        if velocities.holder != session:
            raise Refused("not the holder", f"{velocities.holder!r} is not the session of the key")
        for refusal in self._harvest.drivers.drive_all(velocities):
            self._harvest.refusal_totals.own.note(sample.key, refusal)

    def _token(self, alive: Alive) -> None:
        name, holder = self._whose(alive)
        if name == PHYSICS:
            self._refuse_another_run(alive.up, holder)
            return
        if name == LOGGER and alive.up:
            self._harvest.reporter.camera.forget()
        self._harvest.drivers.token(name, holder, alive.up)

    def _whose(self, alive: Alive) -> tuple[str, str]:
        """Name and session of a liveliness token."""
        match self._keys.parts(alive.key):
            case ["alive", name, session] if name in self._harvest.drivers.roster.names or name in (PHYSICS, LOGGER):
                return name, _session(session)
        raise Refused("no such agent")

    def _refuse_another_run(self, up: bool, run: str) -> None:
        """At one router there is one run to a prefix: whoever finds another there must go, and both of two that begin together."""
        is_new = not self._harvest.has_begun and time.monotonic() < self._alone_from
        if up and run != self._harvest.run and is_new:
            where = f"with prefix {self._keys.prefix}; choose another router or prefix"
            raise BusError(f"{self._bus.endpoint}: run {run} goes on there, {where}")


def _session(text: str) -> str:
    """A session's id in a key. Raises Refused for what is none."""
    try:
        session: str = msgspec.convert(text, Session)
    except ValueError as error:
        raise Refused("malformed", f"a session's id: {error}") from error
    return session
