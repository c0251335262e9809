"""What the event model knows.

This module does not import numba, which takes long to load.
"""

from orchard.event_model import codes as c
from orchard.field.scenario import Scenario

# The policies that are compiled -> their codes. Other policies are asked in Python. With `nearest`
# there is no agent `dispatch`, and bins call all carriers.
COMPILED = {
    "nearest": c.BY_CALLS,
    "longest-waiting": c.LONGEST_WAITING,
    "farthest-first": c.FARTHEST_FIRST,
    "predictive": c.PREDICTIVE,
    "predictive-farthest": c.PREDICTIVE_FARTHEST,
    "assignment": c.GLOBAL_ASSIGNMENT,
}


def refuse_unknown(scenario: Scenario) -> None:
    """Raise ValueError for a scenario with agents of the user's own, or sensors that are not exact:
    the event model knows neither.
    """
    if not scenario.sensors.are_exact:
        raise ValueError("the discrete-event model knows no errors of sensors; run the simulator")
    if own := {**scenario.agents, **scenario.agents_without_body}:
        raise ValueError(
            "the discrete-event model knows built-in agents only, and not"
            f" {', '.join(sorted(own))}; run the simulator"
        )
