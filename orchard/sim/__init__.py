"""The simulator: the world, physics, the laser, the step that every mode shares, snapshots, and what is checked at every tick.

Nothing here knows an agent's class, a network or a viewer. The wall clock plays no part.
"""
