"""The dispatch policies that rank the bins.

A bin is "due" if a carrier may leave for it now. The first of those that are due gets the next free
carrier. docs/bounds.md compares the policies.
"""

from collections.abc import Sequence
from typing import Any

import msgspec

from orchard.dispatch.policy import Assignment, BinReport, CarrierReport
from orchard.field.layout import Layout
from orchard.field.scenario import TIME_STEP

MARGIN = 5.0  # s by which an order of a predictive policy is given too early rather than too late


class Ranking:
    """Ranks the bins that are due.

    The first one gets the free carrier that is nearest to the queue's head, and so on.
    """

    # It remembers nothing.
    Memory: type = dict

    def __init__(self, layout: Layout) -> None:
        pass

    def is_due(self, report: BinReport) -> bool:
        """Whether a carrier may leave for a bin now."""
        return True

    def rank(self, report: BinReport, memory: Any) -> tuple[Any, ...]:
        """Return the key by which bins are sorted."""
        raise NotImplementedError

    def assign(
        self, now: int, bins: Sequence[BinReport], carriers: Sequence[CarrierReport], memory: Any
    ) -> list[Assignment]:
        """Return the decisions as `Dispatch.assign` does."""
        # There may be more bins than carriers, or more carriers than bins.
        pairs = zip(self.due(bins, memory), free_carriers(carriers), strict=False)
        return [Assignment(report.name, carrier.name) for report, carrier in pairs]

    def due(self, bins: Sequence[BinReport], memory: Any) -> list[BinReport]:
        """Return the bins that are due, by their rank."""
        return sorted(filter(self.is_due, bins), key=lambda report: self.rank(report, memory))


def free_carriers(carriers: Sequence[CarrierReport]) -> list[CarrierReport]:
    """Return the carriers that can leave now, by their way to the queue's head, to a millimetre.

    The nearest comes first. Ties by name.
    """
    free = [carrier for carrier in carriers if carrier.is_next]
    return sorted(free, key=lambda carrier: (round(carrier.metres, 3), carrier.name))


class Nearest(Ranking):
    """The manual's policy: the bin that has called for longest gets the nearest carrier.

    Ties by name. It needs no dispatcher.
    """

    def rank(self, report: BinReport, memory: Any) -> tuple[Any, ...]:
        return report.since, report.name


class LongestWaiting(Ranking):
    """The bin that has waited for longest gets a carrier first; of several the farthest.

    Ties by name.
    """

    def rank(self, report: BinReport, memory: Any) -> tuple[Any, ...]:
        return report.since, -report.metres, report.name


class FarthestFirst(Ranking):
    """Of the full bins the one that is farthest by road gets a carrier first. Ties by name."""

    def rank(self, report: BinReport, memory: Any) -> tuple[Any, ...]:
        return -report.metres, report.name


class PredictiveMemory(msgspec.Struct):
    """When bins are full."""

    # Bin -> the tick at which it will be full, or was.
    full: dict[str, int] = {}

    def note(self, now: int, report: BinReport) -> None:
        """Take the estimate of a bin that still fills.

        A full bin keeps its last estimate. Without one of this call it has just become full.
        """
        if report.seconds_to_full > 0.0 or self.full.get(report.name, -1) < report.since:
            self.full[report.name] = now + round(report.seconds_to_full / TIME_STEP)


class Predictive(Ranking):
    """A carrier leaves so that it arrives when the picker is done.

    The bin for which a carrier should have left first comes first. Ties by name.
    """

    Memory: type = PredictiveMemory
    early = True

    def is_due(self, report: BinReport) -> bool:
        return report.seconds_to_full - report.seconds_to_reach <= MARGIN

    def rank(self, report: BinReport, memory: PredictiveMemory) -> tuple[Any, ...]:
        return memory.full[report.name] * TIME_STEP - report.seconds_to_reach, report.name

    def assign(
        self, now: int, bins: Sequence[BinReport], carriers: Sequence[CarrierReport], memory: Any
    ) -> list[Assignment]:
        for report in bins:
            memory.note(now, report)
        return super().assign(now, bins, carriers, memory)


class PredictiveFarthest(FarthestFirst, Predictive):
    """A carrier leaves so that it arrives when the picker is done.

    Of the bins that are due the farthest comes first. Ties by name.
    """


class GlobalAssignment(Ranking):
    """All full bins and free carriers are matched at once, so that the ways together are shortest.

    All ways lead by the queue's head, so the nearest bins get carriers.
    """

    prefers_near = True

    def rank(self, report: BinReport, memory: Any) -> tuple[Any, ...]:
        return report.metres, report.since, report.name
