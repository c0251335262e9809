"""The dispatch policy `farthest-first`."""

from collections.abc import Sequence
from typing import Any

from orchard.agents.dispatch import Assignment, BinReport, CarrierReport, free_carriers, paired
from orchard.field.layout import Layout


class FarthestFirst:
    """Of the full bins the one that is farthest by road gets a carrier first. Ties by name.

    A carrier that stops at a lane holds up those behind it that go on: so those that go farthest leave first.
    """

    Memory = dict  # empty

    def __init__(self, layout: Layout) -> None:
        pass

    def assign(self, now: int, bins: Sequence[BinReport], carriers: Sequence[CarrierReport], memory: Any) -> list[Assignment]:
        return paired(sorted(bins, key=lambda report: (-report.metres, report.name)), free_carriers(carriers))
