"""A moment of a run, and the letters that are under way in it."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from orchard.contract.messages import Answer, Request, Written
from orchard.sim.world import World


@dataclass(frozen=True)
class RunMoment:
    """A run between two ticks: what a snapshot has, in memory."""

    world: World
    #: Agent -> its memory. Agents that were not asked yet are absent.
    memories: Mapping[str, Any]
    #: Tick -> sender -> its letters, of the last two ticks.
    letters: Mapping[int, Mapping[str, Written]]

    @property
    def tick(self) -> int:
        """The tick at which agents act next."""
        return self.world.tick

    def requests(self, sender: str, age: int = 1) -> list[Request]:
        """Return the requests that an agent sent `age` ticks ago. Those of 1 are not heard yet."""
        written = self.letters.get(self.tick - age, {}).get(sender)
        if written is None:
            return []
        return [request for _, request in written.requests]

    def answers(self, receiver: str) -> Iterator[tuple[str, Answer]]:
        """Yield the answers that an agent hears at the next tick, each with its sender."""
        for sender, written in self.letters.get(self.tick - 1, {}).items():
            for given in written.answers:
                if given.to == receiver:
                    yield sender, given.body
