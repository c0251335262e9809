"""The manual's dispatch policy."""

from typing import Any

from orchard.agents.dispatch import BinReport
from orchard.agents.policies.ranking import Ranking


class Nearest(Ranking):
    """The bin that has called for longest gets the carrier that is nearest by road. Ties by name.

    If the scenario names it `nearest`, there is no dispatcher: each full bin asks all carriers, and decides for itself.
    """

    def rank(self, report: BinReport, memory: Any) -> tuple[Any, ...]:
        return report.since, report.name
