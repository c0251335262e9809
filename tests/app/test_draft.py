"""The draft of a scenario, without a browser.

A draft is what the page's form holds: values as they are typed, and the scenario that they make. It
has no scenario while it has problems, each at its field.
"""

from copy import copy

import pytest
from made_surveys import UNEQUAL, orchard_of

from orchard.app.draft import Draft, title_of
from orchard.app.entries import LABELS, entries, flat
from orchard.field.scenario import DISPATCH_POLICIES, Scenario, with_changes


def test_the_page_asks_for_every_value_of_a_scenario():
    assert list(entries()) == list(flat(Scenario()))
    changed = Scenario(rows=7, carriers=3)
    assert with_changes(Scenario(), **flat(changed)) == changed


def test_limits_and_steps_come_from_the_schema():
    """The schema of the scenario has the limits and units that the page shows."""
    rows = entries()["rows"]
    assert rows.low == 3
    assert rows.high == 100
    assert rows.step == 1
    assert rows.limits == "3 to 100"

    # A slider has a hundred steps where the value is no whole number.
    noise = entries()["laser.noise"]
    assert noise.step == 0.0002
    assert noise.limits == "0 to 0.02 m"
    assert noise.label == "Laser noise"

    assert not entries()["seed"].has_slider, "a browser's numbers do not hold a large seed"


def test_labels_are_words_of_a_reader():
    assert LABELS.keys() <= entries().keys(), "no label is left of a value that has gone"
    scenario = with_changes(Scenario(), **{"sensors.gnss.white": 0.01, "dispatch_errors": "end"})
    assert title_of(scenario).endswith(
        "seed 1, GNSS error of a tick 0.01, after a refused order end"
    )


# What is typed as the spacing of rows, and words of the message.
NO_NUMBERS = {"abc": "from 3.65 to 12.5", "": "number", "1e999": "to 12.5"}
# What is typed in some fields, one after the other; field -> words of the message that then stands
# there.
WRONG_FIELDS = [
    ({"rows": 101.0}, {"rows": "from 3 to 100"}),
    ({"rows": 5.5}, {"rows": "a whole number"}),
    ({"rows": None}, {"rows": "a whole number"}),
    ({"pickers": 6.0}, {"pickers": "one picker a row", "rows": "one picker a row"}),
    (
        {"people.workers": 30.0, "people.visitors": 30.0},
        {"people.workers": "at most 50 together", "people.visitors": "at most 50"},
    ),
    ({"seed": "many"}, {"seed": "a whole number"}),
    ({"seed": "9223372036854775808"}, {"seed": "to 9223372036854775807"}),
    ({"rows": 2.0, "laser.noise": 1.0}, {"rows": "from 3", "laser.noise": "to 0.02"}),
    *(({"row_width": typed}, {"row_width": words}) for typed, words in NO_NUMBERS.items()),
]


def test_a_rule_about_several_values_names_them_by_their_labels():
    """Someone at the form does not know `people.workers`, the name in a file."""
    draft = Draft(Scenario())
    draft.enter({"people.workers": 30, "people.visitors": 30})
    problem = draft.problems["people.workers"]
    assert problem.startswith("Workers = 30, Visitors = 30: ")


def test_a_comma_is_a_decimal_sign_as_a_point_is():
    for typed in ("85.5", "85,5", " 85,50 ", "855e-1"):
        draft = Draft(Scenario())
        draft.enter({"row_length": typed})
        assert draft.scenario == Scenario(row_length=85.5), typed
    draft.enter({"prices.per_bin": "0,125"})
    assert draft.scenario.prices.per_bin == 0.125, "a thousand is never written 0,125"


def test_a_comma_that_may_part_thousands_is_refused():
    """The message names both meanings, and advises those that the field allows."""
    draft = Draft(Scenario())
    draft.enter({"prices.per_bin": "1,250", "crop.kilograms_per_bin": "1,250", "rows": "5,500"})
    assert draft.scenario is None
    problems = draft.problems
    assert problems["prices.per_bin"].endswith("; 1,250 may mean 1.25 or 1250: write 1.25 or 1250")
    assert problems["crop.kilograms_per_bin"].endswith("; 1,250 may mean 1.25 or 1250: write 1250")
    assert "may mean" not in problems["rows"], "neither 5.5 nor 5500 rows are allowed"


def test_each_message_begins_with_the_label_of_its_field():
    """The label stands once in a message, and no key of a scenario file does."""
    draft = Draft(Scenario())
    draft.enter({"row_length": "long", "picking.failure.mean_between": "1", "seed": "-1"})
    assert draft.problems == {
        "row_length": "Row length: must be a number from 20 to 400 m",
        "picking.failure.mean_between": (
            "Time between failures: must be a number from 60 to 86400 s, or tick “never”"
        ),
        "seed": "Seed: must be a whole number from 0 to 9223372036854775807",
    }
    draft = Draft(Scenario())
    draft.enter({"chargers": "0", "carrying.battery.hours": "3"})
    problem = draft.problems["chargers"]
    assert problem.startswith("Chargers = 0, Hours of a battery = 3: must be 1 to 120 chargers")
    assert problem.endswith("without chargers, “Hours of a battery” must be “endless”")


@pytest.mark.parametrize(("changes", "words"), WRONG_FIELDS)
def test_what_is_wrong_is_told_at_its_field(changes, words):
    draft = Draft(Scenario())
    for path, value in changes.items():
        draft.enter({path: value})
    assert draft.scenario is None
    assert draft.problems.keys() == words.keys()
    for path, part in words.items():
        assert part in draft.problems[path]


def test_a_large_seed_keeps_every_digit():
    draft = Draft(Scenario())
    draft.enter({"seed": " 9223372036854775807 "})
    assert draft.scenario == Scenario(seed=2**63 - 1)


def test_the_classes_of_a_scenario_survive_changes():
    draft = Draft(Scenario(agents={"picker": "tests.support.own_agents.Eastward"}))
    draft.enter({"rows": "7"})
    assert draft.scenario == Scenario(
        rows=7, agents={"picker": "tests.support.own_agents.Eastward"}
    )
    draft.drop_classes()
    assert draft.scenario == Scenario(rows=7)


def test_a_survey_survives_changes_of_other_values():
    """Rows that are surveyed keep their number and spacing, which the form cannot change."""
    surveyed = orchard_of(UNEQUAL, agents={"picker": "tests.support.own_agents.Eastward"})
    draft = Draft(surveyed)
    draft.enter({"seed": "7"})
    draft.drop_classes()
    assert draft.scenario == orchard_of(UNEQUAL, seed=7)
    assert "surveyed rows" in title_of(draft.scenario)
    draft.enter({"rows": "7"})
    assert draft.scenario is None
    assert draft.problems == {"rows": "Rows: must be 4 with this survey"}
    draft.enter({"rows": "4", "row_width": 4.0})
    assert draft.problems == {
        "row_width": "Spacing of rows: is as surveyed, and cannot be changed here"
    }


def test_built_in_rules_are_chosen_beside_a_class_of_a_file():
    """The class that a file names stays one of the choices, until it is dropped."""
    assert entries()["dispatch"].choices == DISPATCH_POLICIES
    own = "examples.seams.farthest_first.FarthestFirst"
    draft = Draft(Scenario(dispatch=own))
    assert draft.classes == {"dispatch": own}
    assert draft.scenario == Scenario(dispatch=own)
    draft.enter({"dispatch": "predictive"})
    assert draft.classes == {}
    assert draft.scenario == Scenario(dispatch="predictive")
    draft.enter({"dispatch": own})
    draft.drop_classes()
    assert draft.scenario == Scenario()


def test_a_class_for_a_robot_that_is_gone_is_told():
    draft = Draft(Scenario(pickers=3, agents={"picker_03": "tests.support.own_agents.Eastward"}))
    assert draft.scenario is not None
    draft.enter({"pickers": "2"})
    assert draft.scenario is None
    assert "agents.picker_03: no such agent or kind" in draft.problems["agents"]


def test_the_title_of_a_scenario_names_what_is_not_the_default():
    assert title_of(Scenario(carriers=1)) == "5 rows, 2 pickers, 1 carrier, seed 1"
    changed = with_changes(
        Scenario(rows=7, agents={"picker": "a.B"}), tractor=False, **{"laser.noise": 0.01}
    )
    assert title_of(changed) == (
        "7 rows, 2 pickers, 2 carriers, seed 1, tractor off, laser noise 0.01, own classes"
    )


def test_a_copy_of_a_draft_has_its_values():
    draft = Draft(Scenario(rows=7, agents={"picker": "a.B"}))
    assert copy(draft).values == draft.values


def test_a_rule_about_several_fields_is_told_once():
    """The other fields refer to the one that tells it. All of them are wrong."""
    draft = Draft(Scenario())
    draft.enter({"shift.begin": "7:00", "shift.end": "16:00", "shift.breaks": "6:00-6:30"})
    told = draft.told
    assert draft.problems.keys() == told.keys() == {"shift.begin", "shift.end", "shift.breaks"}
    assert "the break from 06:00 to 06:30 must lie inside the day" in told["shift.breaks"]
    assert told["shift.begin"] == told["shift.end"] == "See “Breaks”."
