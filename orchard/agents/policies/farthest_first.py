"""The dispatch policy `farthest-first`."""

from typing import Any

from orchard.agents.dispatch import BinReport
from orchard.agents.policies.ranking import Ranking


class FarthestFirst(Ranking):
    """Of the full bins the one that is farthest by road gets a carrier first. Ties by name.

    A carrier that stops at a lane holds up those behind it that go on: so those that go farthest leave first.
    """

    def rank(self, report: BinReport, memory: Any) -> tuple[Any, ...]:
        return -report.metres, report.name
