"""The inner loops, compiled by numba: moving, the laser, overlaps.

A kernel takes arrays and gives arrays. It knows no class of the simulator but named tuples of arrays.
"""
