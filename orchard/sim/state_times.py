"""What each robot does, as physics sees it, and for how long: exactly one state a tick, so that the states of each add up to the run."""

from typing import Any

import msgspec
import numpy as np

from orchard.field.kinds import kind_of
from orchard.field.scenario import TIME_STEP
from orchard.sim.kernels.move import NOBODY
from orchard.sim.kernels.watch import ROBOTS, STATES, count_states
from orchard.sim.world import World


class Counted(msgspec.Struct):
    """What it remembers of the ticks before, as plain data."""

    since: int  # tick
    ticks: dict[str, list[int]]  # robot -> of each of STATES


class StateTimes:
    """The ticks that each robot has spent in each of STATES, since the tick at which this began."""

    def __init__(self, world: World, data: dict[str, Any] | None = None) -> None:
        """With the data of another, it goes on from there; raises ValueError, KeyError or OverflowError where they are none."""
        self._kinds = np.array([ROBOTS.index(s.kind) if s.kind in ROBOTS else NOBODY for s in world.layout.starts], dtype=np.int64)
        self._names = [(i, name) for name, i in world.layout.index.items() if self._kinds[i] != NOBODY]
        self._ticks = np.zeros((len(self._kinds), len(STATES)), dtype=np.int64)
        self._fill = world.fill.copy()
        self.since = world.tick
        if data is not None:
            counted = msgspec.convert(data, Counted)
            self.since = counted.since
            for i, name in self._names:
                self._ticks[i] = counted.ticks[name]

    def as_data(self) -> dict[str, Any]:
        """All that it must remember, plain: for a snapshot."""
        return {"since": self.since, "ticks": {name: self._ticks[i].tolist() for i, name in self._names}}

    def update(self, world: World) -> None:
        """Account for the tick that has just ended."""
        fill = world.fill
        count_states(self._kinds, world.twist, world.coupled, fill, self._fill, world.bay_ticks, world.stopped, self._ticks)
        self._fill = fill.copy()

    def faults(self, world: World) -> list[str]:
        """Robots whose states do not add up to the run; a sentence for each."""
        run = world.tick - self.since
        sums = [(name, int(self._ticks[i].sum())) for i, name in self._names]
        return [f"tick {world.tick}: {name}'s states add up to {ticks} ticks, the run to {run}" for name, ticks in sums if ticks != run]

    def figures(self) -> dict[str, Any]:
        """What the summary holds of it: the seconds of all robots of a kind, and those of each that was stopped."""
        kinds: dict[str, dict[str, float]] = {}
        for kind in ROBOTS:
            of_kind = sum((self._ticks[i] for i, name in self._names if kind_of(name) == kind), np.zeros(len(STATES), dtype=np.int64))
            spent = {state: _seconds(int(n)) for state, n in zip(STATES, of_kind, strict=True) if n}
            kinds |= {kind: spent} if spent else {}
        stopped = {name: _seconds(int(self._ticks[i, 0])) for i, name in self._names if self._ticks[i, 0]}
        return {"state_seconds": kinds, "stopped_seconds": stopped}


def _seconds(ticks: int) -> float:
    return round(ticks * TIME_STEP, 1)
