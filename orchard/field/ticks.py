"""The ticks of simulated time."""

from math import ceil

TICKS_PER_SECOND = 10
TIME_STEP = 1 / TICKS_PER_SECOND  # s
# Ticks of rounding.
ROUNDING = 1e-6

# Ticks to couple a bin at least: the robot must have stood for one tick.
QUICKEST_COUPLING = 2
# Ticks after its robot at which a bin stands.
BIN_FOLLOWS = 2
# Ticks to uncouple a bin at least.
QUICKEST_UNCOUPLING = BIN_FOLLOWS + QUICKEST_COUPLING


def whole_ticks(seconds: float) -> int:
    """Return the ticks in which so many seconds are over."""
    return ceil(seconds / TIME_STEP - ROUNDING)
