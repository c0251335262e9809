"""`DiscreteHarvest`, the door to the event model: what it does, refuses, and tells of a policy that
breaks.
"""

from typing import Any

import own_policies
import pytest
from quiet import NOBODY, quiet_layouts

from orchard.behaviour.dispatcher import PolicyFault
from orchard.discrete.harvest import DiscreteHarvest, Jam
from orchard.dispatch.policies import POLICIES
from orchard.event_model.harvest import EventHarvest
from orchard.event_model.known import COMPILED
from orchard.field.layout import Layout, lay_out
from orchard.field.scenario import NEAREST, Scenario, with_changes

SMALL = NOBODY | {"rows": 5, "pickers": 3, "carriers": 3, "row_length": 30.0}


def orchard(**values: Any) -> Layout:
    """Return the layout of a small orchard with other values."""
    return lay_out(Scenario(**SMALL | values))


@pytest.mark.parametrize("dispatch", sorted(COMPILED.keys() - {NEAREST}))
def test_a_compiled_policy_decides_as_its_class_does(dispatch: str) -> None:
    """A class that a scenario names by its module is asked in Python."""
    policy = POLICIES[dispatch]
    named = f"{policy.__module__}.{policy.__name__}"
    for layout in quiet_layouts(seed=7, count=5):
        compiled, asked = (
            EventHarvest(lay_out(with_changes(layout.scenario, dispatch=name))).run()
            for name in (dispatch, named)
        )
        assert compiled.deliveries == asked.deliveries
        assert compiled.exchanges == asked.exchanges


# A policy of tests/support/own_policies.py, and words of its fault.
FAULTS = {
    "Raising": "LookupError: no such bin here",
    "Inventing": "assigns bin bin_77, which is not available",
    "Overworking": " twice",
    "Hoarding": "memory takes",
    "Silent": "assign returned None",
    "Tallying": "the policy's memory would be another one in its next decision: memory['asked']: ",
    "Tupling": "the policy's memory would be another one in its next decision: memory['seen']: ",
}


@pytest.mark.parametrize("policy", FAULTS)
def test_a_policy_that_breaks_is_told_with_its_place(policy: str) -> None:
    layout = orchard(dispatch=f"own_policies.{policy}")
    with pytest.raises(PolicyFault) as raised:
        DiscreteHarvest(layout).run()
    words = str(raised.value)
    assert words.startswith(f"dispatch policy own_policies.{policy}, tick ")
    assert FAULTS[policy] in words
    assert own_policies.__file__ in words


def test_a_policy_that_sends_no_carrier_is_a_jam() -> None:
    layout = orchard(dispatch="own_policies.Idle")
    with pytest.raises(Jam, match="only 0 bins were delivered: some robots wait for ever"):
        DiscreteHarvest(layout).run().figures()


def test_a_step_of_a_users_own_class_is_named() -> None:
    layout = orchard(route="examples.seams.signalled_route.SignalledRoute")
    with pytest.raises(NotImplementedError, match="does not know the step Signal"):
        DiscreteHarvest(layout)
