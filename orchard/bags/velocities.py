"""Which velocities of a bag fall within a replay of it: `orchard replay` refuses a bag of which
none can, before the run, and says how many did, after the run.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from orchard.field.scenario import TICKS_PER_SECOND, TIME_STEP

# Ticks of a hundred days: no harvest takes so long. Stamps of the wall clock count from 1970, so
# they lie far beyond it, and are refused.
LONGEST_HARVEST = 100 * 24 * 3600 * TICKS_PER_SECOND
WAY_OUT = "--from-first-stamp begins the run at the first velocity of the bag"


@dataclass(frozen=True)
class BagVelocities:
    """The times of the velocities in a bag, as ticks. Tick k is k * 0.1 s after the run's begin."""

    bag: Path
    #: robot -> the tick of each of its velocities; those before the run's begin are below 0
    ticks: Mapping[str, Sequence[int]]

    def check(self, end: float) -> None:
        """Raise ValueError if no velocity can fall within a run that ends at tick `end` or before.

        `end` is infinite if the harvest itself ends the run.
        """
        latest = min(end, LONGEST_HARVEST)
        if self._falls_outside(latest):
            is_endless = end == math.inf
            ending = "would end with the harvest" if is_endless else f"would end at {_seconds(end)}"
            raise ValueError(self._refusal(ending))

    def sentence(self, end: int) -> str:
        """Return how many velocities of each robot fell within the run, which ended at `end`."""
        counts = []
        for robot, ticks in self.ticks.items():
            counts.append(f"{robot} {self._within(robot, end)} of {len(ticks)}")
        return f"Velocities of {self.bag} that fell within the run: {', '.join(counts)}."

    def troubles(self, end: int) -> Iterator[str]:
        """Yield what is wrong if no velocity at all fell within the run, which ended at `end`."""
        if self._falls_outside(end):
            yield self._refusal(f"ended at {_seconds(end)}")

    def _falls_outside(self, end: float) -> bool:
        """Whether no velocity of any robot falls within a run that ends at a tick."""
        return not any(self._within(robot, end) for robot in self.ticks)

    def _within(self, robot: str, end: float) -> int:
        """Return how many velocities of a robot fall within a run that ends at a tick."""
        return sum(0 <= tick < end for tick in self.ticks[robot])

    def _refusal(self, ending: str) -> str:
        """Return what is wrong, and what would be right. `ending`: when the run ends, in words."""
        stamps = list(chain.from_iterable(self.ticks.values()))
        where = f"the first is at {_seconds(min(stamps))}, the last at {_seconds(max(stamps))}"
        return (
            f"{self.bag}: none of its {len(stamps)} velocities falls within the run: "
            f"{where}; the run begins at 0 s and {ending}; {WAY_OUT}"
        )


def _seconds(tick: float) -> str:
    return f"{tick * TIME_STEP:.1f} s"
