"""Lockstep, without a network: which answers a tick still waits for.

Physics does not wait for an agent that no session holds: its robot stands, unless a client drives it.
"""

import math
from collections.abc import Callable, Iterable
from typing import Any

from orchard.contract.agent import Action
from orchard.net.refusals import Refused, refuse_other_tick
from orchard.server.options import PATIENCE
from orchard.server.roster import Roster
from orchard.wire.codec import action_of
from orchard.wire.messages import Mode, Velocity

AGAIN_SECONDS = 0.5  # after which a tick is sent again to the sessions that have not answered


class Barrier:
    """The velocities for one tick, until physics does not wait for any more."""

    mode: Mode

    def __init__(self, roster: Roster, clock: Callable[[], float]) -> None:
        self._roster, self._clock = roster, clock
        self.tick = -1
        self.missing: set[str] = set()
        self.velocities: dict[str, Velocity] = {}

    def _refuse_unless_held_by(self, name: str, holder: str) -> None:
        if holder != self._roster.holders[name]:
            raise Refused("not the holder", "another session holds this agent")

    def give_up(self) -> set[str]:
        """Stop waiting for the missing agents. Return the agents that lose their holder."""
        lost, self.missing = self.missing, set()
        return lost

    def digests(self) -> dict[str, bytes]:
        """Return the mail digests that the agents reported, by name."""
        return {name: velocity.report.mail for name, velocity in self.velocities.items() if velocity.report is not None}

    def figures(self) -> dict[str, Any]:
        """Return this barrier's figures for the summary."""
        return {}


class LockstepBarrier(Barrier):
    """Physics waits until no velocity is missing. The counterpart is `realtime.RealtimeBarrier`."""

    mode = "lockstep"
    watchdog = 0.0  # s of wall time that a velocity drives at least: none, for ticks alone count
    newest_wins = False  # each tick must reach each agent
    releases_at_once = False  # a session that is gone may come back, or be replaced, until the deadline

    def __init__(self, roster: Roster, clock: Callable[[], float], patience: float = PATIENCE) -> None:
        super().__init__(roster, clock)
        self._patience = patience
        self.deadline = math.inf  # on the clock: the time to wait for missing answers
        self._back: set[str] = set()  # agents that sessions have taken since the tick began
        self._actions: dict[str, Action] = {}  # the actions in these velocities
        self._last: dict[str, list[Velocity]] = {}  # the last two velocities of each agent

    def open(self, tick: int, lag: float = 0.0, due: Iterable[str] | None = None) -> None:
        """Open a tick, and wait for the agents that are `due`; None means all that are held. `lag`: how late the tick begins, s."""
        self.tick, self.missing, self.velocities = tick, set(self._roster.holders if due is None else due), {}
        self._actions, self._back = {}, set()
        self.deadline = self._clock() + self._patience

    def expect(self, name: str) -> None:
        """Wait for an agent that a session has just taken; an answer of its previous holder to this tick does not count.

        The deadline moves for all agents, because many sessions start slowly; but each agent moves it only once in a tick.
        """
        self.velocities.pop(name, None)
        self._actions.pop(name, None)
        self.missing.add(name)
        if name not in self._back:
            self._back.add(name)
            self.deadline = self._clock() + self._patience

    def release(self, name: str) -> None:
        """Stop waiting for an agent that no session holds any more."""
        self.missing.discard(name)

    def take(self, name: str, velocity: Velocity) -> None:
        """Take a velocity for a held agent. Ignore a repetition. Raises Refused if the velocity is not one that physics waits for."""
        self._refuse_unless_held_by(name, velocity.holder)
        if velocity.tick != self.tick or name not in self.missing:
            self._refuse_unless_repeated(name, velocity)
            return
        self.velocities[name], self._last[name] = velocity, [*self._last.get(name, [])[-1:], velocity]
        self._actions[name] = action_of(velocity)
        self.missing.discard(name)

    def _refuse_unless_repeated(self, name: str, velocity: Velocity) -> None:
        """Ignore a repetition, sent in case the first was lost; refuse any other velocity that is not awaited."""
        if velocity in self._last.get(name, []):
            return
        refuse_other_tick(velocity.tick, self.tick, self.tick)
        raise Refused("answered already", f"tick {velocity.tick}")

    def actions(self) -> dict[str, Action]:
        """Return the actions to apply, in the order of names, never in the order of arrival."""
        return {name: self._actions[name] for name in sorted(self._actions)}
