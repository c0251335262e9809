"""What an agent and a simulator say to each other: observations, mail, actions, events, and the guard that checks actions.

Nothing here decides or moves, and nothing here knows a network.
"""
