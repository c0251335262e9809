"""What is simulated: the scenario and its limits, the layout, sizes, geometry, and numbers with the same bits on every machine.

Nothing here moves, decides or communicates. It imports no other package of the orchard.
"""
