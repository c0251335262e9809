"""The time that each robot spends in each state. A robot has one state in each tick, so its states add up to the run."""

from collections.abc import Mapping
from typing import Any

import msgspec
import numpy as np

from orchard.contract.agent import STATES, Action, state_of
from orchard.field.kinds import kind_of
from orchard.field.scenario import TIME_STEP
from orchard.sim.world import World

ROBOTS = ("picker", "carrier", "tractor", "bin")  # the kinds for which states are counted
_NUMBER = {state: number for number, state in enumerate(STATES)}


class StateCounts(msgspec.Struct):
    """The state of `StateTimes`, as plain data for a snapshot."""

    since: int  # tick at which counting began
    ticks: dict[str, list[int]]  # robot -> ticks in each of STATES
    stopped: dict[str, int] = {}  # robot -> ticks under an emergency stop


class StateTimes:
    """The ticks that each robot has spent in each state. An agent sets its robot's state; an emergency stop overrides it."""

    def __init__(self, world: World, data: dict[str, Any] | None = None) -> None:
        """`data`: of a resumed run, `counts` as plain data. Raises ValueError or KeyError if it does not fit the world."""
        robots = [name for name in world.layout.names if kind_of(name) in ROBOTS]
        new = StateCounts(world.tick, {name: [0] * len(STATES) for name in robots})
        known = new if data is None else msgspec.convert(data, StateCounts)
        self._known = StateCounts(known.since, {name: known.ticks[name] for name in robots}, known.stopped)
        if any(len(ticks) != len(STATES) for ticks in self._known.ticks.values()):
            raise ValueError(f"states: each robot must have {len(STATES)} numbers")
        self._row = {name: row for row, name in enumerate(robots)}
        self._body = np.array([world.layout.index[name] for name in robots], dtype=np.int64)
        self._ticks = np.array(list(self._known.ticks.values()), dtype=np.int64).reshape(-1, len(STATES))
        self._stopped = np.array([self._known.stopped.get(name, 0) for name in robots], dtype=np.int64)
        self._now = np.full(len(robots), _NUMBER["resting"])  # the number of each robot's state
        self._rows = np.arange(len(robots))

    @property
    def counts(self) -> StateCounts:
        """The ticks so far, as plain data."""
        stopped = {name: ticks for name, ticks in zip(self._row, self._stopped.tolist(), strict=True) if ticks}
        return StateCounts(self._known.since, dict(zip(self._row, self._ticks.tolist(), strict=True)), stopped)

    def update(self, world: World, answers: Mapping[str, Action | None]) -> None:
        """Count the tick that has just ended. `answers`: of the agents that were asked. A robot without an action rests."""
        for name, action in answers.items():
            if (row := self._row.get(name)) is not None:
                self._now[row] = _NUMBER["resting" if action is None else state_of(action)]
        stopped = world.stopped[self._body]
        self._ticks[self._rows, np.where(stopped, _NUMBER["stopped"], self._now)] += 1
        self._stopped += stopped

    def faults(self, world: World) -> list[str]:
        """Return a sentence for each robot if its states do not add up to the run."""
        run = world.tick - self._known.since
        sums = [(name, sum(ticks)) for name, ticks in self.counts.ticks.items()]
        return [f"tick {world.tick}: {name}'s states add up to {ticks} ticks, the run to {run}" for name, ticks in sums if ticks != run]

    def figures(self) -> dict[str, Any]:
        """Return figures for the summary, s: the time of each kind in each state, all robots together, and of each robot under a stop."""
        kinds, counts = dict[str, dict[str, float]](), self.counts
        for kind in ROBOTS:
            of_kind = [ticks for name, ticks in counts.ticks.items() if kind_of(name) == kind]
            spent = {state: _seconds(sum(ticks[number] for ticks in of_kind)) for state, number in _NUMBER.items()}
            kinds |= {kind: {state: seconds for state, seconds in spent.items() if seconds}} if of_kind else {}
        return {"state_seconds": kinds, "stopped_seconds": {name: _seconds(ticks) for name, ticks in counts.stopped.items()}}


def _seconds(ticks: int) -> float:
    return round(ticks * TIME_STEP, 1)
