"""The behaviours of robots, people and animals, the steps and routes that they are made of, and the evaluation of scans.

An agent receives observations and mail only. It uses no simulator, no network and no clock, and its memory is data.
"""
