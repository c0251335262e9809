"""Rounds: how long a picker must be watched until its rate is that of all its rows.

In the long run of the event model pickers pick their rows again and again. Rows are picked at
different speeds, and a bin fills inside a row or goes on with the next one. So a picker fills some
bins fast, and others slowly, and its rate has a meaning only over whole rounds: until the same rows
are before it again. An exchange is the moment at which a picker gets an empty bin for a full one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, floor

from orchard.field.layout import Layout
from orchard.field.rows import Block

# A rate is taken over so many bins at least, so that one exchange more or less changes it little.
LEAST_BINS = 20
# A rate is the mean over so many windows. Each window begins one exchange later than the one
# before. Bins fill at one end of a row, then at the other, and a carrier needs longer to one of
# them. So windows begin at either end.
WINDOWS = 8
# Bins by which a sum of parts of bins may differ from a whole number.
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
        """The number of rounds over which a rate is taken, at least."""
        return ceil(LEAST_BINS / self.bins - ROUNDING)

    @property
    def least_exchanges(self) -> int:
        """The number of exchanges that a rate needs, at least: those of its rounds and windows."""
        return ceil(self.least * self.bins - ROUNDING) + WINDOWS

    @property
    def least_rows(self) -> int:
        """The number of rows in which a picker has `least_exchanges`.

        One exchange is added because the first bin is begun with no exchange.
        """
        return ceil((self.least_exchanges + 1) * self.rows / self.bins)

    def suffice(self, exchanges: int) -> bool:
        """Whether so many exchanges are enough for a rate."""
        return self._rounds(exchanges - WINDOWS) >= self.least

    def _rounds(self, exchanges: int) -> int:
        """Return how many whole rounds lie within so many exchanges."""
        rounds = max(0, floor(exchanges / self.bins + ROUNDING))
        # There are times of whole bins only, so a round that ends inside a bin needs also the
        # exchange of that bin.
        while rounds and ceil(rounds * self.bins - ROUNDING) > exchanges:
            rounds -= 1
        return rounds

    def rate(self, exchanges: Sequence[float]) -> float | None:
        """Return the rate of a picker over as many whole rounds as it had, bins a unit of time.

        `exchanges`: the times of its exchanges, in their order, in that unit. The last exchanges
        count, because the first ones are those of the harvest's beginning. None if there were too
        few exchanges.
        """
        if not self.suffice(len(exchanges)):
            return None
        most = len(exchanges) - WINDOWS
        bins = self._rounds(most) * self.bins
        # The exchange at which the first window begins. The last window ends with the last one.
        first = most - ceil(bins - ROUNDING)
        elapsed = [_elapsed(exchanges[first + later :], bins) for later in range(WINDOWS)]
        return bins * WINDOWS / sum(elapsed)


def _elapsed(exchanges: Sequence[float], bins: float) -> float:
    """Return the time in which a number of bins was filled, from the first exchange on.

    Of the last bin only a part may count; it takes that part of the bin's time.
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
    # A picker leaves its rows at either end in turn. After an odd number of rows it is at the other
    # end than at first, so such a round goes through them twice.
    times = 1
    if len(rows) % 2 == 1:
        times = 2
    return Round(len(rows) * times, bins * times)
