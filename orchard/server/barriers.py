"""When all answers to a tick are in: in lockstep physics waits for each agent, in realtime the newest counts."""

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from msgspec.structs import replace

from orchard.contract.agent import Action
from orchard.field.geometry import STILL
from orchard.net.refusals import Refused, refuse_other_tick
from orchard.server.commands import WATCHDOG, RecentTicks, all_deeds
from orchard.server.options import PATIENCE
from orchard.server.roster import Roster
from orchard.wire.messages import Mode, Report

AGAIN_SECONDS = 0.5  # after which a tick is sent again to the sessions that have not answered
SLACK = 0.2  # s beyond the tick's time, to wait for agents that were in time last; less than Pacer.CATCH_UP
SHARE = 0.5  # of a tick's time, to wait for agents that missed the last tick, and for all when the clock is behind
LATE = 0.5  # of a tick's time: a tick that begins later than this after it was due counts as late


class Barrier:
    """The actions for one tick, until physics does not wait for any more."""

    mode: Mode

    def __init__(self, roster: Roster, clock: Callable[[], float]) -> None:
        self._roster, self._clock = roster, clock
        self.tick = -1
        self.missing: set[str] = set()
        self.reports: dict[str, Report] = {}

    def open(self, tick: int, lag: float = 0.0, due: Iterable[str] | None = None) -> None:
        """Open a tick, and wait for the agents that are `due`; None: all that are owned. `lag`: how late it begins, s."""
        self.tick, self.missing = tick, set(self._roster.owners if due is None else due)

    def expect(self, name: str) -> None:
        """Wait for an agent that a session has just taken; an answer of its previous owner does not count."""
        self.release(name)
        self.missing.add(name)

    def release(self, name: str) -> None:
        """Stop waiting for an agent that no session owns any more."""
        self.missing.discard(name)

    def _refuse_other_owner(self, name: str, owner: str) -> None:
        if owner != self._roster.owners[name]:
            raise Refused("not the owner", "another session owns this agent")

    def give_up(self) -> set[str]:
        """Stop waiting for the missing agents. Return the agents that lose their owner."""
        lost, self.missing = self.missing, set()
        return lost

    def digests(self) -> dict[str, bytes]:
        return {name: report.mail for name, report in self.reports.items()}

    def figures(self) -> dict[str, Any]:
        return {}


class LockstepBarrier(Barrier):
    """Physics waits until no velocity is missing. A robot that no session owns stands, unless a client drives it."""

    mode = "lockstep"
    watchdog = 0.0  # s of wall time that a velocity drives at least: none, for ticks alone count
    newest_wins = False  # each tick must reach each agent
    releases_at_once = (
        False  # a session that is gone may come back, or be replaced, until the deadline
    )

    def __init__(
        self, roster: Roster, clock: Callable[[], float], patience: float = PATIENCE
    ) -> None:
        super().__init__(roster, clock)
        self._patience = patience
        self.deadline = math.inf  # on the clock: the time to wait for missing answers
        self._back: set[str] = set()  # agents that sessions have taken since the tick began
        # Agent -> the session that answered last, the tick, and the answer.
        self._last: dict[str, tuple[str, int, Report]] = {}

    def open(self, tick: int, lag: float = 0.0, due: Iterable[str] | None = None) -> None:
        super().open(tick, lag, due)
        self.reports, self._back = {}, set()
        self.deadline = self._clock() + self._patience

    def expect(self, name: str) -> None:
        """The deadline moves for all agents, as many sessions start slowly; each agent moves it once in a tick."""
        super().expect(name)
        self.reports.pop(name, None)
        if name not in self._back:
            self._back.add(name)
            self.deadline = self._clock() + self._patience

    def take(self, name: str, owner: str, tick: int, report: Report) -> None:
        """Take the action of an owned agent. Raises Refused if it is not one that physics waits for.

        A repetition is passed over: a host sends it in case the first was lost.
        """
        self._refuse_other_owner(name, owner)
        is_awaited = tick == self.tick and name in self.missing
        if not is_awaited and self._last.get(name) == (owner, tick, report):
            return
        refuse_other_tick(tick, self.tick, self.tick)
        if name not in self.missing:
            raise Refused("answered already", f"tick {tick}")
        self.reports[name] = report
        self._last[name] = (owner, tick, report)
        self.missing.discard(name)

    def actions(self) -> Mapping[str, Action]:
        """Return the actions to apply, in the order of names, never in the order of arrival."""
        return dict(sorted(self.reports.items()))


class TimedReport(NamedTuple):
    tick: int
    report: Report
    at: float  # s, on the clock


class RealtimeBarrier(Barrier):
    """The newest action of each owned agent.

    A tick's answers have until the next tick is due; where the machine hiccups they have a moment longer, which the ticks after it make up
    for. Then the step is done without those that are missing.
    """

    mode = "realtime"
    watchdog = WATCHDOG
    newest_wins = True  # sessions need only the newest tick
    releases_at_once = True  # the robots of a session that is gone are released at once, and stand

    def __init__(self, roster: Roster, step: float, clock: Callable[[], float]) -> None:
        """`step`: s of wall time between two ticks."""
        super().__init__(roster, clock)  # `reports`: those that were used first in the last step
        self._step = step
        self._recent = RecentTicks(clock)
        self._newest: dict[str, TimedReport] = {}
        self._fresh: dict[str, Report] = {}  # actions that no step has used
        self._moved: dict[str, int] = {}  # name -> the last tick in which it moved
        self._tardy: set[str] = set()  # agents that did not answer the last tick in time
        self._begun = self._patient = clock()
        self._late = self._missed = 0
        self._delays = Delays()

    # -- what arrives

    def open(self, tick: int, lag: float = 0.0, due: Iterable[str] | None = None) -> None:
        super().open(tick, lag, due)
        self._recent.begin(tick)
        self._begun = self._clock()
        self._patient = self._begun + max(self._step + SLACK - lag, self._step * SHARE)
        self._late += lag > self._step * LATE

    @property
    def deadline(self) -> float:
        """The time, on the clock, to wait for answers. Agents that missed the last tick do not delay others."""
        return self._patient if self.missing - self._tardy else self._begun + self._step * SHARE

    def release(self, name: str) -> None:
        super().release(name)
        self._newest.pop(name, None)
        self._fresh.pop(name, None)
        self._tardy.discard(name)

    def take(self, name: str, owner: str, tick: int, report: Report) -> None:
        """Take the action of an owned agent. Raises Refused if it does not count."""
        self._refuse_other_owner(name, owner)
        last = self._newest[name].tick if name in self._newest else -1
        if tick == last:
            if report == self._newest[name].report:
                return  # a repetition, sent in case the first was lost
            raise Refused("answered already", f"tick {tick}")
        refuse_other_tick(tick, max(self._recent.oldest, last), self.tick)
        self._fresh[name] = _with_unused(self._fresh.get(name), report)
        self._newest[name] = TimedReport(tick, report, self._clock())
        if tick == self.tick:
            self.missing.discard(name)
            self._delays.add(self._newest[name].at - self._begun)

    def give_up(self) -> set[str]:
        """Stop waiting for the missing agents. None of them loses its owner."""
        super().give_up()
        return set()

    # -- one step

    def actions(self) -> dict[str, Action]:
        """Return the actions to apply, in the order of names; each deed is in them once."""
        owned = sorted(self._roster.owners)
        self._tardy = {
            name
            for name in owned
            if name not in self._newest or self._newest[name].tick != self.tick
        }
        self._missed += len(self._tardy)
        self.reports, self._fresh = self._fresh, {}
        puts, is_over = sorted(self._newest.items()), self._recent.is_over
        return {
            name: self._action(name, put)
            for name, put in puts
            if not is_over(put.tick, put.at, self.tick)
        }

    def _action(self, name: str, put: TimedReport) -> Action:
        action = (
            self.reports[name]
            if name in self.reports
            else replace(put.report, deeds=[], requests=[], answers=[])
        )
        if (
            put.report.once and self._moved.get(name, -1) >= put.tick
        ):  # it has moved since the pose that this answers
            action = replace(action, twist=STILL)
        if action.twist != STILL:
            self._moved[name] = self.tick
        return action

    def figures(self) -> dict[str, Any]:
        delays = {f"p{share}": self._delays.below(share) for share in (50, 99)}
        return {
            "ticks_late": self._late,
            "velocities_missed": self._missed,
            "answer_milliseconds": delays,
        }


class Delays:
    """The delays from the observations to the velocities, as counts in steps of 0.1 ms: memory does not grow."""

    STEP = 1e-4  # s

    def __init__(self) -> None:
        self._counts = np.zeros(10_001, dtype=np.int64)  # the last one counts all of 1 s or longer

    def add(self, seconds: float) -> None:
        self._counts[min(max(int(seconds / self.STEP), 0), len(self._counts) - 1)] += 1

    def below(self, share: float) -> float:
        """Return the delay in ms that `share` per cent do not exceed; 0 without any."""
        total = int(self._counts.sum())
        step = int(np.searchsorted(np.cumsum(self._counts), share / 100 * total)) if total else -1
        return round((step + 1) * self.STEP * 1e3, 1)


def _with_unused(before: Report | None, report: Report) -> Report:
    """Add to an action the memory, letters and deeds of the one that it replaces, which no step has used."""
    if before is None:
        return report
    memory = before.memory if report.memory is None else report.memory
    requests, answers = [*before.requests, *report.requests], [*before.answers, *report.answers]
    return replace(
        report,
        memory=memory,
        deeds=all_deeds(before.deeds, report.deeds),
        requests=requests,
        answers=answers,
    )
