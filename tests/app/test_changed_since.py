"""What has changed in the form since a study was asked."""

from orchard.app.changed_since import changed_settings, changed_values, changed_words
from orchard.app.study_run import StudySettings
from orchard.field.scenario import Scenario

ASKED = Scenario(rows=12, pickers=6)


def test_another_orchard_is_named_by_its_labels():
    """Numbers of carriers are what the study varies: "Set the form" changes them."""
    now = Scenario(rows=26, pickers=10, carriers=3)
    assert changed_values(ASKED, now, {"carriers"}) == ["Rows", "Pickers"]
    assert changed_values(ASKED, now, {"carriers", "pickers"}) == ["Rows"]
    assert changed_words(changed_values(ASKED, ASKED, {"carriers"})) == ""


def test_another_question_is_named_but_not_more_time():
    asked = StudySettings()
    assert changed_settings(asked, StudySettings(budget="60")) == []
    now = StudySettings(deadline="2", deadline_unit="d", dispatch=("nearest",))
    assert changed_settings(asked, now) == ["Done within", "Dispatch policies"]


def test_many_changes_are_counted():
    words = changed_words(["Rows", "Row length", "Yield", "Pickers", "Seed", "Dogs"])
    assert words == (
        "Changed since this was asked: Rows, Row length, Yield, Pickers and 2 more."
        " Ask again for what is entered now."
    )
