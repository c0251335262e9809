"""The time that each robot spends in each state. A robot has one state in each tick, so its states add up to the run."""

from collections.abc import Iterable, Mapping
from typing import Any

import msgspec

from orchard.contract.agent import STATES, Action, state_of
from orchard.field.kinds import ROBOTS, kind_of
from orchard.field.scenario import TIME_STEP
from orchard.sim.world import World

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
        stopped = {name: known.stopped.get(name, 0) for name in robots}
        self._known = StateCounts(
            known.since, {name: known.ticks[name] for name in robots}, stopped
        )
        if any(len(ticks) != len(STATES) for ticks in self._known.ticks.values()):
            raise ValueError(f"states: each robot must have {len(STATES)} numbers")
        self._body = {name: world.layout.index[name] for name in robots}
        self._now = dict.fromkeys(robots, _NUMBER["resting"])  # robot -> the number of its state
        self._latched = bytes(len(world.stopped))  # whether each body is stopped
        self._tick = known.since + max(
            (sum(ticks) for ticks in self._known.ticks.values()), default=0
        )  # at which the last update ended
        self._from = dict.fromkeys(
            robots, self._tick
        )  # robot -> the tick up to which its ticks are counted

    @property
    def counts(self) -> StateCounts:
        self._count(self._body, self._tick)
        return self._known

    def update(self, world: World, answers: Mapping[str, Action | None]) -> None:
        """Take the tick that has just ended. `answers`: of the agents that were asked. A robot without an action rests."""
        begun, self._tick = self._tick, world.tick
        if (latched := world.stopped.tobytes()) != self._latched:
            self._count(self._body, begun)
            self._latched = latched
        for name, action in answers.items():
            state = _NUMBER["resting" if action is None else state_of(action)]
            if self._now.get(name, state) != state:
                self._count([name], begun)
                self._now[name] = state

    def _count(self, names: Iterable[str], until: int) -> None:
        """Add the ticks of robots in their present states: only when a state changes, because most states last for many ticks."""
        for name in names:
            ticks, self._from[name] = until - self._from[name], until
            if self._latched[self._body[name]]:
                self._known.ticks[name][_NUMBER["stopped"]] += ticks
                self._known.stopped[name] += ticks
            else:
                self._known.ticks[name][self._now[name]] += ticks

    def faults(self, world: World) -> list[str]:
        """Return a sentence for each robot if its states do not add up to the run."""
        run = world.tick - self._known.since
        sums = [(name, sum(ticks)) for name, ticks in self.counts.ticks.items()]
        return [
            f"tick {world.tick}: {name}'s states add up to {ticks} ticks, the run to {run}"
            for name, ticks in sums
            if ticks != run
        ]

    def figures(self) -> dict[str, Any]:
        """Return figures for the summary, s: the time of each kind in each state, all robots together, and of each robot under a stop."""
        kinds, counts = dict[str, dict[str, float]](), self.counts
        for kind in ROBOTS:
            of_kind = [ticks for name, ticks in counts.ticks.items() if kind_of(name) == kind]
            spent = {
                state: _seconds(sum(ticks[number] for ticks in of_kind))
                for state, number in _NUMBER.items()
            }
            kinds |= (
                {kind: {state: seconds for state, seconds in spent.items() if seconds}}
                if of_kind
                else {}
            )
        return {
            "state_seconds": kinds,
            "stopped_seconds": {
                name: _seconds(ticks) for name, ticks in counts.stopped.items() if ticks
            },
        }


def _seconds(ticks: int) -> float:
    return round(ticks * TIME_STEP, 1)
