"""Starts runs: options, processes and their supervision, local runs, and the words at the end.

harvest.py leads a run from a typed command to its result. It runs in this process (local_run.py),
or in several (distributed.py), which the supervisor starts and the follower follows.
"""
