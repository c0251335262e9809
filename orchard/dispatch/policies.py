"""The built-in dispatch policies by name, and the one that a scenario names.

docs/bounds.md compares them.
"""

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
POLICIES = MappingProxyType(dict(zip(DISPATCH_POLICIES, _CLASSES, strict=True)))


def dispatch_of(layout: Layout) -> Dispatch:
    """Return the policy that the scenario names. Raises ScenarioError if it cannot be used."""
    return make_plugin(
        "dispatch", layout.scenario.dispatch, POLICIES, layout, methods=("assign", "Memory")
    )
