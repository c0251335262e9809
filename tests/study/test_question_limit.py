"""The page, the table of a study and its answer show one limit; a summary shows that of its own
rows.
"""

from math import ceil

import pytest
from few_runs import FewRuns
from stage import empty_orchard

from orchard.field.layout import lay_out
from orchard.report.bounds import Bounds
from orchard.report.limits import FIRST_SEEDS, limit_of_question
from orchard.study import study as module
from orchard.study.settings import MORE, first_numbers
from orchard.study.study import StudyOptions, study

SMALL = {
    "rows": 4,
    "pickers": 2,
    "row_length": 30.0,
    "picking_speed": 0.05,
    "dispatch": "nearest",
    "seed": 3,
}
DRAWN = {"picking": {"spread": {"distribution": "lognormal", "cv": 0.28}}}


@pytest.mark.parametrize("carriers", [1, 3])
def test_the_page_shows_the_limit_of_the_first_look_of_a_study(carriers, monkeypatch, tmp_path):
    figures = pytest.importorskip("orchard.app.preview").figures
    scenario = empty_orchard(**SMALL, **DRAWN, carriers=carriers)
    monkeypatch.setattr(module, "processes", lambda count: FewRuns(FIRST_SEEDS))
    options = StudyOptions(budget_seconds=3600.0, store=tmp_path / "s.db")
    row = study(scenario, {"carriers": [carriers]}, options).table[0]
    limit = limit_of_question(lay_out(scenario))
    assert (row.replications, limit.seeds) == (FIRST_SEEDS, (3, 4, 5, 6, 7))
    assert row.bound_bins_per_hour == pytest.approx(limit.bins_per_hour)
    assert row.bottleneck == limit.bottleneck
    shown, note = figures(lay_out(scenario), limit)[0][1:]
    assert shown == f"{row.bound_bins_per_hour:.1f} bins/h"
    assert note.endswith("; mean over the seeds 3 to 7, with which a study begins")


def test_the_limit_is_the_scenarios_where_rows_are_fixed():
    """The limit is that of the scenario where no seed changes the rows."""
    figures = pytest.importorskip("orchard.app.preview").figures
    layout = lay_out(empty_orchard(**SMALL, carriers=1))
    limit = limit_of_question(layout)
    bounds = Bounds(layout)
    assert limit.seeds == (3,)
    assert limit.bins_per_hour == bounds.bins_per_hour
    assert limit.terms == bounds.terms
    assert figures(layout, limit)[0][2].endswith("without traffic")


def test_after_the_last_seed_comes_the_first_one():
    limit = limit_of_question(lay_out(empty_orchard(**SMALL | {"seed": 2**63 - 1}, **DRAWN)))
    assert limit.seeds == (2**63 - 1, 0, 1, 2, 3)


def test_a_study_begins_with_the_carriers_of_the_limit():
    """A study begins with the carriers that the limit of the question asks for.

    By the rows of seed 3 alone one carrier keeps all busy, by those of five seeds two do.
    """
    values = SMALL | {"pickers": 4, "picking_speed": 0.042}
    scenario = empty_orchard(**values, **DRAWN, carriers=1)
    layout = lay_out(scenario)
    busy = []
    for terms in (Bounds(layout).terms, limit_of_question(layout).terms):
        busy.append(ceil(terms["pickers"] / terms["carriers"]))
    assert busy == [1, 2]
    assert max(first_numbers(scenario)) == ceil(MORE * busy[1]) + 1
