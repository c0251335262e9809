"""Answers for a fleet: which of many settings is best, with what confidence. The discrete-event model races them, the simulator confirms.

Nothing here changes a run. The command `orchard study` and the page ask; `result.py` is what they get.
"""
