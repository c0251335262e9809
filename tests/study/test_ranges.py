"""What a study tries and what it answers: ends of ranges, numbers of carriers that nobody has
named, and values that nobody chooses.

A value that can be chosen, such as a number of carriers, has a best. One that is given, such as the
rate at which a crop is picked, has none: each has a best setting of its own.
"""

import re
from dataclasses import replace

import pytest
from small_studies import AMPLE, QUIET

from orchard.field.scenario import Scenario
from orchard.study.picture import inline_svg
from orchard.study.settings import more_numbers, most_carriers
from orchard.study.study import study
from orchard.study.table import heads_and_lines, legend


def test_a_little_worse_is_as_good_and_an_end_is_told(tmp_path):
    """A bay that is 0.4 m or 0.8 m further away makes the harvest hardly longer.

    So the settings are equal. A nearer bay, one step of 0.4 m beyond the range, was not tried.
    """
    settled = study(
        Scenario(rows=3, **QUIET),
        {"bay": [10.0, 10.4, 10.8]},
        replace(AMPLE, store=tmp_path / "s.db"),
    )
    assert [row.standing for row in settled.table] == ["best", "equal", "equal"]
    assert settled.beyond == {"bay": pytest.approx(9.6)}
    assert settled.answer.startswith("At most bay 10: ")
    assert "the range is too small, as bay 9.6 may be better" in settled.answer


def test_an_answer_with_fewer_robots_is_behind_the_best_mean(tmp_path):
    options = replace(AMPLE, within=0.9, store=tmp_path / "s.db")
    settled = study(Scenario(rows=3, **QUIET), {"carriers": [1, 2]}, options)
    one, two = settled.table
    assert settled.best == one.setting == {"carriers": 1}
    assert one.behind > 0.0
    assert two.behind is None


RATES = {"picking_rate": [5.0, 50.0]}


PRICES = {"picker_per_hour": 25.0, "carrier_per_hour": 8.0}


@pytest.mark.parametrize(
    ("varied", "words"),
    [
        (RATES, "picking rate"),
        ({"prices.picker_per_hour": [20.0, 25.0]}, "prices picker per hour"),
        ({"crop": [{"tonnes_per_hectare": 30.0}, {"tonnes_per_hectare": 60.0}]}, "crop"),
    ],
)
def test_what_nobody_chooses_has_a_table_and_no_best(varied, words, tmp_path):
    crop = {"tonnes_per_hectare": 30.0, "kilograms_per_bin": 350.0}
    told = study(
        Scenario(rows=3, carriers=2, crop=crop, prices=PRICES, **QUIET),
        varied,
        replace(AMPLE, horizon="long", store=tmp_path / "s.db"),
    )
    assert (told.best, told.given, told.beyond) == (None, list(varied), {})
    assert [row.standing for row in told.table] == ["alone", "alone"]
    assert f"; {words} is given and not chosen, so there is no best. The orchard: " in told.answer
    heads, lines = heads_and_lines(told)
    assert "behind, %" not in heads and "*" not in "".join(cell for line in lines for cell in line)
    assert "the answer" not in legend(told) and inline_svg(told)


def test_what_can_be_chosen_has_a_best_for_each_of_what_cannot(tmp_path):
    """Fast pickers need more carriers. Each picking rate has its best number of carriers."""
    told = study(
        Scenario(rows=6, pickers=3, **QUIET),
        {"carriers": [1, 2, 3, 4], **RATES},
        replace(AMPLE, horizon="long", store=tmp_path / "s.db"),
    )
    best = [row.setting for row in told.table if row.standing == "best"]
    assert told.best is None
    slow, fast = sorted(best, key=lambda setting: setting["picking_rate"])
    assert slow["carriers"] < fast["carriers"]
    for row in told.table:
        alike = [
            other.bins_per_hour.mean
            for other in told.table
            if other.setting["picking_rate"] == row.setting["picking_rate"]
        ]
        behind = max(alike) / row.bins_per_hour.mean - 1.0
        assert (row.behind or 0.0) == pytest.approx(behind)
    assert told.answer.startswith("picking rate 5: 1 carrier, ")
    assert "picking rate is given and not chosen, so each has a best of its own" in told.answer
    assert legend(told).startswith("* the best for each picking rate; ")
    assert (
        "behind: how far behind the best mean for the same picking rate, which has -. "
        in legend(told)
    )


def test_open_carriers_are_tried_for_each_circumstance(tmp_path):
    """For each picking rate carriers are tried up to half as many more as are best."""
    told = study(
        Scenario(rows=6, pickers=3, **QUIET),
        {"carriers": [], **RATES},
        replace(AMPLE, horizon="long", within=0.02, store=tmp_path / "s.db"),
    )
    best = [row.setting["carriers"] for row in told.table if row.standing == "best"]
    tried = set(told.varied["carriers"])
    assert len(best) == 2 and max(tried) >= 1.5 * max(best)
    assert all({number - 1, number + 1} - {0} <= tried for number in best)


def test_a_policy_that_leaves_pickers_out_is_not_the_best(tmp_path):
    """With two carriers for six pickers `assignment` never serves some of them, in the long run.

    The rate of the others would be too good. People vary too, so that two settings jam.
    """
    varied: dict[str, list] = {
        "dispatch": ["assignment", "predictive"],
        "people": [{"workers": 0}, {"visitors": 0}],
    }
    told = study(
        Scenario(rows=12, pickers=6, carriers=2, **QUIET),
        varied,
        replace(AMPLE, horizon="long", store=tmp_path / "s.db"),
    )
    best = [row.setting for row in told.table if row.standing == "best"]
    assert best == [{"dispatch": "predictive", "people": people} for people in varied["people"]]
    assert (
        sum(
            bool(
                re.match(
                    "dispatch=assignment, .* jams: picker_.*: too few carriers come to it", note
                )
            )
            for note in told.notes
        )
        == 2
    )
    assert inline_svg(told)


def test_the_last_number_of_carriers_is_told_as_a_bound(tmp_path):
    """Three pickers have one or two carriers, and three may be better: the answer is "at least 2".

    In another orchard the last number is the most for which there is room: so there is none beyond
    it.
    """
    told = study(
        Scenario(rows=6, pickers=3, **QUIET),
        {"carriers": [1, 2]},
        replace(AMPLE, horizon="long", store=tmp_path / "s.db"),
    )
    assert (told.best, told.beyond) == ({"carriers": 2}, {"carriers": 3})
    assert told.answer.startswith("At least 2 carriers: ")
    full = Scenario(rows=3, row_length=20.0, route="two-way", **QUIET)
    most = most_carriers(full)
    last = study(
        full, {"carriers": [1, most]}, replace(AMPLE, horizon="long", store=tmp_path / "s.db")
    )
    assert (last.best, last.beyond) == ({"carriers": most}, {})


@pytest.mark.parametrize(
    "changes", [{}, {"prices": {"picker_per_hour": 15.0, "carrier_per_hour": 6.0}}]
)
def test_a_study_without_values_tries_carriers_until_enough(changes, tmp_path):
    """A study without --vary tries carriers until the answer lies inside what was tried.

    Its neighbours were tried, and half as many carriers more. Without prices the answer is the
    fewest that are behind the best by less than 2 %.
    """
    scenario = Scenario(rows=6, pickers=3, picking_speed=0.3, **QUIET, **changes)
    found = study(
        scenario, options=replace(AMPLE, horizon="long", within=0.02, store=tmp_path / "s.db")
    )
    tried = found.varied["carriers"]
    best = found.best["carriers"]
    assert (
        {best - 1, best + 1} - {0} <= set(tried) and max(tried) >= 1.5 * best and found.beyond == {}
    )
    assert found.goal == ("cost_per_bin" if changes else "bins_per_hour")
    rows = {row.setting["carriers"]: row for row in found.table}
    assert list(rows) == tried
    behind = {
        number: (
            max(row.bins_per_hour.mean for row in found.table) / rows[number].bins_per_hour.mean
            - 1.0
        )
        for number in tried
    }
    assert changes or behind[best] < 0.02 <= behind[best - 1]


def test_an_orchard_without_room_for_more_carriers_says_so(tmp_path):
    scenario = Scenario(rows=10, row_length=20.0, pickers=8, carriers=3, picking_rate=60.0, **QUIET)
    found = study(scenario, options=replace(AMPLE, horizon="long", store=tmp_path / "s.db"))
    most = most_carriers(scenario)
    assert (
        found.best == {"carriers": most}
        and f"the orchard has room for {most} carriers, no more" in found.notes
    )


# The answer so far, the numbers that were tried, and those to try next, of at most 40. First a gap
# below the answer is halved. Else come its neighbour above, and numbers up to 1.5 times the answer
# in steps of a quarter of it, unless the range reaches so far already.
NUMBERS = [
    (3, [1, 2, 3], [4, 5]),
    (8, [4, 5, 6, 7, 8], [9, 10, 12]),
    (3, [3, 4, 5], [1]),
    (8, [4, 8, 12], [6]),
]


@pytest.mark.parametrize(("answer", "tried", "more"), NUMBERS)
def test_a_range_grows_until_neighbours_of_the_answer_are_in(answer, tried, more):
    assert more_numbers(tried, answer, 40) == more
    assert more_numbers(tried, answer, 4) == [number for number in more if number <= 4]
