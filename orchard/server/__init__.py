"""The inside of the physics process: it owns the world and the clock, publishes each tick, collects the answers, steps, and reports.

It decides nothing about how an agent behaves.
"""
