"""The inner loops, compiled by numba: movement, the laser, overlaps.

A kernel takes arrays, and most only write into them.
"""
