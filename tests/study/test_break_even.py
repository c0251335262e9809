"""What one more robot may cost, against sums by hand."""

from types import SimpleNamespace
from typing import Any

import pytest

from orchard.field.scenario import Scenario
from orchard.study.break_even import KnownSetting, break_even_words, break_evens
from orchard.study.checking import checked_settings
from orchard.study.options import StudyOptions
from orchard.study.settings import Setting

PRICES = {"picker_per_hour": 25.0, "carrier_per_hour": 10.0}
SHIFT = {"begin": "08:00", "end": "16:00"}


def known(rate: float, carriers: int, pickers: int = 4, **prices: Any) -> KnownSetting:
    """Return a setting with prices, two runs of which had this rate, bins an hour.

    Pickers cost 25 an hour each, and carriers 10. A day has 8 h.
    """
    scenario = Scenario(
        rows=8, pickers=pickers, carriers=carriers, shift=SHIFT, prices=PRICES | prices
    )
    record: Any = SimpleNamespace(bins_per_hour=rate, counted_bins=None)
    return KnownSetting(
        Setting({"pickers": pickers, "carriers": carriers}, scenario), [record, record]
    )


def test_the_last_carrier_may_cost_what_it_saves() -> None:
    """With two carriers an hour costs 4 * 25 + 2 * 10 = 120, and a bin 120 / 10 = 12.

    With three, 12 bins an hour may cost 144 at 12 a bin: 100 for pickers, 20 for two carriers, and
    24 for the third one. A fourth one brings no bin more, so it may cost nothing.
    """
    settings = [known(10.0, 2), known(12.0, 3), known(12.0, 4)]
    last, more = break_evens(settings[1], [settings[0], settings[2]], 0.95)
    assert (last.key, last.number, last.fewer) == ("carriers", 3, 2)
    assert last.per_hour.mean == pytest.approx(24.0)
    assert break_even_words(last) == "carrier number 3 pays if it costs up to 24.0 an hour"
    assert more.per_hour.mean == pytest.approx(0.0, abs=1e-9)


def test_a_robot_that_is_bought_is_worth_its_hours() -> None:
    """With 4 pickers and 2 carriers a bin costs 12.

    With a fifth picker 12.5 bins an hour may cost 150 at 12 a bin: 100 for the other pickers, 20
    for carriers, and 30 for the fifth one. In 5 years of 400 h that is 60,000.
    """
    robot = {"years": 5.0, "hours_per_year": 400.0}
    five = known(12.5, 2, pickers=5, picker_bought=robot)
    (last,) = break_evens(five, [known(10.0, 2, picker_bought=robot)], 0.95)
    assert last.per_hour.mean == pytest.approx(30.0)
    assert last.price is not None and last.price.mean == pytest.approx(60000.0)
    assert break_even_words(last) == (
        "picker number 5 pays if it costs up to 30.0 an hour; one that is bought is worth 60,000,"
        " with 5 years of 400 hours"
    )


def test_the_least_of_a_day_is_paid_for_a_robot() -> None:
    """A day of 8 h is paid with 240 at least, 30 an hour in place of 25.

    With 4 pickers and 2 carriers an hour costs 4 * 30 + 2 * 10 = 140, and a bin 140 / 10 = 14. With
    a fifth picker 12.5 bins may cost 175 at 14 a bin: 120 for the other pickers, 20 for carriers,
    and 35 for the fifth one.
    """
    five = known(12.5, 2, pickers=5, picker_least_per_day=240.0)
    (last,) = break_evens(five, [known(10.0, 2, picker_least_per_day=240.0)], 0.95)
    assert last.per_hour.mean == pytest.approx(35.0)


def test_each_of_two_more_robots_may_cost_half_of_what_both_save() -> None:
    """With two carriers a bin costs 120 / 10 = 12.

    With four, 15 bins an hour may cost 180 at 12 a bin: 100 for pickers, 20 for two carriers, and
    60 for the other two, 30 each.
    """
    (last,) = break_evens(known(15.0, 4), [known(10.0, 2)], 0.95)
    assert last.per_hour.mean == pytest.approx(30.0)
    assert break_even_words(last).startswith("each carrier from number 3 to 4 pays if it costs up")


def test_settings_that_differ_in_more_tell_no_break_even() -> None:
    assert break_evens(known(12.0, 3), [known(10.0, 2, pickers=3)], 0.95) == []


def test_pickers_that_cost_nothing_are_told() -> None:
    """If pickers cost nothing, the most of them would always be the cheapest.

    That is no problem if the goal is the rate.
    """
    scenario = Scenario(rows=8, prices={"carrier_per_hour": 8.0})
    (problem,) = checked_settings(scenario, {"pickers": [2, 3]}, StudyOptions())[1]
    assert str(problem).startswith("--vary pickers: prices: pickers vary and cost nothing")
    by_rate = StudyOptions(goal="bins_per_hour")
    assert checked_settings(scenario, {"pickers": [2, 3]}, by_rate)[1] == []
