"""The dispatch policy `predictive-farthest`."""

from orchard.agents.dispatch import BinReport
from orchard.agents.policies.farthest_first import FarthestFirst
from orchard.agents.policies.predictive import slack


class PredictiveFarthest(FarthestFirst):
    """A carrier leaves so that it arrives when the picker is done; of the bins for which it is time the farthest first. Ties by name."""

    early = True

    def is_due(self, report: BinReport) -> bool:
        return slack(report) <= 0.0
