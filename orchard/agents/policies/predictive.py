"""The dispatch policy `predictive`."""

from collections.abc import Sequence
from typing import Any

from orchard.agents.dispatch import Assignment, BinReport, CarrierReport, free_carriers, paired
from orchard.field.layout import Layout

MARGIN = 5.0  # s by which an order is given too early rather than too late


def slack(report: BinReport) -> float:
    """Return the time for which a carrier may still wait in the queue, and yet come when the bin is full, s; negative if it is late."""
    return report.seconds_to_full - report.seconds_to_reach - MARGIN


class Predictive:
    """A carrier leaves so that it arrives when the picker is done. The bin for which it is latest gets a carrier first. Ties by name."""

    Memory = dict  # empty
    early = True

    def __init__(self, layout: Layout) -> None:
        pass

    def assign(self, now: int, bins: Sequence[BinReport], carriers: Sequence[CarrierReport], memory: Any) -> list[Assignment]:
        due = [report for report in bins if slack(report) <= 0.0]
        return paired(sorted(due, key=lambda report: (slack(report), report.name)), free_carriers(carriers))
