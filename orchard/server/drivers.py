"""Physics' side of the exchange of each tick: which agents are asked, and what they answer.

Velocities come from sessions, which own agents (roster.py), and from clients, which drive robots
that no session owns, or advise robots (commands.py). `Inbound` passes them on to `Drivers`, and
`RunLoop` calls the rest.
"""

from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from itertools import chain

from orchard.contract.agent import Action, Observations
from orchard.contract.messages import Written
from orchard.field.geometry import Twist
from orchard.field.kinds import KINDS
from orchard.net.refusals import Refused
from orchard.server.barriers import LockstepBarrier, RealtimeBarrier
from orchard.server.commands import Advised, UnownedCommands
from orchard.server.publisher import Publisher
from orchard.server.roster import RecoveryLog, Roster
from orchard.sim.engine import Engine
from orchard.wire.codec import twist_of
from orchard.wire.messages import Advice, Report, Velocities, Velocity

# What takes the place of an action that is refused.
BROKEN = Report(doing="broken", state="broken")
# An action that is malformed so many times in turn is a mistake of its sender's program. If it is
# malformed fewer times, bytes of it may have changed on their way.
MALFORMED_IN_TURN = 5


class Drivers:
    """Asks the agents at each tick, and collects the actions for the step."""

    def __init__(
        self,
        engine: Engine,
        roster: Roster,
        answers: LockstepBarrier | RealtimeBarrier,
        *,
        recovery_log: RecoveryLog,
        publisher: Publisher,
        clock: Callable[[], float],
    ) -> None:
        """`answers`: the barrier, which decides when all answers to a tick are in.

        `clock`: s of wall time, without pauses.
        """
        self._engine = engine
        self._publisher = publisher
        self.roster = roster
        self.answers = answers
        self.recovery_log = recovery_log
        self.unowned = UnownedCommands(clock, answers.watchdog)
        self.advised = Advised()
        # Agent -> the first tick at which lockstep did not wait for it. From then on the hash is
        # not promised.
        self.lost: dict[str, int] = {}
        # Session id -> its agents that are asked at this tick.
        self.due: dict[str, list[str]] = {}
        # What was observed at this tick, to send it again.
        self._seen: Observations | None = None
        # Agent -> how many of its actions were refused as malformed, in turn.
        self._malformed: Counter[str] = Counter()

    # -- which session owns which agent

    def token(self, name: str, owner: str, up: bool) -> None:
        """Record a liveliness token that appeared (`up`) or is gone, as `Roster.token` does.

        In realtime, release an agent if its session is gone.
        """
        self.roster.token(name, owner, up)
        if self.answers.releases_at_once and not up and self.roster.owners.get(name) == owner:
            self.release({name})

    def leave(self, owner: str) -> None:
        """Record that a session has said that it leaves."""
        self.roster.leave(owner)

    def join(self, names: Sequence[str], owner: str) -> dict[str, str]:
        """Let a session own all these agents, or none of them if it cannot own one.

        Return name -> why it cannot own the agent; empty if it owns all now.
        """
        refused = {}
        for name in names:
            why = self.roster.may_join(name, owner)
            if why:
                refused[name] = why
        before = self.roster.sessions
        if not refused:
            for name in names:
                self.roster.join(name, owner)
                # A Counter ignores a missing name here.
                del self._malformed[name]
        # Sessions that have lost their last agent to this one.
        self._publisher.retire(before - self.roster.sessions)
        return refused

    def expect(self, names: Sequence[str], owner: str) -> None:
        """Ask agents that a session has just taken: at the tick that is open, else at the next."""
        is_tick_open = self.answers.tick == self._engine.tick
        if names and is_tick_open:
            for name in names:
                self.answers.expect(name)
            self.due.setdefault(owner, [])
            self.due[owner] += [name for name in names if name not in self.due[owner]]
            self.show([owner])
        self._engine.wake(names)

    def release(self, names: set[str]) -> None:
        """Take these agents from their sessions, and tell these sessions."""
        for name in names:
            self.answers.release(name)
        self._engine.wake(names)
        self.miss(names)
        released = self.roster.release(names)
        self._publisher.publish_lost(self._engine.tick, released)
        self._publisher.retire(released.keys() - self.roster.sessions)

    def give_up(self) -> None:
        """Stop waiting for the missing answers.

        A session of which none has answered this tick loses all its agents.
        """
        missing = self.answers.give_up()
        silent = [owner for owner, names in self.due.items() if missing.issuperset(names)]
        released = set(missing)
        # Another session may have taken agents over from a silent one.
        for name, owner in self.roster.owners.items():
            if owner in silent:
                released.add(name)
        self.release(released)

    def miss(self, names: Collection[str]) -> None:
        """Note that lockstep does not wait for these agents from now on.

        In realtime nothing is noted: there no hash is promised.
        """
        if not self.answers.releases_at_once:
            # The tick of an agent that was lost before stays.
            self.lost = dict.fromkeys(sorted(names), self._engine.tick) | self.lost

    def drives(self, name: str) -> bool:
        """Whether a session or a client drives an agent."""
        return name in self.roster.owners or self.unowned.drives(name)

    # -- what sessions need to take over agents

    def memories(self) -> dict[str, bytes | None]:
        """Return the newest memory of each agent."""
        return self.recovery_log.memories

    def letters(self) -> list[tuple[int, dict[str, Written]]]:
        """Return the letters of the last two ticks, (tick, sender -> its letters)."""
        return sorted(self.recovery_log.letters.items())

    def letters_of(self, tick: int) -> dict[str, Written]:
        """Return the letters of one of the last two ticks, sender -> its letters."""
        return self.recovery_log.letters.get(tick, {})

    # -- a tick

    def begin(self, seen: Observations, lag: float) -> None:
        """Open a tick: ask the agents that are due at it, and publish it.

        `lag`: seconds that the tick begins late.
        """
        self._seen = seen
        self.due = {}
        self.unowned.begin(seen.tick)
        for name in self._engine.due(self.recovery_log.hearing(seen.tick)):
            owner = self.roster.owners.get(name)
            if owner is not None:
                self.due.setdefault(owner, []).append(name)
        self.answers.open(seen.tick, lag, chain.from_iterable(self.due.values()))
        self._show(seen, self.due)

    def silent(self) -> set[str]:
        """Return the sessions that have not answered for all their agents."""
        return {self.roster.owners[name] for name in self.answers.missing}

    def show(self, owners: Collection[str]) -> None:
        """Send the open tick again, to sessions that have not answered it or have just joined."""
        assert self._seen is not None
        # A session that has just joined subscribes to it only now.
        self._publisher.refresh_subscribers()
        self._show(self._seen, {owner: self.due[owner] for owner in sorted(owners)})

    def _show(self, seen: Observations, due: Mapping[str, Sequence[str]]) -> None:
        """Publish a tick. `due`: session id -> its agents that are asked."""
        if due:
            asked = self.recovery_log.asked(seen.tick - 1)
        else:
            asked = []
        self._publisher.show(seen, due, asked)
        views = {"truth": self._engine.truth, "odometry": self._engine.odometry}
        self._publisher.publish_tick(seen, views)

    def actions(self, tick: int) -> dict[str, Action]:
        """Return the actions for the step from this tick.

        Memories and letters are kept for sessions that join later.
        """
        # In realtime these are the reports that the step before has used: there no tick waits for
        # mail, so it does not matter that they are kept a tick later.
        self.recovery_log.keep(tick, self.answers.reports)
        own = {**self.answers.actions(), **self.unowned.actions(tick)}
        advised = self.advised.actions(tick, own, self._engine.actions)
        self._engine.wake(advised)
        return own | advised

    # -- velocities

    def advise(self, name: str, advice: Advice) -> None:
        """Take a velocity that replaces that of a robot's agent.

        Raises Refused if it does not count.
        """
        if name not in self._engine.layout.index:
            raise Refused("no such robot", name)
        self._refuse_sideways(name, twist_of(advice))
        self.advised.take(name, advice, self._engine.tick)

    def _refuse_sideways(self, name: str, twist: Twist) -> None:
        """Raise Refused for a velocity to the side of a body that cannot move so."""
        layout = self._engine.layout
        if not twist.y or name not in layout.index:
            return
        kind = layout.starts[layout.index[name]].kind
        if not KINDS[kind].sideways:
            raise Refused("out of bounds", f"{name}: linear.y: a {kind} does not move sideways")

    def drive(self, name: str, velocity: Velocity) -> None:
        """Take a velocity for one robot: of the session that owns it, or of a client if none does.

        Raises Refused if it does not count.
        """
        if name in self.roster.owners:
            report = Report(twist_of(velocity), velocity.deeds, once=velocity.once)
            self._act(name, velocity.owner, velocity.tick, report)
        elif name in self._engine.layout.index:
            self._refuse_sideways(name, twist_of(velocity))
            self.unowned.take(name, velocity)
        else:
            raise Refused("no such robot", name)

    def _act(self, name: str, owner: str, tick: int, report: Report) -> None:
        """Take the action of an owned agent. Raises Refused."""
        if name not in self.roster.owners:
            if name in self.roster.names:
                raise Refused("not owned", name)
            raise Refused("no such robot", name)
        self._refuse_sideways(name, report.twist)
        self.answers.take(name, owner, tick, report)

    def act_all(self, message: Velocities, malformed: Mapping[str, Refused]) -> list[Refused]:
        """Take the actions of a session, each by itself. Return the refusals.

        `malformed`: name -> why its action could not be read.

        Bytes of an action that is malformed or out of bounds may have changed on their way: its
        session sends it again. After MALFORMED_IN_TURN such actions in turn the robot stands in
        this tick, so that the others need not wait for it.
        """
        refused = dict(malformed)
        is_heard = self._publisher.are_robots_heard()
        for name, report in message.velocities.items():
            try:
                self._act(name, message.owner, message.tick, report)
            except Refused as refusal:
                refused[name] = refusal
            else:
                del self._malformed[name]
                if is_heard:
                    self._publisher.publish_velocity(name, message.owner, message.tick, report)
        for name, why in refused.items():
            if why.reason in ("malformed", "out of bounds"):
                self._take_malformed(name, message)
        return list(refused.values())

    def _take_malformed(self, name: str, message: Velocities) -> None:
        """Let a robot stand after MALFORMED_IN_TURN malformed actions in turn."""
        if self.roster.owners.get(name) != message.owner:
            return
        self._malformed[name] += 1
        if self._malformed[name] >= MALFORMED_IN_TURN:
            # This tick may not wait for the action.
            with suppress(Refused):
                self._act(name, message.owner, message.tick, BROKEN)
