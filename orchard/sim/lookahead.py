"""Lookahead: which agents are asked at a tick. An action may hold its velocity for some ticks; until then its agent is not asked.

When a hold ends follows from the world, the scans and the mail alone, so it is the same in each mode and process. Holds save work and
change no result: an agent that is asked in spite of its hold gives the velocity that it holds.
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

PROMISED = (
    "twist",
    "doing",
    "state",
    "waits_for",
    "steps_done",
)  # what an agent that holds would give again
MOST_SPANS = 1024  # different zones that are kept
_BEAMS = max(kind.laser.beams for kind in KINDS.values())


class Lookahead:
    """The holds of one run."""

    wrong: Sequence[str] = ()  # a sentence for each agent that is known to hold wrongly

    def __init__(self, world: World, begin: np.ndarray, asked: Any = None) -> None:
        """`begin`: (n + 1,) the index of each body's first range among those of all bodies. `asked`: `asked` of a run that is resumed."""
        self.asked = (
            0 if asked is None else msgspec.convert(asked, Tick)
        )  # agents asked, added up over all ticks
        n, layout = len(world.layout.names), world.layout
        self._agents, self._layout, self._begin = layout.agents, layout, begin
        self._lasers: list[Laser] = [KINDS[start.kind].laser for start in layout.starts]
        self.wanted = np.zeros((n, 3))  # the velocity of each body's last action
        self._until = np.zeros(
            n, dtype=np.int64
        )  # tick at which it is asked again; 0: it does not hold
        self._bodiless = {
            name: 0 for name in layout.agents if name not in layout.index
        }  # the same for agents without a body
        self._partner, self._partner_twist = np.full(n, NONE, dtype=np.int64), np.zeros((n, 3))
        self._was_full, self._was_occupied = (
            np.zeros(n, dtype=bool),
            np.zeros((n, MOST_ZONES), dtype=bool),
        )
        self._watched, self._still = (
            np.full((n, MOST_ZONES), NONE, dtype=np.int64) for _ in range(2)
        )
        self._freer_within, self._was_left_freer = (
            np.zeros(n, dtype=np.float32),
            np.zeros(n, dtype=bool),
        )
        self._spans, self._numbers = (
            np.zeros((MOST_SPANS, 2, _BEAMS)),
            dict[tuple[Laser, Zone], int](),
        )
        self._before = np.frombuffer(
            bytes(4 * int(begin[-1])), "<f4"
        )  # the ranges of the tick before; read-only, as all ranges
        self._due: list[str] = list(self._agents)  # the agents that are asked at this tick

    def due(self, world: World, ranges: np.ndarray, mail: Collection[str]) -> list[str]:
        """End the holds that are over, and return the agents that are asked now, in the layout's order. `mail`: those that hear."""
        end_holds(
            ranges, self._before, world.tick, self._until, self.wanted, world.twist, world.coupled, self._partner, self._partner_twist,
            world.full, self._was_full, self._watched, self._was_occupied, self._still,
            self._freer_within, self._was_left_freer, self._spans, self._begin,
        )  # fmt: skip
        self._before = ranges
        self.wake(mail)
        names, bodies = self._agents, (self._until == 0).nonzero()[0].tolist()
        self._due = [names[i] for i in bodies] + [
            name for name, until in self._bodiless.items() if until <= world.tick
        ]
        self.asked += len(self._due)
        return self._due

    def wake(self, names: Iterable[str]) -> None:
        """End the holds of these agents. Without a further action their bodies stand."""
        for name in names:
            if name in self._layout.index:
                self._until[self._layout.index[name]] = 0
            elif name in self._bodiless:
                self._bodiless[name] = 0

    def hold(
        self, world: World, ranges: np.ndarray, actions: Mapping[str, Action]
    ) -> dict[str, Action | None]:
        """Take the actions of this tick: `wanted` gets their velocities. A body that holds keeps its velocity; any other gets 0.

        Return the answers of the agents that were asked: name -> its action, or None if it gave none.
        """
        self.wanted[self._until == 0] = 0.0
        holding: list[int] = []
        index = self._layout.index
        for name, action in actions.items():
            if (i := index.get(name)) is None:
                if name in self._bodiless:
                    self._bodiless[name] = (
                        0 if action.hold is None else min(action.hold.until, world.tick + MOST_HOLD)
                    )
                continue
            self.wanted[i] = action.twist
            self._until[i] = 0
            if action.hold is not None:
                self._begin_hold(i, world.tick, action.hold)
                holding.append(i)
        if holding:
            begin_holds(
                ranges, np.array(holding), world.twist, world.coupled, self._partner, self._partner_twist, world.full, self._was_full,
                self._watched, self._was_occupied, self._freer_within, self._was_left_freer, self._spans, self._begin,
            )  # fmt: skip
        return dict.fromkeys(self._due) | dict(actions)

    def _begin_hold(self, i: int, tick: int, hold: Hold) -> None:
        self._until[i], self._freer_within[i] = min(hold.until, tick + MOST_HOLD), hold.freer_within
        for numbers, zones in ((self._watched, hold.watch), (self._still, hold.still)):
            numbers[i] = NONE
            for z, zone in enumerate(zones):
                numbers[i, z] = self._number(self._lasers[i], zone)

    def _number(self, laser: Laser, zone: Zone) -> int:
        """The index of a zone's spans. If there are too many zones, all holds end."""
        number = self._numbers.get((laser, zone))
        if number is None:
            if len(self._numbers) == MOST_SPANS:
                self._numbers.clear()
                self._until[:] = 0
            number = self._numbers[laser, zone] = len(self._numbers)
            self._spans[number, :, : laser.beams] = spans(laser, zone)
        return number


class IgnoredHolds(Lookahead):
    """Asks all agents at every tick, and so shows that holds change no result."""

    def due(self, world: World, ranges: np.ndarray, mail: Collection[str]) -> list[str]:
        self._until[:], self._bodiless = 0, dict.fromkeys(self._bodiless, 0)
        self._due = list(self._agents)
        self.asked += len(self._due)
        return self._due


class CheckedHolds(Lookahead):
    """Asks all agents at every tick, and tells how the answer of an agent that holds differs from its last one."""

    def __init__(self, world: World, begin: np.ndarray, asked: Any = None) -> None:
        super().__init__(world, begin, asked)
        self._last: dict[str, Action] = {}
        self.wrong: list[str] = []
        self._told: set[str] = set()

    def due(self, world: World, ranges: np.ndarray, mail: Collection[str]) -> list[str]:
        super().due(world, ranges, mail)
        return list(self._agents)

    def wake(self, names: Iterable[str]) -> None:
        names = list(names)
        super().wake(names)
        self._due = [*self._due, *(name for name in names if name not in self._due)]

    def hold(
        self, world: World, ranges: np.ndarray, actions: Mapping[str, Action]
    ) -> dict[str, Action | None]:
        due = set(self._due)
        for name, action in actions.items():
            if (
                name not in due
                and name in self._last
                and (wrong := _broken_promise(self._last[name], action))
                and name not in self._told
            ):
                self._told.add(name)
                self.wrong.append(f"{name} holds wrongly, tick {world.tick}: {wrong}")
                log.error("%s", self.wrong[-1])
        asked = {name: action for name, action in actions.items() if name in due}
        self._last |= asked
        return super().hold(world, ranges, asked)


HOLDS: dict[Holds, type[Lookahead]] = {
    "on": Lookahead,
    "ignored": IgnoredHolds,
    "checked": CheckedHolds,
}


def _broken_promise(held: Action, action: Action) -> str:
    status = {name: getattr(held, name) for name in PROMISED}
    return difference(
        replace(action, deeds=[], requests=[], answers=[], **status), action, "its answer"
    )
