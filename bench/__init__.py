"""Benchmarks of the simulator and of comparable simulators.

`python -m bench` runs them and writes bench/results.md.
"""
