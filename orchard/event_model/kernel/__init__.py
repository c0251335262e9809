"""The machine that carries a harvest on, compiled by numba.

`machine` explains it; read that first.
"""
