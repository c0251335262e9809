"""The dispatch policy `predictive-farthest`."""

from collections.abc import Sequence
from typing import Any

from orchard.agents.dispatch import Assignment, BinReport, CarrierReport, free_carriers, paired
from orchard.agents.policies.predictive import Predictive, slack


class PredictiveFarthest(Predictive):
    """A carrier leaves so that it arrives when the picker is done; of the bins for which it is time the farthest first. Ties by name."""

    Memory = dict  # empty

    def assign(self, now: int, bins: Sequence[BinReport], carriers: Sequence[CarrierReport], memory: Any) -> list[Assignment]:
        due = [report for report in bins if slack(report) <= 0.0]
        return paired(sorted(due, key=lambda report: (-report.metres, report.name)), free_carriers(carriers))
