"""The physics side of realtime, without a network: the wall clock goes on, and the newest velocity counts.

The counterpart of `lockstep.Answers`, with the same methods. A tick's answers have until the next tick is due; where the machine
hiccups they have a moment longer, which the ticks after it make good. Then the step is done without those that are missing.
"""

import time
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np

from orchard.contract.agent import Action
from orchard.contract.messages import MOST_DEEDS, Written
from orchard.field.geometry import STILL
from orchard.net.refusals import WHOSE, Refused, refuse_other_tick
from orchard.net.roster import Roster
from orchard.net.unheld import RecentTicks, TimedVelocity
from orchard.wire.codec import action_of
from orchard.wire.messages import Mode, Velocity

SLACK = 0.2  # s beyond the tick's own time, for answers of those who answered the last tick in time; less than Pacer.CATCH_UP
SHARE = 0.5  # of a tick's time, that the others have, and everybody where the clock is behind
LATE = 0.5  # of a tick's time: a tick that begins later than this after its time is a late one


class RealtimeBarrier:
    """The newest velocity of each agent that is held."""

    mode: Mode = "realtime"
    newest_wins = True  # an old tick is of no use to anybody
    releases_at_once = True  # the robot of one who is gone stands, and waits for nobody

    def __init__(self, roster: Roster, step: float, clock: Callable[[], float] = time.monotonic) -> None:
        """`step`: s of wall time from one tick to the next."""
        self._roster, self._step, self._clock = roster, step, clock
        self._recent = RecentTicks(clock)
        self._newest: dict[str, TimedVelocity] = {}
        self._fresh: dict[str, Velocity] = {}  # those that no step has used
        self._moved: dict[str, int] = {}  # name -> the last tick at which it was driven
        self._tardy: set[str] = set()  # who missed the last tick
        self._begun = self._patient = clock()
        self._late = self._missed = 0
        self._delays = Delays()
        self.tick = -1
        self.missing: set[str] = set()
        self.velocities: dict[str, Velocity] = {}  # those that the last step was the first to use

    # -- what arrives

    def open(self, tick: int, lag: float = 0.0) -> None:
        """A new tick begins, so many seconds after it was due."""
        self._recent.begin(tick)
        self.tick, self.missing, self._begun = tick, set(self._roster.holders), self._clock()
        self._patient = self._begun + max(self._step + SLACK - lag, self._step * SHARE)
        self._late += lag > self._step * LATE

    @property
    def deadline(self) -> float:
        """Until when the missing are waited for: those who were late before do not hold up the others."""
        return self._patient if self.missing - self._tardy else self._begun + self._step * SHARE

    def expect(self, name: str) -> None:
        """Somebody new holds an agent."""
        self.release(name)
        self.missing.add(name)

    def release(self, name: str) -> None:
        """Nobody holds this agent any more: it stands."""
        self._newest.pop(name, None)
        self._fresh.pop(name, None)
        self.missing.discard(name)
        self._tardy.discard(name)

    def take(self, name: str, velocity: Velocity) -> None:
        if velocity.holder != self._roster.holders[name]:
            raise Refused("not the holder", WHOSE["not the holder"])
        last = self._newest[name].velocity.tick if name in self._newest else -1
        if last >= 0 and velocity == self._newest[name].velocity:
            return  # sent again, in case it was lost
        if velocity.tick == last:
            raise Refused("answered already", f"tick {velocity.tick}")
        refuse_other_tick(velocity.tick, max(self._recent.oldest, last), self.tick)
        self._fresh[name] = _with_what_was_said(self._fresh.get(name), velocity)
        self._newest[name] = TimedVelocity(velocity, self._clock())
        if velocity.tick == self.tick:
            self.missing.discard(name)
            self._delays.add(self._newest[name].at - self._begun)

    def give_up(self) -> set[str]:
        """The deadline is over: go on without the missing, who lose nothing by it."""
        self.missing = set()
        return set()

    # -- one step

    def actions(self) -> dict[str, Action]:
        """What to apply, in the order of names; each deed once."""
        held = sorted(self._roster.holders)
        self._tardy = {name for name in held if name not in self._newest or self._newest[name].velocity.tick != self.tick}
        self._missed += len(self._tardy)
        self.velocities, self._fresh = self._fresh, {}
        return {name: self._action(name, put) for name, put in sorted(self._newest.items()) if self._counts(put)}

    def _counts(self, put: TimedVelocity) -> bool:
        return not self._recent.is_over(put.velocity.tick, put.at, self.tick)

    def _action(self, name: str, put: TimedVelocity) -> Action:
        action = action_of(self.velocities.get(name, put.velocity))
        if name not in self.velocities:
            action.deeds = []
        if put.velocity.once and not self._is_for_now(name, put.velocity.tick):
            action.twist = STILL
        if action.twist != STILL:
            self._moved[name] = self.tick
        return action

    def _is_for_now(self, name: str, tick: int) -> bool:
        """Whether the robot has not moved since the pose that an answer was given to."""
        return self._moved.get(name, -1) < tick

    def digests(self) -> dict[str, bytes]:
        return {name: velocity.report.mail for name, velocity in self.velocities.items() if velocity.report is not None}

    def figures(self) -> dict[str, Any]:
        """What the summary holds of it."""
        delays = {f"p{share}": self._delays.below(share) for share in (50, 99)}
        return {"ticks_late": self._late, "velocities_missed": self._missed, "answer_milliseconds": delays}


class Delays:
    """How long answers took from what was seen to the velocity: counts in steps of 0.1 ms, so that it does not grow."""

    STEP = 1e-4  # s

    def __init__(self) -> None:
        self._counts = np.zeros(10_001, dtype=np.int64)  # the last one for all that took a second or longer

    def add(self, seconds: float) -> None:
        self._counts[min(max(int(seconds / self.STEP), 0), len(self._counts) - 1)] += 1

    def below(self, share: float) -> float:
        """The time in ms within which so many per cent came; 0 where there were none."""
        total = int(self._counts.sum())
        step = int(np.searchsorted(np.cumsum(self._counts), share / 100 * total)) if total else -1
        return round((step + 1) * self.STEP * 1e3, 1)


def _with_what_was_said(before: Velocity | None, velocity: Velocity) -> Velocity:
    """A velocity with the memory, the letters and the deeds of the one whose place it takes, which no step has used."""
    if before is None or before.report is None:
        return velocity
    if velocity.report is None:
        return msgspec.structs.replace(velocity, report=before.report)
    report = velocity.report
    memory = before.report.memory if report.memory is None else report.memory
    deeds = [deed for deed in before.report.deeds if deed not in report.deeds] + report.deeds
    letters = _both(before.report.letters, report.letters)
    report = msgspec.structs.replace(report, memory=memory, deeds=deeds[:MOST_DEEDS], letters=letters)
    return msgspec.structs.replace(velocity, report=report)


def _both(before: Written | None, now: Written | None) -> Written | None:
    """The letters of two velocities."""
    if before is None or now is None:
        return before or now
    return Written([*before.requests, *now.requests], [*before.answers, *now.answers])
