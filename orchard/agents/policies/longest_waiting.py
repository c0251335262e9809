"""The dispatch policy `longest-waiting`."""

from collections.abc import Sequence
from typing import Any

from orchard.agents.dispatch import Assignment, BinReport, CarrierReport, free_carriers, paired
from orchard.field.layout import Layout


class LongestWaiting:
    """The bin that has waited for longest gets a carrier first; of those that have waited equally long the farthest. Ties by name.

    It is fair as `nearest` is, but the dispatcher decides.
    """

    Memory = dict  # empty

    def __init__(self, layout: Layout) -> None:
        pass

    def assign(self, now: int, bins: Sequence[BinReport], carriers: Sequence[CarrierReport], memory: Any) -> list[Assignment]:
        return paired(sorted(bins, key=lambda report: (report.since, -report.metres, report.name)), free_carriers(carriers))
