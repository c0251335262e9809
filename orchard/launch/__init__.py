"""Starts runs: options, processes and their supervision, local runs, and what is said at
the end.
"""
