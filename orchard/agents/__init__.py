"""The behaviours of robots, people and animals, and of what they are made.

That is steps and routes, dispatch policies, and what an agent infers from its scan.
"""
