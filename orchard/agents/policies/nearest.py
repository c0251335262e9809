"""The manual's dispatch policy."""

from collections.abc import Sequence
from typing import Any

from orchard.agents.dispatch import Assignment, BinReport, CarrierReport, free_carriers, paired
from orchard.field.layout import Layout


class Nearest:
    """The bin that has called for longest gets the carrier that is nearest by road. Ties by name.

    If the scenario names it `nearest`, there is no dispatcher: each full bin asks all carriers, and decides for itself.
    """

    Memory = dict  # empty

    def __init__(self, layout: Layout) -> None:
        pass

    def assign(self, now: int, bins: Sequence[BinReport], carriers: Sequence[CarrierReport], memory: Any) -> list[Assignment]:
        return paired(sorted(bins, key=lambda report: (report.since, report.name)), free_carriers(carriers))
