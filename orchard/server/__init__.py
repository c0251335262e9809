"""The physics process from the inside: it owns the world and the clock, shows each tick, takes the answers, steps, and reports.

No behaviour of an agent is decided here.
"""
