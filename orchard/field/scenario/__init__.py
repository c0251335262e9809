"""The scenario: what a user can set.

    schema     the values with their limits, and what follows from them
    rules      the scenario: the values, and the rules about several of them
    sections   its sections: people, animals, crop, picking, carrying, handling, load-out
    sensors    the sections of lasers and of what robots measure of themselves
    shift      the section of the working day
    prices     the section of prices
    fields     the kinds of fields, and the marks that say what decides a value
    names      the names of what is built in
    ways       keys that say the same thing in different ways
    checking   values -> a scenario, or all problems of them; a scenario with some values changed
    effect     refuses values that have no effect, because another value is missing
    files      YAML -> a scenario, and a scenario -> YAML

Other packages import from here.
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
from orchard.field.scenario.rules import Scenario
from orchard.field.scenario.sections import (
    LEAST_CV,
    WIDEST,
    Animals,
    Battery,
    Failure,
    People,
    Spread,
)
from orchard.field.scenario.sensors import MOST_BIAS, MOST_WHITE, LaserSettings
from orchard.field.scenario.shift import WorkShift
from orchard.field.scenario.ways import other_ways
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
