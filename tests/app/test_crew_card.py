"""The card of the crew: who is away and how fast each is, as people say it."""

from urllib.parse import parse_qsl

import pytest

from orchard.app.draft import Draft, title_of
from orchard.app.entries import entries, words_of
from orchard.app.link import draft_of, query_of
from orchard.app.past_runs import differences
from orchard.field.scenario import Scenario

AWAY = "picker 8: 0-4.5 h; picker 2: 17-25.5 h"
ABSENCES = {"picker_02": [[17.0, 25.5]], "picker_08": [[0.0, 4.5]]}


@pytest.fixture
def draft():
    """Return a draft of 8 pickers who fill 1.5 bins an hour each."""
    return Draft(Scenario(rows=26, pickers=8, picking_rate=1.5, bins_per_row=6))


# What is typed, and the absences that it means.
ABSENT = [
    (AWAY, ABSENCES),
    ("Picker_08: from 0 to 4,5 hours; 2: 17 \u2013 25,5", ABSENCES),
    ("picker 3: 1-2, 4-5.5 and 8-9", {"picker_03": [[1.0, 2.0], [4.0, 5.5], [8.0, 9.0]]}),
    (" ", {}),
]


@pytest.mark.parametrize(("typed", "absences"), ABSENT)
def test_who_is_away_is_entered_as_people_say_it(draft, typed, absences):
    draft.enter({"picker_absences": typed})
    assert draft.problems == {}
    assert draft.scenario.picker_absences == absences


def test_how_fast_each_is_is_a_share_or_percent(draft):
    draft.enter({"picker_rates": "picker 1: 0,5; picker 3: 120 %"})
    assert draft.scenario.picker_rates == {"picker_01": 0.5, "picker_03": 1.2}


# The field, what is typed there, and words of the message.
WRONG = [
    ("picker_absences", "picker 8", "Who is away: must be pickers and the hours of work"),
    ("picker_absences", "picker 8: 9-4", "such as picker 8: 0-4.5 h"),
    ("picker_absences", "picker 8: 0-2500", "0 to 2000"),
    ("picker_absences", "8: 0-1,250", "Who is away: must be pickers and"),
    ("picker_absences", "8: 0-1; 8: 2-3", "30-31 h"),
    ("picker_absences", "picker 9: 0-1", "Who is away: must be pickers that there are"),
    ("picker_rates", "one is slow", "How fast each is: must be pickers and their shares"),
    ("picker_rates", "picker 1: 30", "How fast each is: must be a number from 0.05 to 20"),
]


@pytest.mark.parametrize(("field", "typed", "words"), WRONG)
def test_a_wrong_crew_is_told_at_its_field(draft, field, typed, words):
    draft.enter({field: typed})
    assert draft.scenario is None
    assert words in draft.problems[field]
    assert "[[" not in draft.problems[field], "nobody types brackets here"


def test_a_crew_is_shown_as_it_was_entered(draft):
    draft.enter({"picker_absences": AWAY, "picker_rates": "1: 50 %"})
    shown = entries()["picker_absences"].as_typed(draft.scenario.picker_absences)
    assert shown == "picker 2: 17-25.5 h; picker 8: 0-4.5 h"
    assert title_of(draft.scenario).endswith(f"is picker 1: 0.5, who is away {shown}")
    assert words_of("picker_rates", {}) == "none"


def test_a_link_holds_a_crew(draft):
    draft.enter({"picker_absences": AWAY, "picker_rates": "1: 50 %"})
    linked, unknown = draft_of(parse_qsl(query_of(draft.scenario)))
    assert unknown == []
    assert linked.scenario == draft.scenario


def test_a_picker_that_leaves_the_field_leaves_the_orchard():
    """A file's map of pickers is replaced by what is entered, not added to it."""
    draft = Draft(Scenario(picker_absences=dict(picker_01=[[0, 1]], picker_02=[[2, 3]])))
    draft.enter({"picker_absences": "picker 2: 2-3"})
    assert draft.scenario.picker_absences == {"picker_02": [[2.0, 3.0]]}


def test_crews_that_differ_are_told_of_two_runs(draft):
    whole = draft.scenario
    draft.enter({"picker_rates": "1: 50 %"})
    assert differences([whole, draft.scenario]) == {"How fast each is": ["none", "picker 1: 0.5"]}
