"""Those who drive: who holds which agent, is shown each tick, and has answered it; and who drives a robot that nobody holds."""

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

from orchard.contract.agent import Action
from orchard.contract.observations import Observations
from orchard.field.kinds import KINDS
from orchard.net.lockstep import LockstepBarrier
from orchard.net.realtime import RealtimeBarrier
from orchard.net.recovery import RecoveryLog
from orchard.net.refusals import Refused
from orchard.net.roster import Roster
from orchard.net.unheld import UnheldCommands
from orchard.server.publisher import Publisher
from orchard.wire.codec import velocity_of
from orchard.wire.messages import Velocities, Velocity

if TYPE_CHECKING:
    from orchard.sim.engine import Engine


class Drivers:
    """Physics' side of each tick's exchange with those who drive. `answers` decides when a tick's answers are in."""

    def __init__(
        self, engine: "Engine", roster: Roster, answers: LockstepBarrier | RealtimeBarrier, ledger: RecoveryLog, publisher: Publisher
    ) -> None:
        self._engine, self._publisher = engine, publisher
        self.roster, self.answers, self.ledger, self.loose = roster, answers, ledger, UnheldCommands()
        self._seen: Observations | None = None

    # -- who is there

    def token(self, name: str, holder: str, up: bool) -> None:
        """A liveliness token came or went."""
        self.roster.token(name, holder, up)
        if self.answers.releases_at_once and not up and self.roster.holders.get(name) == holder:
            self.release({name})

    def join(self, names: Sequence[str], holder: str) -> dict[str, str]:
        """Let a session hold all these agents, or none; name -> why it cannot."""
        refused = {name: why for name in names if (why := self.roster.may_join(name, holder))}
        before = set(self.roster.by_holder())
        for name in () if refused else names:
            self.roster.join(name, holder)
        self._publisher.part(before.difference(self.roster.by_holder()))
        return refused

    def expect(self, names: Sequence[str], holder: str) -> None:
        """Of those who have just joined the tick that is under way wants answers, too."""
        if names and self.answers.tick == self._engine.tick:
            for name in names:
                self.answers.expect(name)
            self.show([holder])

    def release(self, names: set[str]) -> None:
        """Nobody holds these agents any more."""
        for name in names:
            self.answers.release(name)
        released = self.roster.release(names)
        self._publisher.lost(self._engine.tick, released)
        self._publisher.part(set(released).difference(self.roster.by_holder()))

    def drives(self, name: str) -> bool:
        """Whether anybody does: who holds it, or another."""
        return name in self.roster.holders or self.loose.drives(name)

    # -- a tick

    def begin(self, seen: Observations, lag: float) -> None:
        """Show a tick, which begins so many seconds after it was due, and wait for answers to it."""
        self._seen = seen
        self.loose.begin(seen.tick)
        self.answers.open(seen.tick, lag)
        self._publisher.look(seen, self.roster.by_holder(), self.ledger.asked(seen.tick - 1))

    def silent(self) -> set[str]:
        """The sessions whose answers are missing."""
        return {self.roster.holders[name] for name in self.answers.missing}

    def show(self, holders: Collection[str]) -> None:
        """Show the tick that is under way, again or to newcomers."""
        assert self._seen is not None
        by_holder = self.roster.by_holder()
        self._publisher.listen()
        shown = {holder: by_holder[holder] for holder in sorted(holders)}
        self._publisher.look(self._seen, shown, self.ledger.asked(self._seen.tick - 1))

    def actions(self, tick: int) -> dict[str, Action]:
        """What all do in the step from this tick to the next. What came with it is kept for newcomers."""
        self.ledger.keep(tick, self.answers.velocities)
        return self.answers.actions() | self.loose.actions(tick)

    # -- what they answer

    def drive(self, name: str, velocity: Velocity) -> None:
        """Raises Refused for what does not count."""
        if velocity.linear.y:
            self._refuse_sideways(name)
        if name in self.roster.holders:
            self.answers.take(name, velocity)
        elif name in self._engine.layout.index:
            self.loose.take(name, velocity)
        else:
            raise Refused("no such robot", name)

    def drive_all(self, velocities: Velocities) -> list[Refused]:
        """Each velocity of a session counts, or is refused, for itself: those that were refused."""
        refusals, is_heard = [], self._publisher.are_robots_heard()
        for name in tuple(velocities.velocities):
            try:
                velocity = velocity_of(velocities, name)
                self.drive(name, velocity)
                if is_heard:
                    self._publisher.driven(name, velocity)
            except Refused as refusal:
                refusals.append(refusal)
                del velocities.velocities[name]
        return refusals

    def _refuse_sideways(self, name: str) -> None:
        layout = self._engine.layout
        kind = layout.starts[layout.index[name]].kind if name in layout.index else ""
        if kind and not KINDS[kind].sideways:
            raise Refused("out of bounds", f"linear.y: a {kind} does not move sideways")
