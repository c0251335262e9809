"""What maps that vary leave out stays as the scenario has it, and a note says so."""

from orchard.field.scenario import Scenario, with_changes
from orchard.study.kept_values import notes_on_kept_values

SLOW = Scenario(rows=8, pickers=4, picker_rates={"picker_01": 0.5})
PAID = Scenario(prices={"picker_per_bin": 15.0, "overhead_per_hour": 35.0})


def test_a_slow_picker_of_the_scenario_stays_slow():
    """`picker_rates={"picker_02": 0.5}` makes two of them slow, if the scenario has one."""
    varied = {"picker_rates": [{}, {"picker_02": 0.5}]}
    assert with_changes(SLOW, picker_rates={"picker_02": 0.5}).picker_rates == {
        "picker_01": 0.5,
        "picker_02": 0.5,
    }
    assert notes_on_kept_values(varied, SLOW) == [
        "picker_rates: what a value leaves out stays as the scenario has it: picker_01 0.5; {}"
        " takes all of it out"
    ]


def test_prices_that_a_value_leaves_out_are_paid_too():
    varied = {"prices": [{"picker_per_hour": 30}, {"picker_per_bin": 20}]}
    (note,) = notes_on_kept_values(varied, PAID)
    assert note.startswith(
        "prices: what a value leaves out stays as the scenario has it: overhead_per_hour 35.0,"
        " picker_per_bin 15.0; to take it out"
    )


def test_values_that_say_all_have_no_note():
    said = {"picker_per_bin": None, "overhead_per_hour": 35, "picker_per_hour": 30}
    assert notes_on_kept_values({"prices": [said]}, PAID) == []
    assert notes_on_kept_values({"carriers": [1, 2]}, PAID) == []
    assert notes_on_kept_values({"picker_rates": [{}, {"picker_02": 0.5}]}, Scenario()) == []
    assert notes_on_kept_values({"picker_rates.picker_02": [0.5, 1.0]}, SLOW) == []
