"""Starts runs: the command line, processes and their supervision, local runs, the emergency stop."""
