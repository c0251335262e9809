"""No long run is faster than the limit, and no battery changes the roads of what it is compared
with.

The limit (`Bounds`) is the rate, bins an hour, that pickers, carriers and the bay allow together
without traffic. A long run is a harvest without end in the event model.
"""

import pytest
from drawn_scenarios import few_pickers
from hypothesis import example, given, settings
from hypothesis import strategies as st
from stage import Stage, empty_orchard

from orchard.discrete.harvest import DiscreteHarvest, Jam
from orchard.field.layout import lay_out
from orchard.report.bounds import Bounds, schedule_seconds
from orchard.report.long_run import long_run
from orchard.report.losses import lost_seconds
from orchard.report.pass_times import PassTimes

DRAWN = {"distribution": "lognormal", "cv": 0.28}
# People who pick by hand: a bin an hour and a half, in rows that take unlike times.
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


@settings(max_examples=12)
@example(BY_HAND)
@example(BY_HAND | {"seed": 4})
@given(few_pickers([{"spread": DRAWN}]))
def test_no_long_run_exceeds_its_limit_where_rows_differ(values):
    assert_within_limit(values)


# A row fills a little more than four bins. Carriers need longer for those that fill at the east
# end. So a rate over few bins depended on which end was there more often.
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
    assert rate <= Bounds(layout).bins_per_hour


def test_a_long_run_keeps_its_limit_with_a_far_end():
    """Carriers need longer to one end of the rows."""
    assert_within_limit(EAST_AND_WEST)


def test_a_long_run_keeps_its_limit_with_other_service_times():
    """With these times, which a seed draws, one of six pickers waits long in the first half of the
    run. So a rate over the last rounds alone would be too high.
    """
    assert_within_limit(
        {
            "pickers": 6,
            "rows": 11,
            "carriers": 1,
            "row_length": 30.0,
            "picking_speed": 0.01,
            "bins_per_row": 2.9,
            "dispatch": "farthest-first",
            "route": "one-way",
            "picking": {"spread": DRAWN},
            "seed": 979,
        }
    )


@pytest.mark.parametrize("carriers", [1, 2])
def test_a_long_run_keeps_its_limit_where_near_bins_come_first(carriers):
    """The policy prefers near bins: the near picker fills 1.4 times as many bins as the far one."""
    assert_within_limit(
        {
            "pickers": 2,
            "rows": 6,
            "carriers": carriers,
            "row_length": 50.0,
            "picking_speed": 0.5,
            "bins_per_row": 2.9,
            "dispatch": "assignment",
            "route": "two-way",
        }
    )


@pytest.mark.soak
@settings(max_examples=150)
@given(orchards_whose_rows_are_alike())
def test_no_long_run_exceeds_its_limit_where_rows_are_alike(values):
    """Each example is a long run, of up to a minute: too long for each change."""
    assert_within_limit(values)


# An orchard whose last bins are part full: three bins have the fruit of 2.01.
PART_FULL = {
    "rows": 3,
    "pickers": 3,
    "carriers": 4,
    "row_length": 30.0,
    "picking_speed": 0.05,
    "bins_per_row": 0.67,
    "dispatch": "predictive",
    "route": "two-way",
}


@st.composite
def short_harvests(draw):
    """Draw a harvest that the simulator does in some seconds."""
    pickers = draw(st.integers(2, 3))
    return {
        "pickers": pickers,
        "rows": draw(st.integers(3, 5)),
        "carriers": draw(st.integers(1, 4)),
        "row_length": draw(st.sampled_from([20.0, 30.0, 45.0])),
        "picking_speed": draw(st.sampled_from([0.05, 0.2, 1.0])),
        "bins_per_row": draw(st.sampled_from([None, 0.4, 0.67, 1.3, 2.9])),
        "dispatch": draw(st.sampled_from(["nearest", "predictive", "rolling", "assignment"])),
        "route": draw(st.sampled_from(["one-way", "two-way"])),
        "picking": draw(st.sampled_from([{}, {"spread": DRAWN}])),
        "seed": draw(st.integers(1, 1000)),
    }


def assert_harvest_within_limit(values) -> None:
    """Assert that the summary of a whole harvest has at most the rate that is its limit."""
    stage = Stage(empty_orchard(**values))
    stage.run_to_the_end()
    figures = stage.account.figures()
    assert figures["bins_per_hour"] <= figures["limit_bins_per_hour"]


@settings(max_examples=4)
@example(PART_FULL)
@given(short_harvests())
def test_the_summary_of_no_harvest_exceeds_its_limit(values):
    assert_harvest_within_limit(values)


@pytest.mark.soak
@settings(max_examples=100)
@given(short_harvests())
def test_the_summaries_of_many_harvests_keep_their_limits(values):
    assert_harvest_within_limit(values)


@pytest.mark.soak
@settings(max_examples=150)
@given(few_pickers([{"spread": DRAWN}]))
def test_many_long_runs_keep_their_limits_where_rows_differ(values):
    assert_within_limit(values)


@pytest.mark.parametrize("bins_per_row", [0.67, 3.4, None])
def test_the_limit_is_that_of_the_means_where_rows_are_alike(bins_per_row):
    layout = lay_out(
        empty_orchard(rows=6, pickers=2, picking_speed=0.05, bins_per_row=bins_per_row)
    )
    # Two pickers fill a bin each in `bin_seconds`. Their shares differ by less than 0.5 %.
    bounds = Bounds(layout)
    assert 0.995 < bounds.terms["pickers"] * bounds.bin_seconds / 2 < 1.005
    carriers = layout.scenario.carrier_count
    assert bounds.terms["carriers"] * bounds.cycle_seconds == pytest.approx(carriers)


@pytest.mark.parametrize("route", ["one-way", "two-way"])
def test_a_picker_that_comes_out_of_its_row_crosses_once(route):
    """While it comes out, it already waits for its carrier, and that counts once.

    With many carriers that leave early, no picker waits longer than it must. So four rows more, two
    for each picker, take twice what the limit allows for a bin, or up to 2 % more.
    """
    layouts = [
        lay_out(
            empty_orchard(
                rows=rows,
                pickers=2,
                carriers=8,
                route=route,
                dispatch="predictive",
                row_length=60.0,
                picking_speed=0.3,
            )
        )
        for rows in (8, 12)
    ]
    fewer, more = (schedule_seconds(layout) for layout in layouts)
    assert 0.98 < Bounds(layouts[0]).bin_seconds / ((more - fewer) / 2) <= 1.0


def test_the_rate_of_a_long_run_is_not_cut_at_the_limit():
    """If plans were twice too slow for carriers, this run would exceed the limit that follows."""
    layout = lay_out(empty_orchard(rows=4, pickers=3, carriers=1, picking_speed=0.5))
    rate = long_run(layout).bins_per_hour
    wrong = Bounds(layout)
    wrong.pass_times = SlowCarriersTimes(layout)
    wrong.of_pickers = {name: with_slow_carriers(times) for name, times in wrong.of_pickers.items()}
    assert Bounds(layout).bottleneck == "carriers"
    assert long_run(layout, bounds=wrong).bins_per_hour == pytest.approx(rate)


class SlowCarriersTimes(PassTimes):
    """The times of passes with plans that are twice too slow for carriers."""

    def of(self, current, after):
        return with_slow_carriers(super().of(current, after))


def with_slow_carriers(times):
    """Return the times of `Bounds` with twice as long a round of a carrier."""
    return times._replace(cycle=2.0 * times.cycle)


@pytest.mark.parametrize("beside_the_model", [0.0, 0.1, 5.0])
def test_a_battery_that_never_runs_down_costs_nothing(beside_the_model):
    """That holds, too, if the harvest takes longer than the event model says, by `beside_the_model`
    s.
    """
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
    seconds = DiscreteHarvest(layout).run().seconds + beside_the_model
    lost = lost_seconds(layout, seconds)
    assert lost["charging"] == 0.0
    assert lost["traffic"] >= 0.0
    assert sum(lost.values()) == pytest.approx(seconds, abs=0.2)
