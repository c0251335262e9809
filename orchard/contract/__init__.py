"""The interface between agents and simulators: observations, mail, actions, events, and the guard
that checks actions.
"""
