"""The time that each robot spends in each state, for the summary of a run.

A robot has one state in each tick, so its states add up to the run. The states are those of
`STATES` in orchard/contract/agent.py. A robot under an emergency stop is "latched" (see stops.py).
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import msgspec

from orchard.contract.agent import STATES, Action, state_of
from orchard.field.kinds import ROBOTS, kind_of
from orchard.field.scenario import TIME_STEP
from orchard.sim.world import World

# State -> its index in STATES.
_NUMBER = {state: number for number, state in enumerate(STATES)}


class StateCounts(msgspec.Struct):
    """The state of `StateTimes`, as plain data for a snapshot."""

    # Tick at which counting began.
    since: int
    # Robot -> its ticks in each of STATES.
    ticks: dict[str, list[int]]
    # Robot -> its ticks under an emergency stop.
    stopped: dict[str, int] = {}


class StateTimes:
    """The ticks that each robot has spent in each state.

    An agent sets its robot's state; an emergency stop overrides it.
    """

    def __init__(self, world: World, data: dict[str, Any] | None = None) -> None:
        """Begin to count at the world's tick, or go on with what a resumed run has counted.

        `data`: `counts` as plain data. Raises ValueError or KeyError if it does not fit the world.
        """
        robots = world.layout.names_of(*ROBOTS)
        if data is None:
            self._known = StateCounts(world.tick, {})
            for name in robots:
                self._known.ticks[name] = [0] * len(STATES)
                self._known.stopped[name] = 0
        else:
            self._known = _counts_in(data, robots)
        self._body = {name: world.layout.index[name] for name in robots}
        # Robot -> the number of its state.
        self._now = dict.fromkeys(robots, _NUMBER["resting"])
        # Whether each body is stopped, one byte each: 0 or 1.
        self._latched = bytes(len(world.stopped))
        counted = max((sum(ticks) for ticks in self._known.ticks.values()), default=0)
        # The tick at which the last update ended.
        self._tick = self._known.since + counted
        # Robot -> the tick up to which its ticks are counted.
        self._from = dict.fromkeys(robots, self._tick)

    @property
    def counts(self) -> StateCounts:
        """The ticks up to now."""
        self._count(self._body, self._tick)
        return self._known

    def update(self, world: World, answers: Mapping[str, Action | None]) -> None:
        """Take the tick that has just ended.

        `answers`: of the agents that were asked. A robot without an action rests.
        """
        # The state of a robot in the tick that has just ended is what its agent answered before it.
        begun = self._tick
        self._tick = world.tick
        latched = world.stopped.tobytes()
        if latched != self._latched:
            self._count(self._body, begun)
            self._latched = latched
        for name, action in answers.items():
            if action is None:
                state = _NUMBER["resting"]
            else:
                state = _NUMBER[state_of(action)]
            if self._now.get(name, state) != state:
                self._count([name], begun)
                self._now[name] = state

    def _count(self, names: Iterable[str], until: int) -> None:
        """Add the ticks of robots in their present states, up to a tick.

        That is done only when a state changes, because most states last for many ticks.
        """
        for name in names:
            ticks = until - self._from[name]
            self._from[name] = until
            if self._latched[self._body[name]]:
                self._known.ticks[name][_NUMBER["stopped"]] += ticks
                self._known.stopped[name] += ticks
            else:
                self._known.ticks[name][self._now[name]] += ticks

    def faults(self, world: World) -> list[str]:
        """Return a sentence for each robot if its states do not add up to the run."""
        run = world.tick - self._known.since
        faults = []
        for name, ticks in self.counts.ticks.items():
            if sum(ticks) != run:
                fault = f"{name}'s states add up to {sum(ticks)} ticks, the run to {run}"
                faults.append(f"tick {world.tick}: {fault}")
        return faults

    def figures(self) -> dict[str, Any]:
        """Return figures for the summary, s.

        They are the time of each kind in each state, of all its robots together, and the time of
        each robot under a stop. What is 0 is left out.
        """
        counts = self.counts
        kinds = {}
        for kind in ROBOTS:
            of_kind = [ticks for name, ticks in counts.ticks.items() if kind_of(name) == kind]
            if of_kind:
                kinds[kind] = _seconds_by_state(of_kind)
        stopped = {name: _seconds(ticks) for name, ticks in counts.stopped.items() if ticks}
        return {"state_seconds": kinds, "stopped_seconds": stopped}


def _counts_in(data: dict[str, Any], robots: Sequence[str]) -> StateCounts:
    """Return what a resumed run has counted, of these robots.

    Raises ValueError or KeyError if a robot or one of its states is missing.
    """
    known = msgspec.convert(data, StateCounts)
    counts = StateCounts(known.since, {})
    for name in robots:
        counts.ticks[name] = known.ticks[name]
        counts.stopped[name] = known.stopped.get(name, 0)
        if len(counts.ticks[name]) != len(STATES):
            raise ValueError(f"states: each robot must have {len(STATES)} numbers")
    return counts


def _seconds_by_state(counts: list[list[int]]) -> dict[str, float]:
    """Return the time of robots by state, s, without states of none. `counts`: as in `ticks`."""
    seconds: dict[str, float] = {}
    for state, number in _NUMBER.items():
        total = _seconds(sum(ticks[number] for ticks in counts))
        if total:
            seconds[state] = total
    return seconds


def _seconds(ticks: int) -> float:
    """Return the length of some ticks, s, to a tenth."""
    return round(ticks * TIME_STEP, 1)
