"""The scenario: what a user can set.

    schema     what can be set, with its limits, and the rules about several values
    sections   the parts of it: people, crop, picking, carrying, sensors, prices
    shift      the working day
    fields     the kinds of fields, and who decides them
    names      the names of what is built in
    checking   values -> a scenario, or all problems of them; a scenario with some values changed
    effect     values without an effect, because another one is missing
    files      YAML -> a scenario, and a scenario -> YAML

All others import from here.
"""

from orchard.field.scenario.checking import check, with_changes
from orchard.field.scenario.effect import with_effect
from orchard.field.scenario.files import load, parse, to_short_yaml, to_yaml
from orchard.field.scenario.names import (
    BALANCED,
    BALANCED_ENDS,
    BALANCED_TIMES,
    DISPATCH_POLICIES,
    END,
    MANUAL,
    NEAREST,
    ONWARD,
    OUTWARD,
    ROLLING,
    ROW_ORDERS,
    ROW_RULES,
)
from orchard.field.scenario.prices import Prices
from orchard.field.scenario.schema import Scenario, other_ways
from orchard.field.scenario.sections import (
    LEAST_CV,
    MOST_BIAS,
    MOST_WHITE,
    WIDEST,
    Animals,
    Battery,
    Failure,
    LaserSettings,
    People,
    Spread,
)
from orchard.field.scenario.shift import WorkShift
from orchard.field.ticks import TICKS_PER_SECOND, TIME_STEP

__all__ = [
    "BALANCED",
    "BALANCED_ENDS",
    "BALANCED_TIMES",
    "DISPATCH_POLICIES",
    "END",
    "LEAST_CV",
    "MANUAL",
    "MOST_BIAS",
    "MOST_WHITE",
    "NEAREST",
    "ONWARD",
    "OUTWARD",
    "ROLLING",
    "ROW_ORDERS",
    "ROW_RULES",
    "TICKS_PER_SECOND",
    "TIME_STEP",
    "WIDEST",
    "Animals",
    "Battery",
    "Failure",
    "LaserSettings",
    "People",
    "Prices",
    "Scenario",
    "Spread",
    "WorkShift",
    "check",
    "load",
    "other_ways",
    "parse",
    "to_short_yaml",
    "to_yaml",
    "with_changes",
    "with_effect",
]
