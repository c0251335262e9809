"""Lookahead: which agents are asked at a tick.

`orchard.sim.engine` uses it. Terms, as in `Hold` of orchard/contract/agent.py: a "zone" is an area
around a body; it is "occupied" if a return of the body's laser lies in it; an agent that holds
"watches" zones, and wants others to be "still". "Freer" is the half of a scan with fewer returns.

Theory of operation. An action may hold its velocity for some ticks; until then its agent is not
asked. When a hold ends follows from the world, the scans and the mail alone, so it is the same in
each mode and process. Holds save work and change no result: an agent that is asked in spite of its
hold gives the velocity that it holds.

    state of a body | what happens                                | next state
    ----------------+---------------------------------------------+-----------------------------
    asked           | its action has a hold: `apply` notes what   | holding
                    | the body observes                           |
    asked           | its action has no hold                      | asked; it moves for one tick
    asked           | it gives no action                          | asked; it stands
    holding         | nothing of what was noted has changed       | holding; it moves on
    holding         | the tick of the hold's end has come         | asked
    holding         | it moved otherwise than it wanted           | asked
    holding         | its partner is another, or moves otherwise  | asked
    holding         | as a bin it became full, or empty           | asked
    holding         | a watched zone became occupied, or free     | asked
    holding         | a return in a zone that shall be still has  | asked
                    | come, gone or changed                       |
    holding         | the other half of its scan became freer     | asked
    holding         | it hears something, or `wake` names it      | asked

A hold lasts for at most MOST_HOLD ticks. Agents without a body hold until a tick, or until they
hear something.
"""

import logging
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

import msgspec
import numpy as np
from msgspec.structs import replace

from orchard.contract.agent import MOST_HOLD, MOST_ZONES, Action, Hold, Holds
from orchard.contract.difference import difference
from orchard.contract.messages import Tick
from orchard.contract.zone import Zone, spans
from orchard.field.kinds import KINDS, Laser
from orchard.sim.kernels.holds import begin_holds, end_holds
from orchard.sim.world import NONE, World

log = logging.getLogger("orchard")

# The fields of its last action that an agent promises to give again while it holds.
PROMISED = ("twist", "doing", "state", "waits_for", "steps_done")
# Different zones that are kept, with the spans of the beams in them.
MOST_SPANS = 1024
_BEAMS = max(kind.laser.beams for kind in KINDS.values())


class Lookahead:
    """The holds of one run: which agents are asked at a tick, and the velocity of the others."""

    # A sentence for each agent that is known to hold wrongly.
    wrong: Sequence[str] = ()

    def __init__(self, world: World, begin: np.ndarray, asked: Any = None) -> None:
        """Begin with no hold: all agents are asked at the first tick.

        `begin`: (n + 1,) the index of each body's first range among those of all bodies.
        `asked`: of a run that is resumed, its number `asked`; None: 0.
        """
        layout = world.layout
        n = len(layout.names)
        # Agents that were asked, added up over all ticks.
        self.asked = 0
        if asked is not None:
            self.asked = msgspec.convert(asked, Tick)
        self._agents = layout.agents
        self._layout = layout
        self._begin = begin
        self._kinds = layout.kinds
        # (n, 3): the velocity of each body's last action.
        self.wanted = np.zeros((n, 3))
        # (n,) tick at which each body's agent is asked again; 0: it does not hold.
        self._until = np.zeros(n, dtype=np.int64)
        # The same for agents without a body, by name.
        self._bodiless = dict.fromkeys(layout.scenario.bodiless_agents, 0)
        # What each body observed when its agent answered: its partner, and its velocity; whether it
        # was full; whether its zones were occupied; whether its left side was freer.
        self._partner = np.full(n, NONE, dtype=np.int64)
        self._partner_twist = np.zeros((n, 3))
        self._was_full = np.zeros(n, dtype=bool)
        self._was_occupied = np.zeros((n, MOST_ZONES), dtype=bool)
        self._was_left_freer = np.zeros(n, dtype=bool)
        # (n, MOST_ZONES) numbers of zones in `_spans`, or NONE: those that end a hold when they
        # become occupied or free, and those that do when a return in them changes.
        self._watched = np.full((n, MOST_ZONES), NONE, dtype=np.int64)
        self._still = np.full((n, MOST_ZONES), NONE, dtype=np.int64)
        # m: the reach within which the halves of the scan are compared; 0: they are not.
        self._freer_within = np.zeros(n, dtype=np.float32)
        # Of each zone the ranges at which each beam enters and leaves it, m.
        self._spans = np.zeros((MOST_SPANS, 2, _BEAMS))
        # A laser and a zone -> the index of the zone's spans.
        self._numbers: dict[tuple[Laser, Zone], int] = {}
        # The ranges of the tick before. They are read-only, as all ranges are: numba would compile
        # the kernel once more for an array of another kind.
        self._before = np.frombuffer(bytes(4 * int(begin[-1])), "<f4")
        # The agents that are asked at this tick.
        self._due: list[str] = list(self._agents)

    def due(self, world: World, ranges: np.ndarray, mail: Collection[str]) -> list[str]:
        """End the holds that are over. Return the agents that are asked now, in the layout's order.

        `ranges`: all scans of this tick, m, float32. `mail`: the agents that hear something.
        """
        end_holds(
            ranges, self._before, world.tick, self._until, self.wanted, world.twist, world.coupled,
            self._partner, self._partner_twist, world.full, self._was_full, self._watched,
            self._was_occupied, self._still, self._freer_within, self._was_left_freer, self._spans,
            self._begin,
        )  # fmt: skip
        self._before = ranges
        self.wake(mail)
        bodies = (self._until == 0).nonzero()[0].tolist()
        with_body = self._layout.names_at(bodies)
        without_body = [name for name, until in self._bodiless.items() if until <= world.tick]
        self._due = with_body + without_body
        self.asked += len(self._due)
        return self._due

    def wake(self, names: Iterable[str]) -> None:
        """End the holds of these agents. Without a further action their bodies stand."""
        for name in names:
            if name in self._layout.index:
                self._until[self._layout.index[name]] = 0
            elif name in self._bodiless:
                self._bodiless[name] = 0

    def apply(
        self, world: World, ranges: np.ndarray, actions: Mapping[str, Action]
    ) -> dict[str, Action | None]:
        """Take the actions of this tick: `wanted` gets their velocities.

        A body that holds keeps its velocity. One that neither holds nor has an action gets 0.
        Return the answers of the agents that were asked: name -> its action, or None if it gave
        none.
        """
        self.wanted[self._until == 0] = 0.0
        holding: list[int] = []
        index = self._layout.index
        for name, action in actions.items():
            i = index.get(name)
            if i is None:
                if name in self._bodiless:
                    self._bodiless[name] = _end_of(action.hold, world.tick)
                continue
            self.wanted[i] = action.twist
            self._until[i] = 0
            if action.hold is not None:
                self._begin_hold(i, world.tick, action.hold)
                holding.append(i)
        if holding:
            begin_holds(
                ranges, np.array(holding), world.twist, world.coupled, self._partner,
                self._partner_twist, world.full, self._was_full, self._watched,
                self._was_occupied, self._freer_within, self._was_left_freer, self._spans,
                self._begin,
            )  # fmt: skip
        return dict.fromkeys(self._due) | dict(actions)

    def _begin_hold(self, i: int, tick: int, hold: Hold) -> None:
        """Enter the hold of body i."""
        self._until[i] = _end_of(hold, tick)
        self._freer_within[i] = hold.freer_within
        self._enter(self._watched, i, hold.watch)
        self._enter(self._still, i, hold.still)

    def _enter(self, numbers: np.ndarray, i: int, zones: Sequence[Zone]) -> None:
        """Write the numbers of zones of body i into its row of `numbers`."""
        numbers[i] = NONE
        for z, zone in enumerate(zones):
            numbers[i, z] = self._number(self._kinds[i].laser, zone)

    def _number(self, laser: Laser, zone: Zone) -> int:
        """Return the index of a zone's spans. If there are too many zones, all holds end."""
        number = self._numbers.get((laser, zone))
        if number is None:
            if len(self._numbers) == MOST_SPANS:
                self._numbers.clear()
                self._until[:] = 0
            number = self._numbers[laser, zone] = len(self._numbers)
            self._spans[number, :, : laser.beams] = spans(laser, zone)
        return number


def _end_of(hold: Hold | None, tick: int) -> int:
    """Return the tick at which an agent is asked again, if it holds from `tick` on; else 0."""
    if hold is None:
        return 0
    return min(hold.until, tick + MOST_HOLD)


class IgnoredHolds(Lookahead):
    """Asks all agents at every tick, and so shows that holds change no result."""

    def due(self, world: World, ranges: np.ndarray, mail: Collection[str]) -> list[str]:
        """End all holds, and return all agents."""
        self._until[:] = 0
        self._bodiless = dict.fromkeys(self._bodiless, 0)
        self._due = list(self._agents)
        self.asked += len(self._due)
        return self._due


class CheckedHolds(Lookahead):
    """Asks all agents at every tick, and tells which of them hold wrongly.

    An agent does so if its answer, while it holds, differs from its last one.
    """

    def __init__(self, world: World, begin: np.ndarray, asked: Any = None) -> None:
        super().__init__(world, begin, asked)
        self._last: dict[str, Action] = {}
        self.wrong: list[str] = []
        self._reported: set[str] = set()

    def due(self, world: World, ranges: np.ndarray, mail: Collection[str]) -> list[str]:
        """End the holds that are over, and return all agents."""
        super().due(world, ranges, mail)
        return list(self._agents)

    def wake(self, names: Iterable[str]) -> None:
        """End the holds of these agents: their answers of this tick may differ."""
        names = list(names)
        super().wake(names)
        self._due = [*self._due, *(name for name in names if name not in self._due)]

    def apply(
        self, world: World, ranges: np.ndarray, actions: Mapping[str, Action]
    ) -> dict[str, Action | None]:
        """Take the actions of the agents that are due; check those of the others."""
        due = set(self._due)
        for name, action in actions.items():
            if name not in due and name not in self._reported and name in self._last:
                broken = _broken_promise(self._last[name], action)
                if broken:
                    self._reported.add(name)
                    self.wrong.append(f"{name} holds wrongly, tick {world.tick}: {broken}")
                    log.error("%s", self.wrong[-1])
        asked = {name: action for name, action in actions.items() if name in due}
        self._last |= asked
        return super().apply(world, ranges, asked)


HOLDS: dict[Holds, type[Lookahead]] = {
    "on": Lookahead,
    "ignored": IgnoredHolds,
    "checked": CheckedHolds,
}


def _broken_promise(held: Action, action: Action) -> str:
    """Return how an action differs from what an agent that holds would give; '' if it does not.

    `held`: the action with which it began to hold.
    """
    again = {name: getattr(held, name) for name in PROMISED}
    # Its memory and its hold may be new.
    promised = replace(action, deeds=[], requests=[], answers=[], **again)
    return difference(promised, action, "its answer")
