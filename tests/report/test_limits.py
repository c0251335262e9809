"""No long run is faster than the limit, and no battery changes the roads of what it is compared with."""

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from stage import empty_orchard

from orchard.discrete.harvest import DiscreteHarvest, Jam, long_run
from orchard.field.layout import lay_out
from orchard.report.bounds import Bounds, lost_seconds

DRAWN = {"distribution": "lognormal", "cv": 0.28}
BY_HAND = {
    "rows": 12,
    "pickers": 3,
    "carriers": 3,
    "row_length": 90.0,
    "bins_per_row": 4.05,
    "picking_rate": 1.5,
    "picking_speed": None,
    "picking": {"spread": DRAWN},
    "seed": 1,
}


@st.composite
def orchards_whose_rows_differ(draw):
    pickers = draw(st.integers(2, 4))
    return {
        "pickers": pickers,
        "rows": draw(st.integers(max(3, pickers), 9)),
        "carriers": draw(st.integers(1, 4)),
        "picking_speed": draw(st.sampled_from([0.01, 0.05, 0.3])),
        "bins_per_row": draw(st.sampled_from([None, 0.67, 2.9, 4.05])),
        "dispatch": draw(st.sampled_from(["nearest", "predictive", "farthest-first"])),
        "route": draw(st.sampled_from(["one-way", "two-way"])),
        "picking": {"spread": DRAWN},
        "seed": draw(st.integers(1, 1000)),
    }


@settings(max_examples=12, deadline=None, derandomize=True, database=None)
@example(BY_HAND)
@example(BY_HAND | {"seed": 4})
@given(orchards_whose_rows_differ())
def test_no_long_run_exceeds_its_limit_where_rows_differ(values):
    layout = lay_out(empty_orchard(**values))
    try:
        rate = long_run(layout).bins_per_hour
    except Jam:
        # A policy that leaves a picker out has no rate.
        return
    assert rate <= Bounds(layout).bins_per_hour


# A row fills a little more than four bins. Carriers need longer for those that fill at the east end.
# So a rate over few bins depended on which end was there more often.
EAST_AND_WEST = {
    "rows": 6,
    "pickers": 3,
    "carriers": 1,
    "row_length": 50.0,
    "picking_speed": 0.5,
    "bins_per_row": 4.05,
    "route": "two-way",
    "rows_to_pickers": "balanced",
    "dispatch": "rolling",
}


@st.composite
def orchards_whose_rows_are_alike(draw):
    pickers = draw(st.integers(2, 4))
    return {
        "pickers": pickers,
        "rows": draw(st.integers(max(3, pickers), 8)),
        "carriers": draw(st.integers(1, 2)),
        "picking_speed": draw(st.sampled_from([0.1, 0.5, 1.0])),
        "row_length": draw(st.sampled_from([30.0, 50.0, 100.0])),
        "bins_per_row": draw(st.sampled_from([None, 0.67, 2.9, 4.05])),
        "dispatch": draw(st.sampled_from(["nearest", "predictive", "farthest-first"])),
        "route": draw(st.sampled_from(["one-way", "two-way"])),
    }


def assert_within_limit(values) -> None:
    """Assert that a long run of an orchard has at most the rate that is its limit."""
    layout = lay_out(empty_orchard(**values))
    try:
        rate = long_run(layout).bins_per_hour
    except Jam:
        # A policy that leaves a picker out has no rate.
        return
    bounds = Bounds(layout)
    assert rate <= bounds.bins_per_hour
    # No allowance lifts the limit of the carriers by more than half a percent above the means.
    assert bounds.terms["carriers"] * bounds.cycle_seconds <= 1.005 * values["carriers"]


def test_a_long_run_keeps_its_limit_where_carriers_need_longer_to_one_end():
    assert_within_limit(EAST_AND_WEST)


@pytest.mark.soak
@settings(max_examples=8, deadline=None, derandomize=True, database=None)
@given(orchards_whose_rows_are_alike())
def test_no_long_run_exceeds_its_limit_where_rows_are_alike(values):
    """Each example is a long run, of up to a minute: too long for each change."""
    assert_within_limit(values)


@pytest.mark.parametrize("bins_per_row", [0.67, 3.4, None])
def test_the_limit_is_that_of_the_means_where_rows_are_alike(bins_per_row):
    layout = lay_out(
        empty_orchard(rows=6, pickers=2, picking_speed=0.05, bins_per_row=bins_per_row)
    )
    bounds = Bounds(layout)
    assert 0.995 < bounds.terms["pickers"] * bounds.bin_seconds / 2 < 1.005


def test_a_battery_that_never_runs_down_costs_nothing():
    battery = {"hours": 200.0, "hours_to_charge": 0.5, "reserve": 0.0}
    layout = lay_out(
        empty_orchard(
            rows=4,
            pickers=2,
            carriers=1,
            row_length=60.0,
            picking_speed=0.3,
            dispatch="predictive",
            carrying={"battery": battery},
        )
    )
    seconds = DiscreteHarvest(layout).run().seconds
    lost = lost_seconds(layout, seconds)
    assert lost["charging"] == 0.0
    assert lost["traffic"] >= 0.0
    assert sum(lost.values()) == pytest.approx(seconds, abs=0.2)
