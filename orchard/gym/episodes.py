"""The episodes of an environment: which there can be, and their seeds."""

from typing import Any, NamedTuple

import numpy as np

from orchard.field.repeatable import draw
from orchard.field.scenario import Scenario


def refuse_what_is_no_episode(scenario: object, longest: int) -> None:
    """Raise TypeError for what is no scenario, and ValueError for an episode without a tick."""
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
    return int(seed) if isinstance(seed, np.integer) else seed


class Episode(NamedTuple):
    """One episode, by the seed that was given last, and how many have begun since then."""

    given: int
    number: int

    @property
    def seed(self) -> int:
        """The seed of its scenario: the one that was given, then others that are drawn from it."""
        return (
            self.given
            if self.number == 0
            else int(draw(self.given, "episode", self.number)[0] * 2**53)
        )

    def after(self, seed: int | None) -> "Episode":
        """Return the next episode, after a reset with a seed or without one."""
        return Episode(self.given, self.number + 1) if seed is None else Episode(seed, 0)
