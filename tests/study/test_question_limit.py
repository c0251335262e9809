"""The page, `orchard bound`, the table of a study and its answer show one limit, whatever ran.

A limit is the rate, bins an hour, that pickers, carriers and the bay allow without traffic. That of
a question holds for rows that take their mean times, so no seed changes it. No run of a study
exceeds it. The summary of a run shows the limit of the rows that its own seed has drawn.
"""

from dataclasses import replace
from math import ceil

import pytest
from drawn_scenarios import few_pickers
from few_runs import FewRuns
from hypothesis import example, given, settings
from hypothesis import strategies as st
from stage import empty_orchard

from orchard.field.layout import lay_out
from orchard.report.bounds import Bounds
from orchard.report.limits import limit_of_question, with_seed
from orchard.study import study as module
from orchard.study.options import StudyOptions
from orchard.study.replications import shown_rate
from orchard.study.runs import PlannedRun, do
from orchard.study.settings import MORE, Setting, first_numbers
from orchard.study.study import study

SMALL = {
    "rows": 4,
    "pickers": 2,
    "row_length": 30.0,
    "picking_speed": 0.05,
    "dispatch": "nearest",
    "seed": 3,
}
DRAWN = {"picking": {"spread": {"distribution": "lognormal", "cv": 0.28}}}
OPTIONS = StudyOptions(budget_seconds=3600.0, model="fast")


def studied(scenario, runs, monkeypatch, tmp_path, horizon="long"):
    """Return the table of a study of one setting that is cut after so many runs."""
    monkeypatch.setattr(module, "processes", lambda count: FewRuns(runs))
    options = replace(OPTIONS, horizon=horizon, store=tmp_path / f"{horizon}{runs}.db")
    return study(scenario, {"carriers": [scenario.carriers]}, options).table


@pytest.mark.parametrize("horizon", ["long", "harvest"])
@pytest.mark.parametrize("carriers", [1, 3])
def test_page_and_study_have_one_limit_after_any_number_of_runs(
    carriers, horizon, monkeypatch, tmp_path
):
    figures = pytest.importorskip("orchard.app.preview").figures
    scenario = empty_orchard(**SMALL, **DRAWN, carriers=carriers)
    limit = limit_of_question(scenario)
    shown, note = figures(lay_out(scenario), limit)[0][1:]
    assert note.endswith(", in rows that take their mean times")
    for runs in (1, 2, 5):
        (row,) = studied(scenario, runs, monkeypatch, tmp_path, horizon)
        assert row.replications == runs
        assert row.bound_bins_per_hour == limit.bins_per_hour
        assert row.bottleneck == limit.bottleneck
        assert shown == f"{row.bound_bins_per_hour:.1f} bins/h"
        assert row.bins_per_hour.mean <= row.bound_bins_per_hour


def test_the_limit_depends_on_no_seed():
    scenario = empty_orchard(**SMALL, **DRAWN, carriers=3)
    limits = [limit_of_question(with_seed(scenario, seed)) for seed in (1, 4, 2**63 - 1)]
    own = [Bounds(lay_out(with_seed(scenario, seed))) for seed in (1, 4)]
    assert len({limit.bins_per_hour for limit in limits}) == 1
    assert own[0].bins_per_hour != own[1].bins_per_hour


def test_the_limit_is_the_scenarios_where_rows_are_fixed():
    """The limit is that of the scenario where no seed changes the rows."""
    figures = pytest.importorskip("orchard.app.preview").figures
    layout = lay_out(empty_orchard(**SMALL, carriers=1))
    limit = limit_of_question(layout.scenario)
    bounds = Bounds(layout)
    assert limit.bins_per_hour == bounds.bins_per_hour
    assert limit.terms == bounds.terms
    assert figures(layout, limit)[0][2].endswith("without traffic")


def test_a_study_begins_with_the_carriers_of_the_limit():
    """It tries carriers up to MORE times as many as keep all pickers busy, and one more.

    By the rows of seed 3 that is one carrier; by rows that take their mean times it is two.
    """
    values = SMALL | {"pickers": 4, "picking_speed": 0.042}
    scenario = empty_orchard(**values, **DRAWN, carriers=1)
    busy = []
    for terms in (Bounds(lay_out(scenario)).terms, limit_of_question(scenario).terms):
        busy.append(ceil(terms["pickers"] / terms["carriers"]))
    assert busy == [1, 2]
    assert max(first_numbers(scenario)) == ceil(MORE * busy[1]) + 1


# An orchard whose five bins are part full: they have the fruit of 3.35.
PART_FULL = {
    "pickers": 5,
    "rows": 5,
    "carriers": 5,
    "picking_speed": 0.01,
    "bins_per_row": 0.67,
    "dispatch": "farthest-first",
    "route": "two-way",
    "picking": {},
    "seed": 44,
}
# An orchard whose seed draws rows that are picked faster than by the mean.
FAST_ROWS = {
    "pickers": 4,
    "rows": 8,
    "carriers": 3,
    "picking_speed": 0.03,
    "bins_per_row": 4.05,
    "dispatch": "rolling",
    "route": "two-way",
    "seed": 6,
    **DRAWN,
}


@settings(max_examples=10)
@example("harvest", PART_FULL)
@example("harvest", FAST_ROWS)
@example("long", FAST_ROWS)
@given(st.sampled_from(["long", "harvest"]), few_pickers([{}, DRAWN["picking"]]))
def test_no_run_of_a_study_exceeds_the_limit(horizon, values):
    assert_within_limit(horizon, values)


@pytest.mark.soak
@settings(max_examples=150)
@given(st.sampled_from(["long", "harvest"]), few_pickers([{}, DRAWN["picking"]]))
def test_many_runs_of_studies_keep_their_limits(horizon, values):
    assert_within_limit(horizon, values)


def assert_within_limit(horizon, values) -> None:
    """Assert that a run of a study has at most the rate that is its limit."""
    scenario = empty_orchard(row_length=60.0, **values)
    record = do(PlannedRun(scenario, "fast", horizon), until=0.0)
    if record.ended == "jammed":
        # A policy that leaves a picker out has no rate.
        return
    setting = Setting({}, scenario)
    assert shown_rate(setting, record) <= setting.limit.bins_per_hour
