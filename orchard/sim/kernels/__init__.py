"""The inner loops, compiled by numba: movement, the laser, overlaps. A kernel takes and returns arrays."""
