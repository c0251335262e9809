"""The ticks of simulated time, and the fewest that the handling of a bin takes."""

from math import ceil

TICKS_PER_SECOND = 10
TIME_STEP = 1 / TICKS_PER_SECOND  # s
# A time that is longer than whole ticks by at most so many ticks is rounded down.
ROUNDING = 1e-6

# Ticks to couple a bin, at least: the robot must have stood for one tick before the deed.
QUICKEST_COUPLING = 2
# A coupled bin still moves for so many ticks after its robot stands, until it is at its place.
BIN_FOLLOWS = 2
# Ticks to uncouple a bin, at least: the bin must have stood for one tick too.
QUICKEST_UNCOUPLING = BIN_FOLLOWS + QUICKEST_COUPLING


def whole_ticks(seconds: float) -> int:
    """Return the number of whole ticks that last at least so many seconds."""
    return ceil(seconds / TIME_STEP - ROUNDING)
