"""The ticks of simulated time."""

TICKS_PER_SECOND = 10
TIME_STEP = 1 / TICKS_PER_SECOND  # s
