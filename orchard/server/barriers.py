"""When all answers to a tick are in.

Theory of operation. Physics publishes a tick, and opens the barrier for the agents that are asked.
The step is done when the barrier lets it. In lockstep physics waits for each agent, so a run has
one result. In realtime the newest answer of each agent counts, so time goes on.

    what happens                 | lockstep                        | realtime
    -----------------------------+---------------------------------+------------------------------
    all that are asked answer    | the step is done                | the step is done
    an answer is for this tick   | it counts once; a repetition is | it counts, and drives until
                                 | passed over                     | a newer one or the watchdog
    an answer is for an older    | refused                         | it counts, if no newer one has
    tick                         |                                 | come, and it is recent
    an agent is silent           | its session gets the tick again | it is not waited for at the
                                 | after AGAIN_SECONDS; after      | end of the tick's time; it
                                 | `patience` all agents of the    | keeps its owner
                                 | session are released            |
    a session takes an agent     | the tick waits for it anew      | the tick waits for it
    the session's token is gone  | it may come back until then     | its agents are released
    no session owns the agent    | the robot stands, unless a client drives it
"""

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

# s after which a tick is sent again to the sessions that have not answered.
AGAIN_SECONDS = 0.5
# In realtime: s beyond the tick's time, to wait for agents that answered the last tick in time. The
# ticks after it make up for the delay, so it is less than Pacer.CATCH_UP.
SLACK = 0.2
# In realtime: share of a tick's time to wait for agents that missed the last tick. For all agents
# too, when the clock is behind.
SHARE = 0.5
# Share of a tick's time. A tick that begins later than this after it was due counts as late.
LATE = 0.5


class Barrier:
    """The actions for one tick, until physics does not wait for any more."""

    mode: Mode

    def __init__(self, roster: Roster, clock: Callable[[], float]) -> None:
        """`clock`: s of wall time, without pauses."""
        self._roster = roster
        self._clock = clock
        # The tick that is open; -1 before the first one.
        self.tick = -1
        # The agents whose answers are waited for.
        self.missing: set[str] = set()
        # Agent -> the answer that the step uses first: its deeds, letters and memory count.
        self.reports: dict[str, Report] = {}

    def open(self, tick: int, lag: float = 0.0, due: Iterable[str] | None = None) -> None:
        """Open a tick, and wait for the agents that are `due`; None: all that a session owns.

        `lag`: how many seconds after its time the tick begins.
        """
        self.tick = tick
        if due is None:
            due = self._roster.owners
        self.missing = set(due)

    def expect(self, name: str) -> None:
        """Wait for an agent that a session has just taken.

        An answer of its previous owner does not count.
        """
        self.release(name)
        self.missing.add(name)

    def release(self, name: str) -> None:
        """Stop waiting for an agent that no session owns any more."""
        self.missing.discard(name)

    def _refuse_other_owner(self, name: str, owner: str) -> None:
        """Raise Refused unless a session owns an agent."""
        if owner != self._roster.owners[name]:
            raise Refused("not the owner", "another session owns this agent")

    def give_up(self) -> set[str]:
        """Stop waiting for the missing agents. Return the agents that lose their owner."""
        lost = self.missing
        self.missing = set()
        return lost

    def digests(self) -> dict[str, bytes]:
        """Return agent -> the digest of what it heard, for the run's hash."""
        return {name: report.mail for name, report in self.reports.items()}

    def figures(self) -> dict[str, Any]:
        """Return the figures of the answers, for the summary."""
        return {}


class LockstepBarrier(Barrier):
    """Physics waits until no velocity is missing.

    A robot that no session owns stands, unless a client drives it.
    """

    mode = "lockstep"
    # s of wall time that a velocity of a client drives at least: none, for only ticks count.
    watchdog = 0.0
    # Whether a slow session may miss a tick that a newer one follows: each must reach each agent.
    newest_wins = False
    # Whether agents lose their session as soon as its token is gone: a session that is gone may
    # come back, or be replaced, until the deadline.
    releases_at_once = False

    def __init__(
        self, roster: Roster, clock: Callable[[], float], patience: float = PATIENCE
    ) -> None:
        super().__init__(roster, clock)
        self._patience = patience
        # s, on the clock, up to which missing answers are waited for.
        self.deadline = math.inf
        # Agents that sessions have taken since the tick began.
        self._taken: set[str] = set()
        # Agent -> the session that answered last, the tick, and the answer.
        self._last: dict[str, tuple[str, int, Report]] = {}

    def open(self, tick: int, lag: float = 0.0, due: Iterable[str] | None = None) -> None:
        super().open(tick, lag, due)
        self.reports = {}
        self._taken = set()
        self.deadline = self._clock() + self._patience

    def expect(self, name: str) -> None:
        """Wait for an agent that a session has just taken, and move the deadline for all agents.

        Many sessions that start at once start slowly, so each agent gives more time. It does so
        once in a tick: a session that joins again and again must not stop the run.
        """
        super().expect(name)
        self.reports.pop(name, None)
        if name not in self._taken:
            self._taken.add(name)
            self.deadline = self._clock() + self._patience

    def take(self, name: str, owner: str, tick: int, report: Report) -> None:
        """Take the action of an owned agent.

        Raises Refused if physics does not wait for it. But a repetition is passed over in silence:
        a host sends its answer again when it gets a tick again, in case the first was lost.
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
    """An action, the tick that it answers, and when it came."""

    tick: int
    report: Report
    at: float  # s, on the clock


class RealtimeBarrier(Barrier):
    """The newest action of each owned agent.

    Answers to a tick are waited for until the next tick is due, and SLACK seconds longer if the
    machine is slow for a moment: the ticks after it make up for that. Then the step is done without
    those that are missing.
    """

    # LockstepBarrier says what these mean.
    mode = "realtime"
    watchdog = WATCHDOG
    # Sessions need only the newest tick.
    newest_wins = True
    # The robots of a session that is gone must stand at once.
    releases_at_once = True

    def __init__(self, roster: Roster, step: float, clock: Callable[[], float]) -> None:
        """`step`: s of wall time between two ticks."""
        super().__init__(roster, clock)
        self._step = step
        self._recent = RecentTicks(clock)
        # Agent -> its newest action, which drives it.
        self._newest: dict[str, TimedReport] = {}
        # Agent -> its newest action, if no step has used it yet.
        self._fresh: dict[str, Report] = {}
        # Agent -> the last tick at which its body got a velocity other than 0.
        self._moved: dict[str, int] = {}
        # Agents that did not answer the last tick in time.
        self._tardy: set[str] = set()
        # s, on the clock: when the open tick began, and until when agents that answered the last
        # tick in time are waited for.
        self._begun = clock()
        self._patient_until = self._begun
        # Ticks that began late, and answers that were missing when their tick was stepped.
        self._late_count = 0
        self._missed_count = 0
        self._delays = Delays()

    # -- what arrives

    def open(self, tick: int, lag: float = 0.0, due: Iterable[str] | None = None) -> None:
        super().open(tick, lag, due)
        self._recent.begin(tick)
        self._begun = self._clock()
        self._patient_until = self._begun + max(self._step + SLACK - lag, self._step * SHARE)
        if lag > self._step * LATE:
            self._late_count += 1

    @property
    def deadline(self) -> float:
        """s, on the clock, up to which answers are waited for.

        If only agents are missing that missed the last tick too, they must not delay the others.
        """
        if self.missing - self._tardy:
            return self._patient_until
        return self._begun + self._step * SHARE

    def release(self, name: str) -> None:
        super().release(name)
        self._newest.pop(name, None)
        self._fresh.pop(name, None)
        self._tardy.discard(name)

    def take(self, name: str, owner: str, tick: int, report: Report) -> None:
        """Take the action of an owned agent. Raises Refused if it does not count."""
        self._refuse_other_owner(name, owner)
        if name in self._newest:
            last = self._newest[name].tick
        else:
            last = -1
        if tick == last:
            if report == self._newest[name].report:
                # A repetition, sent in case the first was lost.
                return
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
        answered = {name for name, timed in self._newest.items() if timed.tick == self.tick}
        self._tardy = set(owned) - answered
        self._missed_count += len(self._tardy)
        self.reports = self._fresh
        self._fresh = {}
        actions = {}
        for name, timed in sorted(self._newest.items()):
            if not self._recent.is_over(timed.tick, timed.at, self.tick):
                actions[name] = self._action(name, timed)
        return actions

    def _action(self, name: str, timed: TimedReport) -> Action:
        """Return the action to apply. Its deeds and letters are in it at its first step only."""
        if name in self.reports:
            action: Action = self.reports[name]
        else:
            action = replace(timed.report, deeds=[], requests=[], answers=[])
        # A velocity that counts `once` leads from the pose of its tick to a target. The body has
        # moved since, so it would lead past the target.
        if timed.report.once and self._moved.get(name, -1) >= timed.tick:
            action = replace(action, twist=STILL)
        if action.twist != STILL:
            self._moved[name] = self.tick
        return action

    def figures(self) -> dict[str, Any]:
        delays = {f"p{share}": self._delays.below(share) for share in (50, 99)}
        return {
            "ticks_late": self._late_count,
            "velocities_missed": self._missed_count,
            "answer_milliseconds": delays,
        }


class Delays:
    """The delays from the observations of a tick to the answers.

    They are counted in steps of 0.1 ms, so memory does not grow.
    """

    STEP = 1e-4  # s
    STEPS = 10_000  # 1 s

    def __init__(self) -> None:
        # How many delays fell into each step; the last number counts all of 1 s or longer.
        self._counts = np.zeros(self.STEPS + 1, dtype=np.int64)

    def add(self, seconds: float) -> None:
        """Count a delay."""
        step = int(seconds / self.STEP)
        self._counts[min(max(step, 0), self.STEPS)] += 1

    def below(self, share: float) -> float:
        """Return the delay in ms that `share` per cent do not exceed; 0 without any."""
        total = int(self._counts.sum())
        if total == 0:
            return 0.0
        # The first step up to which so many delays are counted; its upper end is the answer.
        step = int(np.searchsorted(np.cumsum(self._counts), share / 100 * total))
        return round((step + 1) * self.STEP * 1e3, 1)


def _with_unused(before: Report | None, report: Report) -> Report:
    """Add to an action what no step has used of the one that it replaces.

    That is its memory, letters and deeds. `before`: the action that is replaced, if any.
    """
    if before is None:
        return report
    memory = report.memory
    if memory is None:
        memory = before.memory
    return replace(
        report,
        memory=memory,
        deeds=all_deeds(before.deeds, report.deeds),
        requests=[*before.requests, *report.requests],
        answers=[*before.answers, *report.answers],
    )
