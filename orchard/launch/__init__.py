"""Starts runs: the command line, the processes of a run and their supervision, local runs, the emergency stop."""
