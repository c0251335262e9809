"""The episodes of an environment, from one reset to the next: their seeds, and checks of what an
environment is made with.
"""

from typing import Any, NamedTuple

import numpy as np

from orchard.field.repeatable import draw
from orchard.field.scenario import Scenario


def refuse_what_is_no_episode(scenario: object, longest: int) -> None:
    """Raise TypeError for what is no scenario, and ValueError for an episode without a tick.

    `longest`: ticks of an episode, at most.
    """
    if not isinstance(scenario, Scenario):
        raise TypeError(
            f"scenario = {scenario!r}: must be a Scenario, such as Scenario(rows=3) or"
            " load('my.yaml')"
        )
    if longest < 1:
        raise ValueError(f"longest = {longest}: must be at least 1 tick")


def plain(seed: Any) -> Any:
    """Return a whole number of numpy as one of Python, which Gymnasium wants; anything else as it
    is.
    """
    if isinstance(seed, np.integer):
        return int(seed)
    return seed


class Episode(NamedTuple):
    """One episode of an environment."""

    #: Seed of the last reset to which one was given; at first the scenario's.
    reset_seed: int
    #: Episodes since that reset: 0 at it; -1 before the first episode of all.
    number: int

    @property
    def seed(self) -> int:
        """The seed of its scenario: that of the reset, then others that are drawn from it."""
        if self.number == 0:
            return self.reset_seed
        share = draw(self.reset_seed, "episode", self.number)[0]
        # A float of 0 to 1 has 53 bits, so that many different seeds can be drawn.
        return int(share * 2**53)

    def after(self, seed: int | None) -> "Episode":
        """Return the next episode, after a reset with a seed or without one."""
        if seed is None:
            return Episode(self.reset_seed, self.number + 1)
        return Episode(seed, 0)
