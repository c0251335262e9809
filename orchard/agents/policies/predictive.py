"""The dispatch policy `predictive`."""

from collections.abc import Sequence
from typing import Any

import msgspec

from orchard.agents.dispatch import Assignment, BinReport, CarrierReport
from orchard.agents.policies.ranking import Ranking
from orchard.field.scenario import TIME_STEP

MARGIN = 5.0  # s by which an order is given too early rather than too late


class PredictiveMemory(msgspec.Struct):
    """When bins are full."""

    full: dict[str, int] = {}  # bin -> the tick at which it will be full, or was

    def note(self, now: int, report: BinReport) -> None:
        """Take the estimate of a bin that still fills. A full bin keeps its last one; without one in this call it has just become full."""
        if report.seconds_to_full > 0.0 or self.full.get(report.name, -1) < report.since:
            self.full[report.name] = now + round(report.seconds_to_full / TIME_STEP)


def slack(report: BinReport) -> float:
    """Return the time for which a carrier may still wait in the queue, and yet come when the bin is full, s; negative if it is late."""
    return report.seconds_to_full - report.seconds_to_reach - MARGIN


class Predictive(Ranking):
    """A carrier leaves so that it arrives when the picker is done. The bin for which it is latest gets a carrier first. Ties by name."""

    Memory = PredictiveMemory
    early = True

    def is_due(self, report: BinReport) -> bool:
        return slack(report) <= 0.0

    def rank(self, report: BinReport, memory: PredictiveMemory) -> tuple[Any, ...]:
        return memory.full[report.name] * TIME_STEP - report.seconds_to_reach, report.name

    def assign(self, now: int, bins: Sequence[BinReport], carriers: Sequence[CarrierReport], memory: Any) -> list[Assignment]:
        for report in bins:
            memory.note(now, report)
        return super().assign(now, bins, carriers, memory)
