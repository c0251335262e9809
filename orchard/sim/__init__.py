"""The simulator: world, physics, laser, the step that every mode shares, snapshots, invariants.

Nothing here knows an agent's class, a network or a viewer. The wall clock plays no part.
"""
