"""A built-in policy in Python (`rolling`, the default) is asked only when it can send a carrier.

So it decides the same as if it were asked each time: when a bin reports, or a carrier is free.
"""

import pytest
from quiet import NOBODY

from orchard.event_model import codes as c
from orchard.event_model.harvest import EventHarvest
from orchard.event_model.program import Program
from orchard.field.layout import lay_out
from orchard.field.scenario import Scenario

# What differs from a small quiet orchard.
CREWS = [
    {"rows": 4, "pickers": 2, "carriers": 2, "picking_speed": 0.5},
    {"rows": 5, "pickers": 5, "carriers": 2, "picking_speed": 0.3, "bins_per_row": 2.0},
    # Calls of bins that fill for long, and fail meanwhile.
    {
        "rows": 3,
        "pickers": 3,
        "carriers": 1,
        "picking_speed": 0.05,
        "seed": 3,
        "picking": {
            "spread": {"distribution": "gamma", "cv": 0.3},
            "failure": {"mean_between": 120.0, "mean_repair": 60.0},
        },
    },
]


class CountedHarvest(EventHarvest):
    """A harvest that counts how often its policy is asked."""

    questions = 0

    @property
    def decision(self):
        self.questions += 1
        return super().decision


def harvest_of(crew: dict) -> CountedHarvest:
    """Return a harvest of a crew that has not begun."""
    return CountedHarvest(lay_out(Scenario(**NOBODY | {"row_length": 24.0} | crew)))


@pytest.mark.parametrize("crew", CREWS)
def test_a_policy_is_asked_when_it_can_send_a_carrier(crew) -> None:
    """There is one order for each bin. A question may send none, as for a bin that calls again."""
    harvest = harvest_of(crew)
    harvest.run()
    assert harvest.is_over
    assert harvest.questions <= 2 * harvest.bins


@pytest.mark.parametrize("crew", CREWS)
def test_a_policy_that_is_asked_each_time_decides_the_same(crew) -> None:
    harvest = harvest_of(crew)
    harvest.run()
    # So the machine stops at each report, and the policy does not say when it decides.
    each_time = harvest_of(crew)
    each_time.model.desk.policy = c.IN_PYTHON_EARLY
    assert each_time.asked_policy is not None
    each_time.asked_policy.decides_when_due = False
    each_time.run()
    assert each_time.questions > harvest.questions
    assert each_time.deliveries == harvest.deliveries
    assert each_time.seconds == harvest.seconds


def test_questions_in_between_take_over_no_arrays(monkeypatch) -> None:
    """To take over the arrays of the program takes longer than all else between two questions.

    It is needed only when the program has grown, as by the first job to a lane.
    """
    # How many ops the program had each time.
    taken = []

    def counted(program: Program) -> dict:
        taken.append(len(program.ops))
        return program_arrays(program)

    program_arrays = Program.arrays
    monkeypatch.setattr(Program, "arrays", counted)
    harvest = harvest_of(CREWS[0])
    harvest.model.desk.policy = c.IN_PYTHON_EARLY
    assert harvest.asked_policy is not None
    harvest.asked_policy.decides_when_due = False
    harvest.run()
    assert harvest.questions > 5 * len(taken)
    assert taken == sorted(set(taken)), "each time it had grown"
