"""The dispatch policy `longest-waiting`."""

from typing import Any

from orchard.agents.dispatch import BinReport
from orchard.agents.policies.ranking import Ranking


class LongestWaiting(Ranking):
    """The bin that has waited for longest gets a carrier first; of those that have waited equally long the farthest. Ties by name.

    It is fair as `nearest` is, but the dispatcher decides.
    """

    def rank(self, report: BinReport, memory: Any) -> tuple[Any, ...]:
        return report.since, -report.metres, report.name
