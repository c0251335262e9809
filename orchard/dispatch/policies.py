"""The built-in dispatch policies by name, and the one that a scenario names.

docs/bounds.md compares them.
"""

from collections.abc import Iterable
from types import MappingProxyType

from orchard.dispatch.policy import Dispatch
from orchard.dispatch.ranking import (
    FarthestFirst,
    GlobalAssignment,
    LongestWaiting,
    Nearest,
    Predictive,
    PredictiveFarthest,
)
from orchard.dispatch.rolling import Rolling
from orchard.field.layout import Layout
from orchard.field.plugins import make_plugin
from orchard.field.scenario import DISPATCH_POLICIES

_CLASSES: list[type[Dispatch]] = [
    Nearest,
    FarthestFirst,
    LongestWaiting,
    Predictive,
    PredictiveFarthest,
    Rolling,
    GlobalAssignment,
]
# Name in a scenario -> class.
POLICIES = MappingProxyType(dict(zip(DISPATCH_POLICIES, _CLASSES, strict=True)))
# No table of docs/bounds.md recommends them. They work until 2.0.
LEAVING = ("farthest-first", "longest-waiting", "assignment")


def notes_on(names: Iterable[object]) -> list[str]:
    """Return what a user of these policies should know: which of them version 2.0 will not have."""
    notes = []
    for name in names:
        if name in LEAVING:
            notes.append(
                f"dispatch = {name}: this policy will not be in version 2.0; "
                "expected rolling, predictive or nearest, or a class as in examples/policies.py"
            )
    return notes


def dispatch_of(layout: Layout) -> Dispatch:
    """Return the policy that the scenario names. Raises ScenarioError if it cannot be used."""
    return make_plugin(
        "dispatch", layout.scenario.dispatch, POLICIES, layout, methods=("assign", "Memory")
    )
