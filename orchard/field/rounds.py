"""Rounds: how long a picker must be watched until its rate is that of all its rows.

Rows are picked at different speeds, and a bin fills inside a row or goes on with the next one. So
a picker is fast for some bins, and slow for others. Only over whole rounds of its rows has its rate
a meaning. The long run of the fast model is taken over whole rounds.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, floor

from orchard.field.layout import Layout
from orchard.field.rows import Block

# A rate is of so many bins at least, so that one exchange more or less does not count.
LEAST_BINS = 20
# A rate is the mean of so many windows, one exchange apart: bins fill at one end of a row, then at
# the other, and a carrier needs longer for one of them. So windows begin at either end.
WINDOWS = 8
ROUNDING = 1e-9


@dataclass(frozen=True)
class Round:
    """What a picker picks until the same rows are before it again."""

    #: The number of rows. Each row comes as often as the others; where all are alike, any row does.
    rows: int
    #: The number of bins that these rows fill. A part of a bin counts as a part.
    bins: float

    @property
    def least(self) -> int:
        """The rounds that a rate needs at least."""
        return ceil(LEAST_BINS / self.bins - ROUNDING)

    @property
    def least_exchanges(self) -> int:
        """The exchanges that a rate needs at least."""
        return ceil(self.least * self.bins - ROUNDING) + WINDOWS

    @property
    def least_rows(self) -> int:
        """The rows that a picker must pick for so many exchanges."""
        return ceil((self.least_exchanges + 1) * self.rows / self.bins)

    def suffice(self, exchanges: int) -> bool:
        """Whether so many exchanges have the whole rounds of a rate."""
        return self._rounds(exchanges - WINDOWS) >= self.least

    def _rounds(self, exchanges: int) -> int:
        """Return how many whole rounds so many exchanges have."""
        rounds = max(0, floor(exchanges / self.bins + ROUNDING))
        # The list has only whole exchanges: a part of a bin needs the whole one.
        while rounds and ceil(rounds * self.bins - ROUNDING) > exchanges:
            rounds -= 1
        return rounds

    def rate(self, exchanges: Sequence[float]) -> float | None:
        """Return the rate over as many whole rounds as end with the last exchanges, bins a unit of
        time.

        `exchanges`: the times at which the picker got an empty bin for a full one, in their order.
        None if there were too few rounds between the first and the last one.
        """
        if not self.suffice(len(exchanges)):
            return None
        most = len(exchanges) - WINDOWS
        bins = self._rounds(most) * self.bins
        first = most - ceil(bins - ROUNDING)
        elapsed = [_elapsed(exchanges[first + later :], bins) for later in range(WINDOWS)]
        return bins * WINDOWS / sum(elapsed)


def _elapsed(exchanges: Sequence[float], bins: float) -> float:
    """Return the time in which a number of bins was filled, from the first exchange on.

    A bin of which only a part counts takes that part of its time.
    """
    whole = floor(bins + ROUNDING)
    elapsed = exchanges[whole] - exchanges[0]
    part = bins - whole
    if part > ROUNDING:
        elapsed += part * (exchanges[whole + 1] - exchanges[whole])
    return elapsed


def round_of(layout: Layout, block: Block) -> Round:
    """Return the round of a picker with this block."""
    if layout.rows_differ:
        rows = sorted(set(block.rows))
    else:
        rows = [block.rows[0]]
    bin_metres = layout.scenario.bin_metres
    bins = float(len(rows))
    if bin_metres:
        bins = sum(layout.lane(row).length for row in rows) / bin_metres
    # After an even number of passes a picker is at the same end of its rows again.
    times = 2 if len(rows) % 2 else 1
    return Round(len(rows) * times, bins * times)
