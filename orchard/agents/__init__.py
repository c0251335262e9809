"""The behaviours of robots, people and animals, the steps and routes they are made of, and what agents make of a scan.

An agent sees observations and mail only. It knows no simulator, no network, no clock, and its memory is data.
"""
