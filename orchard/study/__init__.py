"""Answers for a fleet: which of many settings is best.

The discrete-event model races them, the simulator confirms.
"""
