"""Answers for a fleet: which of many settings is best.

The event model (the fast model) does replications of all settings, harvests with different seeds,
until the answer is certain. The simulator (the full model) checks the best ones.
"""
