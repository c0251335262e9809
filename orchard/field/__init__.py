"""What is simulated: the scenario and its limits, the layout, sizes, geometry, and numbers with the
same bits on every machine.
"""
