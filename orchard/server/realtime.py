"""Realtime, without a network: the wall clock goes on, and the newest velocity counts.

A tick's answers have until the next tick is due; where the machine hiccups they have a moment longer, which the ticks after it make up
for. Then the step is done without those that are missing. `UnownedCommands` is used in both modes.
"""

from collections import deque
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np
from msgspec.structs import replace

from orchard.contract.agent import MOST_DEEDS, Action
from orchard.contract.messages import Deed
from orchard.field.geometry import STILL, Twist
from orchard.net.refusals import Refused, refuse_other_tick
from orchard.server.lockstep import Barrier
from orchard.server.roster import Roster
from orchard.wire.codec import twist_of
from orchard.wire.messages import Report, Velocity

WATCHDOG = 0.5  # s of wall time that one velocity drives a robot at least, in realtime; in lockstep only WATCHDOG_TICKS count
WATCHDOG_TICKS = 5
SLACK = 0.2  # s beyond the tick's time, to wait for agents that answered the last tick in time; less than Pacer.CATCH_UP
SHARE = 0.5  # of a tick's time, to wait for agents that missed the last tick, and for all agents when the clock is behind
LATE = 0.5  # of a tick's time: a tick that begins later than this after it was due counts as late


class RecentTicks:
    """The ticks of which velocities may still drive a robot: less than WATCHDOG_TICKS ticks or less than `seconds` ago."""

    def __init__(self, clock: Callable[[], float], seconds: float = WATCHDOG) -> None:
        self.clock, self.newest, self._seconds = clock, 0, seconds
        self._begun: deque[tuple[int, float]] = deque([(0, clock())])  # (tick, time of its publication, s)

    def begin(self, tick: int) -> None:
        """Record the publication of a new tick."""
        self.newest = tick
        self._begun.append((tick, self.clock()))
        while self.is_over(*self._begun[0], tick):
            self._begun.popleft()

    @property
    def oldest(self) -> int:
        return self._begun[0][0]

    def is_over(self, tick: int, at: float, now: int) -> bool:
        """Whether a velocity for `tick`, received at time `at`, does not drive any more at the tick `now`."""
        return now - tick >= WATCHDOG_TICKS and self.clock() - at >= self._seconds


class TimedReport(NamedTuple):
    """An action, the tick that it answers, and the time of its arrival."""

    tick: int
    report: Report
    at: float  # s, on the clock


class UnownedCommands:
    """The velocities of robots that no session owns: the newest one drives a robot, for half a second."""

    def __init__(self, clock: Callable[[], float], seconds: float = WATCHDOG) -> None:
        """`seconds`: of wall time that a velocity drives at least; 0 in lockstep, where simulated time alone counts."""
        self._recent = RecentTicks(clock, seconds)
        self._puts: dict[str, tuple[int, Twist, float]] = {}  # name -> the tick of its velocity, that, and the time of its arrival, s
        self._deeds: dict[str, list[Deed]] = {}  # deeds that no step has used

    def begin(self, tick: int) -> None:
        self._recent.begin(tick)

    def take(self, name: str, velocity: Velocity) -> None:
        """Take a velocity for a robot. Raises Refused if it names an owner, or if its tick is too old or in the future."""
        if velocity.owner:
            raise Refused("not owned", "no session owns this agent; join first")
        newest_put = self._puts[name][0] if name in self._puts else 0
        refuse_other_tick(velocity.tick, max(self._recent.oldest, newest_put), self._recent.newest)
        self._puts[name] = velocity.tick, twist_of(velocity), self._recent.clock()
        self._deeds[name] = _all_deeds(self._deeds.get(name, []), velocity.deeds)

    def drives(self, name: str) -> bool:
        """Whether a client has driven this robot recently."""
        return name in self._puts

    def actions(self, tick: int) -> dict[str, Action]:
        """Return the actions to apply at a tick, by name; each deed is in them once."""
        deeds, self._deeds = self._deeds, {}
        self._puts = {name: put for name, put in self._puts.items() if not self._recent.is_over(put[0], put[2], tick)}
        return {name: Action(twist, deeds.get(name, [])) for name, (_, twist, _) in self._puts.items()}


class RealtimeBarrier(Barrier):
    """The newest action of each owned agent. The counterpart is `lockstep.LockstepBarrier`."""

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
        """Open a tick and wait for the agents that are due, None: all that are held. `lag`: seconds that it begins late."""
        self._recent.begin(tick)
        self.tick, self.missing, self._begun = tick, set(self._roster.owners if due is None else due), self._clock()
        self._patient = self._begun + max(self._step + SLACK - lag, self._step * SHARE)
        self._late += lag > self._step * LATE

    @property
    def deadline(self) -> float:
        """The time, on the clock, to wait for missing answers. Agents that missed the last tick do not delay the others."""
        return self._patient if self.missing - self._tardy else self._begun + self._step * SHARE

    def expect(self, name: str) -> None:
        """Wait for an agent that a session has just taken."""
        self.release(name)
        self.missing.add(name)

    def release(self, name: str) -> None:
        """Stop waiting for an agent that no session owns any more; its robot stands."""
        self._newest.pop(name, None)
        self._fresh.pop(name, None)
        self.missing.discard(name)
        self._tardy.discard(name)

    def take(self, name: str, owner: str, tick: int, report: Report) -> None:
        """Take the action of a owned agent. Raises Refused if it does not count."""
        self._refuse_unless_held_by(name, owner)
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
        held = sorted(self._roster.owners)
        self._tardy = {name for name in held if name not in self._newest or self._newest[name].tick != self.tick}
        self._missed += len(self._tardy)
        self.reports, self._fresh = self._fresh, {}
        puts, is_over = sorted(self._newest.items()), self._recent.is_over
        return {name: self._action(name, put) for name, put in puts if not is_over(put.tick, put.at, self.tick)}

    def _action(self, name: str, put: TimedReport) -> Action:
        action = self.reports[name] if name in self.reports else replace(put.report, deeds=[], requests=[], answers=[])
        if put.report.once and self._moved.get(name, -1) >= put.tick:  # it has moved since the pose that this answers
            action = replace(action, twist=STILL)
        if action.twist != STILL:
            self._moved[name] = self.tick
        return action

    def figures(self) -> dict[str, Any]:
        delays = {f"p{share}": self._delays.below(share) for share in (50, 99)}
        return {"ticks_late": self._late, "velocities_missed": self._missed, "answer_milliseconds": delays}


class Delays:
    """The delays from the observations to the velocities, as counts in steps of 0.1 ms, so that memory does not grow."""

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
    return replace(report, memory=memory, deeds=_all_deeds(before.deeds, report.deeds), requests=requests, answers=answers)


def _all_deeds(before: list[Deed], now: list[Deed]) -> list[Deed]:
    return [*(deed for deed in before if deed not in now), *now][:MOST_DEEDS]
