"""What the event model knows.

This module does not import numba, which takes long to load.
"""

from orchard.event_model import columns as c
from orchard.field.scenario import Scenario

# The policies that are compiled. Others are asked in Python. Without the agent `dispatch` bins call
# all carriers.
COMPILED = {
    "nearest": c.BY_CALLS,
    "longest-waiting": c.LONGEST_WAITING,
    "farthest-first": c.FARTHEST_FIRST,
    "predictive": c.PREDICTIVE,
    "predictive-farthest": c.PREDICTIVE_FARTHEST,
    "assignment": c.GLOBAL_ASSIGNMENT,
}


def lacking(scenario: Scenario) -> str:
    """Return what of a scenario the event model as data does not know yet; '' if it knows all."""
    if not scenario.sensors.are_exact:
        return "errors of sensors"
    if scenario.agents or scenario.agents_without_body:
        return "agents of your own"
    return ""
