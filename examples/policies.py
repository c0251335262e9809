"""The dispatch policies that leave the built-in ones in version 2.0, as classes of your own.

dispatch: examples.policies.LongestWaiting

No table of docs/bounds.md recommends one of them. Copy the class that you need.
"""

from collections.abc import Sequence

from orchard import Assignment, BinReport, CarrierReport, Layout


class FirstInOrder:
    """Sends the nearest free carrier for the first bin in an order, and so on."""

    Memory = dict

    def __init__(self, layout: Layout) -> None:
        """A policy of your own may read the layout. These need nothing of it."""

    def key(self, report: BinReport) -> tuple[float | str, ...]:
        """Return by what the bins are sorted."""
        raise NotImplementedError

    def assign(
        self, now: int, bins: Sequence[BinReport], carriers: Sequence[CarrierReport], memory: dict
    ) -> list[Assignment]:
        """Return which carrier fetches which bin."""
        free = [carrier for carrier in carriers if carrier.is_next]
        # To a millimetre: two carriers may stand at the heads of two lines.
        free.sort(key=lambda carrier: (round(carrier.metres, 3), carrier.name))
        pairs = zip(sorted(bins, key=self.key), free, strict=False)
        return [Assignment(report.name, carrier.name) for report, carrier in pairs]


class FarthestFirst(FirstInOrder):
    """`farthest-first`: a carrier that stops at a near lane holds up those behind it."""

    def key(self, report: BinReport) -> tuple[float | str, ...]:
        """Return the way to the bin; the longest comes first."""
        return -report.metres, report.name


class LongestWaiting(FirstInOrder):
    """`longest-waiting`: as fair as `nearest`; of bins that called together, the farthest first."""

    def key(self, report: BinReport) -> tuple[float | str, ...]:
        """Return when the bin called, and then the way to it."""
        return report.since, -report.metres, report.name


class NearestBins(FirstInOrder):
    """`assignment`: all ways together are shortest, which does not help."""

    def key(self, report: BinReport) -> tuple[float | str, ...]:
        """Return the way to the bin, and then when it called."""
        return report.metres, report.since, report.name
