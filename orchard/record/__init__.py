"""The parts of the logger process, which only receives: a run is the same with and without it."""
