"""The built-in dispatch policies by name, and the one that a scenario names.

docs/bounds.md compares them.
"""

from collections.abc import Iterable
from inspect import isasyncgenfunction, iscoroutinefunction, isgeneratorfunction
from types import MappingProxyType

from orchard.dispatch.kept_memory import as_kept
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
from orchard.field.plugins import MISTAKES, contained, make_plugin, place_of_class, unusable
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
    path = layout.scenario.dispatch
    policy = make_plugin("dispatch", path, POLICIES, layout, methods=("assign", "Memory"))
    if path not in POLICIES:
        try:
            _check_own(policy)
        except MISTAKES as error:
            place = place_of_class(type(policy))
            raise unusable("dispatch", path, error, place=place) from error
    return policy


def _check_own(policy: Dispatch) -> None:
    """Find what is wrong with a policy of a user before it is asked.

    Raises TypeError or ValueError, or what its `Memory` raises.
    """
    assign = policy.assign
    if not callable(assign):
        raise TypeError(f"its `assign` must be a method, and is {assign!r}")
    for is_other in (iscoroutinefunction, isgeneratorfunction, isasyncgenfunction):
        if is_other(assign):
            raise TypeError(
                "its `assign` must return a list of Assignment(bin, carrier): use neither"
                " `async def` nor `yield`"
            )
    early = getattr(policy, "early", False)
    if not isinstance(early, bool):
        raise TypeError(f"its `early` must be True or False, and is {early!r}")
    if not callable(policy.Memory):
        raise TypeError(f"its `Memory` must be a class, such as dict, and is {policy.Memory!r}")
    as_kept(contained(policy.Memory), policy)
