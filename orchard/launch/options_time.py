"""Times on the command line of a process, in seconds; each raises ValueError for what is none."""

import math

from orchard.contract.messages import LAST_TICK
from orchard.field.scenario import TIME_STEP


def seconds(text: str) -> float:
    """More than none, and not for ever."""
    value = float(text)
    if not 0 < value < math.inf:
        raise ValueError
    return value


def simulated_seconds(text: str) -> float:
    """No more than a run can last."""
    if (value := seconds(text)) > LAST_TICK * TIME_STEP:
        raise ValueError
    return value
