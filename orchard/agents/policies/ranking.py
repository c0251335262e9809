"""What most dispatch policies have in common: they rank the bins."""

from collections.abc import Sequence
from typing import Any

from orchard.agents.dispatch import Assignment, BinReport, CarrierReport
from orchard.field.layout import Layout


class Ranking:
    """The first of the bins that are due gets the free carrier that is nearest to the queue's head, the second one the next, and so on."""

    Memory: type = dict  # empty

    def __init__(self, layout: Layout) -> None:
        pass

    def is_due(self, report: BinReport) -> bool:
        """Whether a carrier may leave for a bin now."""
        return True

    def rank(self, report: BinReport, memory: Any) -> tuple[Any, ...]:
        """Return the key by which bins are sorted."""
        raise NotImplementedError

    def assign(self, now: int, bins: Sequence[BinReport], carriers: Sequence[CarrierReport], memory: Any) -> list[Assignment]:
        ranked = sorted(filter(self.is_due, bins), key=lambda report: self.rank(report, memory))
        return [Assignment(report.name, carrier.name) for report, carrier in zip(ranked, free_carriers(carriers), strict=False)]


def free_carriers(carriers: Sequence[CarrierReport]) -> list[CarrierReport]:
    """Return the carriers that can leave now, the nearest to the queue's head first. Ties by name."""
    return sorted((carrier for carrier in carriers if carrier.is_next), key=lambda carrier: (carrier.metres, carrier.name))
