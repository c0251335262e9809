"""The inner loops, compiled by numba: movement, the laser, overlaps.

A kernel takes and returns arrays. It uses no class of the simulator except named tuples of arrays.
"""
