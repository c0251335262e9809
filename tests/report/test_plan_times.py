"""The times of plans that all seeds of an orchard share: a seed has the same limit to the last bit,
whichever seed came before it.
"""

import pytest
from stage import empty_orchard

from orchard.field.layout import lay_out
from orchard.report import plan_times
from orchard.report.bounds import Bounds
from orchard.report.plan_times import PlanTimes

# Rows that take unlike times, and bins that fill inside them.
UNLIKE = {
    "rows": 6,
    "pickers": 2,
    "carriers": 2,
    "row_length": 50.0,
    "bins_per_row": 2.3,
    "picking_speed": 0.1,
    "picking": {"spread": {"distribution": "lognormal", "cv": 0.3}},
    "dispatch": "predictive",
}


@pytest.fixture(autouse=True)
def _nothing_is_kept():
    """Forget the times of other tests, and those of this one."""
    plan_times._kept.cache_clear()
    yield
    plan_times._kept.cache_clear()


def orchard(seed: int, **changes: object):
    return lay_out(empty_orchard(**{**UNLIKE, "seed": seed, **changes}))


def test_the_limit_of_a_seed_does_not_depend_on_seeds_before():
    alone = Bounds(orchard(seed=5))
    plan_times._kept.cache_clear()
    before = Bounds(orchard(seed=3))
    after = Bounds(orchard(seed=5))
    assert PlanTimes.of(orchard(seed=3)) is PlanTimes.of(orchard(seed=5))
    assert before.of_pickers != after.of_pickers
    assert after.of_pickers == alone.of_pickers
    assert after.bins_per_hour == alone.bins_per_hour


def test_picking_is_no_part_of_what_plans_take():
    """Slow and fast pickers drive alike."""
    times = []
    for speed in (0.05, 0.7):
        layout = orchard(seed=1, picking_speed=speed, picking={})
        passes = layout.passes(next(iter(layout.blocks.values())))
        times.append(PlanTimes.of(layout).of_pass(passes[0], passes[1]))
    assert times[0] == times[1]


def test_another_orchard_has_times_of_its_own():
    near = orchard(seed=1)
    far = orchard(seed=1, row_length=80.0)
    ends = [PlanTimes.of(layout).of_job(1, "east").cycle for layout in (near, far)]
    assert PlanTimes.of(near) is not PlanTimes.of(far)
    assert ends[0] != ends[1]
