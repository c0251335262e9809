"""Starts runs: the command line, the processes of a run and their supervision, local runs, the emergency stop.

The packages below decide what happens within a run.
"""
