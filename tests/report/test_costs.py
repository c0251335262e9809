"""What is paid for what, against sums by hand with round figures.

The costs are those of a bin. Prices have no currency.
"""

from typing import Any

import pytest

from orchard.field.problems import ScenarioError
from orchard.field.scenario import Scenario, WorkShift, parse
from orchard.report.costs import payments_of_harvest, payments_of_long_run
from orchard.report.days import WorkDays

# 8 h of work.
EIGHT_HOURS = WorkDays(WorkShift(begin="08:00", end="16:00"), homing_seconds=0.0)
SHIFT = {"begin": "08:00", "end": "16:00"}


def four_pickers(**prices: Any) -> Scenario:
    """Return an orchard with 4 pickers and 2 carriers, and a day of 8 h."""
    return Scenario(rows=8, pickers=4, carriers=2, shift=SHIFT, prices=prices)


def test_all_that_is_paid_adds_up_in_the_long_run() -> None:
    """At 10 bins an hour. An hour costs 4 * 25 = 100 for pickers and 30 of overhead; a day of 8 h
    costs 2 * 80 for carriers, 20 an hour, and 80 of overhead, 10 an hour. A bin costs 2 and 1 more.
    """
    scenario = four_pickers(
        picker_per_hour=25.0,
        picker_per_bin=2.0,
        carrier_per_day=80.0,
        overhead_per_hour=30.0,
        overhead_per_day=80.0,
        per_bin=1.0,
    )
    assert payments_of_long_run(scenario, 10.0, EIGHT_HOURS) == {
        "picker_hours": pytest.approx(10.0),
        "picker_bins": pytest.approx(2.0),
        "carrier_days": pytest.approx(2.0),
        "overhead_hours": pytest.approx(3.0),
        "overhead_days": pytest.approx(1.0),
        "bins": pytest.approx(1.0),
    }


def test_a_picker_gets_the_least_of_a_day() -> None:
    """At 4 bins an hour each of 4 pickers fills 8 a day, and earns 80. It gets 120 at least: so 40
    more, 5 a bin. At 6 an hour it earns 120.
    """
    scenario = four_pickers(picker_per_bin=10.0, picker_least_per_day=120.0)
    paid = payments_of_long_run(scenario, 4.0, EIGHT_HOURS)
    assert paid == {"picker_bins": pytest.approx(10.0), "picker_least": pytest.approx(5.0)}
    assert "picker_least" not in payments_of_long_run(scenario, 6.0, EIGHT_HOURS)


def test_a_day_that_is_begun_is_paid_as_a_whole() -> None:
    """24 bins at 2 an hour take 12 h: wages of 12 h, and rent of two days."""
    scenario = four_pickers(picker_per_hour=10.0, carrier_per_day=60.0)
    paid = payments_of_harvest(scenario, 24, 2.0, EIGHT_HOURS)
    assert paid["picker_hours"] == pytest.approx(4 * 10.0 * 12 / 24)
    assert paid["carrier_days"] == pytest.approx(2 * 60.0 * 2 / 24)


def test_the_least_is_paid_for_each_day_by_itself() -> None:
    """24 bins at 2 an hour take 12 h: 8 h of the first day earn 80, and 4 h of the second 40. At
    least 100 are paid for each day: so 20 and 60 more.
    """
    scenario = four_pickers(picker_per_hour=10.0, picker_least_per_day=100.0)
    paid = payments_of_harvest(scenario, 24, 2.0, EIGHT_HOURS)
    assert paid["picker_least"] == pytest.approx(4 * (20.0 + 60.0) / 24)


def test_a_machine_that_is_bought_is_paid_by_its_hours() -> None:
    """40,000 for 4 years of 500 hours are 20 an hour; two carriers at 10 bins an hour: 4 a bin."""
    bought = {"price": 40000.0, "years": 4.0, "hours_per_year": 500.0}
    scenario = four_pickers(carrier_bought=bought, picker_bought=bought)
    assert payments_of_long_run(scenario, 10.0, None) == {
        "picker_bought": pytest.approx(8.0),
        "carrier_bought": pytest.approx(4.0),
    }


def test_carriers_that_drive_home_leave_less_of_a_day() -> None:
    """With 1 h to finish jobs a day does 7 h of a harvest, and is paid as 8 h."""
    days = WorkDays(WorkShift(begin="08:00", end="16:00"), homing_seconds=3600.0)
    scenario = four_pickers(picker_per_hour=10.0)
    # 16 bins at 2 an hour take 8 h: 7 h on the first day, which is paid as 8 h, and 1 h.
    paid = payments_of_harvest(scenario, 16, 2.0, days)
    assert paid["picker_hours"] == pytest.approx(4 * 10.0 * 9 / 16)


def test_a_picker_that_is_away_is_not_paid() -> None:
    """24 bins at 2 an hour take 12 h: 8 h and 4 h. One of 4 pickers comes after 4 h, and is ill on
    the second day. So 3 * 12 + 4 h are paid, 10 each.

    Of the least of 100 for a day the others get 20 and 60 more. It gets 60 more on the first day,
    and nothing on the second one, on which it does not come.
    """
    prices = {"picker_per_hour": 10.0, "picker_least_per_day": 100.0}
    scenario = four_pickers(**prices)
    ill = scenario.model_copy(update={"picker_absences": {"picker_02": [[0.0, 4.0], [8.0, 16.0]]}})
    paid = payments_of_harvest(ill, 24, 2.0, EIGHT_HOURS)
    assert paid["picker_hours"] == pytest.approx(10.0 * 40 / 24)
    assert paid["picker_least"] == pytest.approx((3 * (20.0 + 60.0) + 60.0) / 24)


def test_who_comes_for_minutes_of_a_day_does_not_get_its_least() -> None:
    """A day of 8 h does 7 h of a harvest. Who is ill from hour 8 on is there for the first one of
    the second day, because absences count the hours of the harvest.
    """
    days = WorkDays(WorkShift(begin="08:00", end="16:00"), homing_seconds=3600.0)
    scenario = four_pickers(picker_least_per_day=100.0)
    ill = scenario.model_copy(update={"picker_absences": {"picker_02": [[8.0, 16.0]]}})
    # 28 bins at 2 an hour take 14 h: two days, and one picker gets the least of the first one.
    paid = payments_of_harvest(ill, 28, 2.0, days)
    assert paid["picker_least"] == pytest.approx((3 * 200.0 + 100.0) / 28)


def test_rain_that_lasts_longer_than_a_limit_costs_nothing() -> None:
    """The limit without traffic may be shorter than the rain in the morning. A search for the
    fewest robots asks what its harvest costs.
    """
    scenario = four_pickers(picker_per_hour=10.0, picker_least_per_day=100.0)
    away = {f"picker_{number:02}": [[0.0, 3.0]] for number in range(1, 5)}
    rainy = scenario.model_copy(update={"picker_absences": away})
    assert payments_of_harvest(rainy, 4, 2.0, EIGHT_HOURS) == {}


def test_a_piece_rate_falls_to_those_that_are_there() -> None:
    """24 bins at 3 an hour take 8 h. One of 4 pickers is away for half of the day, so
    3.5 days fill 24 bins: 48 / 7 each, and it half of that.

    At 14 a bin they earn 96 and 48. At least 110 a day are paid: 14 and 62 more.
    """
    prices = {"picker_per_bin": 14.0, "picker_least_per_day": 110.0}
    scenario = four_pickers(**prices)
    late = scenario.model_copy(update={"picker_absences": {"picker_02": [[0.0, 4.0]]}})
    paid = payments_of_harvest(late, 24, 3.0, EIGHT_HOURS)
    assert paid["picker_bins"] == pytest.approx(14.0)
    assert paid["picker_least"] == pytest.approx((3 * 14.0 + 62.0) / 24)


MISTAKES = [
    (
        "prices: {carrier_per_day: 80}",
        "prices.carrier_per_day = 80.0, shift.begin = None, shift.end = None: a price for a day"
        " needs a day: set shift.begin and shift.end",
    ),
    (
        "prices: {carrier_bought: {price: 9000}}",
        "prices.carrier_bought.price = 9000.0, prices.carrier_bought.years = None: a price needs"
        " years and hours_per_year, by which it is paid",
    ),
    (
        "prices: {picker_bought: {years: 8}}",
        "prices.picker_bought.years = 8.0, prices.picker_bought.hours_per_year = None: must be set"
        " together",
    ),
    (
        'picking_rate: 1.5\nshift: {begin: "08:00", end: "16:00"}\n'
        "prices: {picker_per_bin: 10, picker_least_per_day: 200}",
        "prices.picker_per_bin = 10.0, prices.picker_least_per_day = 200.0: has no effect: at 1.5"
        " bins an hour a day of 8 h earns at most 120, and 200 is paid anyway",
    ),
]


@pytest.mark.parametrize(("text", "words"), MISTAKES)
def test_prices_that_cannot_be_are_told(text: str, words: str) -> None:
    with pytest.raises(ScenarioError) as error:
        parse(text, "my.yaml")
    (line,) = str(error.value).splitlines()
    assert words in line


@pytest.mark.parametrize(
    "faster",
    [
        "picker_rates: {picker_01: 3}",
        "picking: {spread: {distribution: gamma, cv: 0.3}}",
        "picking: {spread_of_pickers: {distribution: gamma, cv: 0.3}}",
    ],
)
def test_a_piece_rate_that_one_picker_may_earn_has_an_effect(faster: str) -> None:
    text = (
        'picking_rate: 6\nshift: {begin: "08:00", end: "11:00"}\n'
        f"prices: {{picker_per_bin: 10, picker_least_per_day: 200}}\n{faster}"
    )
    assert parse(text, "my.yaml").prices.picker_least_per_day == 200.0
