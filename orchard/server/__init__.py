"""The inside of the physics process, which owns the world and the clock.

It decides nothing about how an agent behaves.
"""
