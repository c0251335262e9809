"""Lockstep, without a network: which answers a tick still waits for.

Physics does not wait for an agent that no session owns: its robot stands, unless a client drives it.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from orchard.contract.agent import Action
from orchard.net.refusals import Refused, refuse_other_tick
from orchard.server.options import PATIENCE
from orchard.server.roster import Roster
from orchard.wire.messages import Mode, Report

AGAIN_SECONDS = 0.5  # after which a tick is sent again to the sessions that have not answered


class Barrier:
    """The actions for one tick, until physics does not wait for any more."""

    mode: Mode

    def __init__(self, roster: Roster, clock: Callable[[], float]) -> None:
        self._roster, self._clock = roster, clock
        self.tick = -1
        self.missing: set[str] = set()
        self.reports: dict[str, Report] = {}

    def _refuse_unless_held_by(self, name: str, owner: str) -> None:
        if owner != self._roster.owners[name]:
            raise Refused("not the owner", "another session owns this agent")

    def give_up(self) -> set[str]:
        """Stop waiting for the missing agents. Return the agents that lose their owner."""
        lost, self.missing = self.missing, set()
        return lost

    def digests(self) -> dict[str, bytes]:
        """Return the mail digests that the agents reported, by name."""
        return {name: report.mail for name, report in self.reports.items()}

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
        self._last: dict[str, list[tuple[int, Report]]] = {}  # the last two of each agent, with their ticks

    def open(self, tick: int, lag: float = 0.0, due: Iterable[str] | None = None) -> None:
        """Open a tick, and wait for the agents that are `due`; None means all that are held. `lag`: how late the tick begins, s."""
        self.tick, self.missing, self.reports = tick, set(self._roster.owners if due is None else due), {}
        self._back = set()
        self.deadline = self._clock() + self._patience

    def expect(self, name: str) -> None:
        """Wait for an agent that a session has just taken; an answer of its previous owner to this tick does not count.

        The deadline moves for all agents, because many sessions start slowly; but each agent moves it only once in a tick.
        """
        self.reports.pop(name, None)
        self.missing.add(name)
        if name not in self._back:
            self._back.add(name)
            self.deadline = self._clock() + self._patience

    def release(self, name: str) -> None:
        """Stop waiting for an agent that no session owns any more."""
        self.missing.discard(name)

    def take(self, name: str, owner: str, tick: int, report: Report) -> None:
        """Take the action of a owned agent. Ignore a repetition. Raises Refused if the action is not one that physics waits for."""
        self._refuse_unless_held_by(name, owner)
        if tick == self.tick and name in self.missing:
            self.reports[name] = report
            self._last[name] = [*self._last.get(name, [])[-1:], (tick, report)]
            self.missing.discard(name)
        elif (tick, report) not in self._last.get(name, []):  # a repetition is sent in case the first was lost
            refuse_other_tick(tick, self.tick, self.tick)
            raise Refused("answered already", f"tick {tick}")

    def actions(self) -> Mapping[str, Action]:
        """Return the actions to apply, in the order of names, never in the order of arrival."""
        return dict(sorted(self.reports.items()))
