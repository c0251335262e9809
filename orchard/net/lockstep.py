"""The physics side of lockstep, without a network: who holds which agent, and which answers a tick still waits for.

Physics publishes tick k, waits until every agent that is held has answered it, applies the answers in the layout's order,
and goes on to k + 1. A name that nobody holds is not waited for: it stands, unless somebody drives it.
"""

import math
import time
from collections.abc import Callable
from typing import Any

from orchard.contract.agent import Action
from orchard.net.refusals import WHOSE, Refused, refuse_other_tick
from orchard.net.roster import Roster
from orchard.wire.codec import action_of
from orchard.wire.messages import Mode, Velocity

PATIENCE = 15.0  # s of wall time for which an agent may be silent
AGAIN_SECONDS = 0.5  # after which who is silent is shown a tick again


class LockstepBarrier:
    """The velocities that are in for one tick: in lockstep physics waits until none is missing. `realtime.Live` is its counterpart."""

    mode: Mode = "lockstep"
    newest_wins = False  # every tick must reach every agent
    releases_at_once = False  # who is gone may come back, or another in its place, while its patience lasts

    def __init__(self, roster: Roster, patience: float = PATIENCE, clock: Callable[[], float] = time.monotonic) -> None:
        self._roster, self._patience, self._clock = roster, patience, clock
        self.tick = -1
        self.deadline = math.inf  # on the clock: until then the missing are waited for
        self.missing: set[str] = set()
        self._back: set[str] = set()  # who has joined since the tick began
        self.velocities: dict[str, Velocity] = {}
        self._actions: dict[str, Action] = {}  # that they mean
        self._before: dict[str, Velocity] = {}  # those of the last tick

    def open(self, tick: int, lag: float = 0.0) -> None:
        """Wait for everyone who is held, at a new tick, which begins so many seconds after it was due."""
        self.tick, self.missing, self.velocities, self._before = tick, set(self._roster.holders), {}, self.velocities
        self._actions = {}
        self._back.clear()
        self.deadline = self._clock() + self._patience

    def expect(self, name: str) -> None:
        """Somebody new holds an agent: what its predecessor answered to this tick does not count.

        Many are slow to start, so each that comes gives all some time; but who comes again and again does so once in a tick.
        """
        self.velocities.pop(name, None)
        self._actions.pop(name, None)
        self.missing.add(name)
        if name not in self._back:
            self._back.add(name)
            self.deadline = self._clock() + self._patience

    def give_up(self) -> set[str]:
        """The deadline is over: go on without the missing. Those who lose their agents by it."""
        lost, self.missing = self.missing, set()
        return lost

    def release(self, name: str) -> None:
        """Nobody holds this agent any more."""
        self.missing.discard(name)

    def take(self, name: str, velocity: Velocity) -> None:
        if velocity.holder != self._roster.holders[name]:
            raise Refused("not the holder", WHOSE["not the holder"])
        if velocity.tick != self.tick or name not in self.missing:
            self._refuse_unless_repeated(name, velocity)
            return
        self.velocities[name], self._actions[name] = velocity, action_of(velocity)
        self.missing.discard(name)

    def _refuse_unless_repeated(self, name: str, velocity: Velocity) -> None:
        """One that is not waited for: sent again, in case it was lost, or a mistake."""
        if velocity in (self.velocities.get(name), self._before.get(name)):
            return
        refuse_other_tick(velocity.tick, self.tick, self.tick)
        raise Refused("answered already", f"tick {velocity.tick}")

    def actions(self) -> dict[str, Action]:
        """What to apply, in the order of names: never in that of arrival."""
        return {name: self._actions[name] for name in sorted(self._actions)}

    def digests(self) -> dict[str, bytes]:
        return {name: velocity.report.mail for name, velocity in self.velocities.items() if velocity.report is not None}

    def figures(self) -> dict[str, Any]:
        """What the summary holds of it."""
        return {}
