"""A value that has an effect only with another one is refused while that one is not set."""

import pytest

from orchard.field.problems import ScenarioError
from orchard.field.scenario import Scenario, parse, with_changes
from orchard.launch.scenarios import scenario_of
from orchard.report.limits import limit_of_question

FAILURE = "mean_between: 300"
# A scenario with a value that has no effect, and one in which it has.
IN_VAIN = [
    ("carrying: {battery: {reserve: 0.5}}", "carrying: {battery: {reserve: 0.5, hours: 3}}"),
    ("carrying: {battery: {standing: 0.5}}", "carrying: {battery: {standing: 0.5, hours: 3}}"),
    (
        "carrying: {battery: {hours_to_charge: 3}}",
        "carrying: {battery: {hours_to_charge: 3, hours: 3}}",
    ),
    ("chargers: 3", "{chargers: 3, carrying: {battery: {hours: 3}}}"),
    (
        "carrying: {failure: {mean_repair: 60}}",
        f"carrying: {{failure: {{mean_repair: 60, {FAILURE}}}}}",
    ),
    (
        "picking: {failure: {mean_repair: 60}}",
        f"picking: {{failure: {{mean_repair: 60, {FAILURE}}}}}",
    ),
    (
        "picking: {spread: {cv: 0.2}}",
        "{picking_speed: 0.1, picking: {spread: {cv: 0.2, distribution: gamma}}}",
    ),
    ("order_in_row: outward", "{order_in_row: outward, bins_per_row: 3}"),
]


@pytest.mark.parametrize(("in_vain", "with_effect"), IN_VAIN)
def test_what_has_no_effect_is_refused_with_what_would_bring_it(in_vain, with_effect):
    with pytest.raises(ScenarioError, match="has no effect"):
        parse(in_vain)
    # The limit of a question leaves the spread out. It must leave out what belongs to it, too: else
    # that would have no effect, and be refused.
    assert limit_of_question(parse(with_effect)).bins_per_hour > 0.0


def test_defaults_and_no_chargers_may_be_written_down():
    parse("{chargers: 0, carrying: {battery: {reserve: 0.2, hours: null}}}")


@pytest.mark.parametrize(("in_vain", "with_effect"), IN_VAIN)
def test_settings_and_forks_may_take_away_what_a_value_needs(in_vain, with_effect):
    """A study may vary hours=null,8 where the file has a reserve, too. That is no mistake."""
    values = parse(with_effect).model_dump()
    without = {"carrying.battery.hours": None, "picking.spread.distribution": "none"}
    without |= {"carrying.failure.mean_between": None, "picking.failure.mean_between": None}
    without |= {"bins_per_row": None, "metres_per_bin": None}
    assert with_changes(Scenario(**values), **without).rows == 5


def test_an_order_in_rows_is_no_problem_beside_a_wrong_bin():
    with pytest.raises(ScenarioError) as error:
        parse("{order_in_row: outward, metres_per_bin: 5000}")
    assert [problem.path for problem in error.value.problems] == ["metres_per_bin"]


def test_options_that_have_no_effect_are_refused():
    with pytest.raises(ScenarioError, match=r"--chargers.*has no effect"):
        scenario_of(None, {"chargers": 3})
