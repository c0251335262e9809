"""What is simulated: the scenario and its limits, the layout, sizes and geometry. Also functions
whose results have the same bits on every machine.

It imports no other package of `orchard` but `orchard/folders.py`; nearly all others import from it.
"""
