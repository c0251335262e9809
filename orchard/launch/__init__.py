"""Starting runs: the command line, the processes of a run and their supervision, local runs, the emergency stop.

What happens within a run is decided in the packages below.
"""
