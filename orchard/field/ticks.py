"""The ticks of simulated time."""

TICKS_PER_SECOND = 10
TIME_STEP = 1 / TICKS_PER_SECOND  # s

# Ticks to couple a bin at least: the robot must have stood for one tick.
QUICKEST_COUPLING = 2
# Ticks after its robot at which a bin stands.
BIN_FOLLOWS = 2
# Ticks to uncouple a bin at least.
QUICKEST_UNCOUPLING = BIN_FOLLOWS + QUICKEST_COUPLING
