"""What explains the table of a study, and the intervals of its picture."""

from dataclasses import replace

import pytest
from made_studies import a_result, a_row, carriers, interval

from orchard.field.scenario import Scenario
from orchard.study.picture import half_widths
from orchard.study.table import legend


def test_the_legend_explains_the_marks_of_settings():
    """The legend explains the marks of settings that are compared."""
    rows = [a_row(10.0, setting=carriers(1)), a_row(20.0, setting=carriers(2))]
    text = legend(a_result(rows, carriers(2)))
    assert text.startswith("* the answer; = within 2 % of the best")
    assert "behind: how far behind the best mean" in text


OFTEN = {"failure": {"mean_between": 3600.0}}
FAILING = "± interval of 95 % confidence, but where robots fail often one of 95 % held in"


@pytest.mark.parametrize("kind", ["picking", "carrying"])
@pytest.mark.parametrize(
    ("runs", "words"),
    [
        (4, f"{FAILING} 81 % after 5 runs. "),
        (10, f"{FAILING} 86 % after 10 runs. "),
        (20, f"{FAILING} 94 % after 20 runs. "),
        (40, "± interval of 95 % confidence. "),
    ],
)
def test_the_legend_says_how_often_few_runs_hold(kind, runs, words):
    """Where robots may fail, in the scenario or in a setting, a few runs may miss long repairs.

    A long run has so much of all that is rare that it misses nothing.
    """
    row = a_row(10.0, setting=carriers(1), replications=runs)
    scenario = Scenario.model_validate({kind: OFTEN}).model_dump()
    fails = replace(a_result([row], carriers(1)), scenario=scenario)
    assert words in legend(fails)
    assert "± interval of 95 % confidence. " in legend(replace(fails, horizon="long"))
    varies = a_result([row], carriers(1))
    assert "± interval of 95 % confidence. " in legend(varies)
    varied = {f"{kind}.failure.mean_between": [None, 3600.0]}
    assert words in legend(replace(varies, varied=varies.varied | varied))


def test_the_bars_of_a_picture_reach_from_the_mean_to_both_ends():
    """The interval is 10 ± 2. Matplotlib takes the lengths of all bars below, and then above."""
    assert half_widths([interval(10.0, 2.0)]).tolist() == [[2.0], [2.0]]
