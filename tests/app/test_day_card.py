"""The card of the day, and a deadline: times and breaks as they are typed, and what is asked."""

from urllib.parse import parse_qsl

import pytest

from orchard.app.command import Files
from orchard.app.draft import Draft, title_of
from orchard.app.entries import entries, words_of
from orchard.app.link import draft_of, query_of
from orchard.app.study_run import StudySettings, study_command
from orchard.app.study_view import answer_in_two
from orchard.field.scenario import Scenario

DAY = {
    "shift.begin": "7:00",
    "shift.end": "16:30",
    "shift.breaks": "10:00-10:15, 12:00 - 12:45",
}
BREAKS = (("10:00", "10:15"), ("12:00", "12:45"))


@pytest.fixture
def draft():
    return Draft(Scenario())


@pytest.fixture
def day(draft):
    """Return a draft with a working day and breaks."""
    draft.enter(DAY)
    return draft


def test_a_day_is_entered_as_people_write_it(day):
    """From 7:00 to 16:30 are 9.5 h, of which the breaks take 15 and 45 minutes."""
    assert day.problems == {}
    shift = day.scenario.shift
    assert shift.begin == "07:00"
    assert shift.end == "16:30"
    assert shift.breaks == BREAKS
    assert shift.work_seconds == (9.5 - 1.0) * 3600.0


def test_a_day_is_shown_as_it_was_entered(day):
    breaks = day.scenario.shift.breaks
    assert words_of("shift.breaks", breaks) == "10:00-10:15, 12:00-12:45"
    assert "work begins 07:00, work ends 16:30, breaks 10:00" in title_of(day.scenario)
    assert words_of("shift.begin", None) == "no days"


def test_a_link_holds_a_day(day):
    query = parse_qsl(query_of(day.scenario))
    linked, unknown = draft_of(query)
    assert unknown == []
    assert linked.scenario == day.scenario


def test_no_breaks_is_an_empty_field(day):
    day.enter({"shift.breaks": " "})
    assert day.scenario.shift.breaks == ()


# What is typed; the field at which a message then stands; words of it.
WRONG = [
    (
        {"shift.begin": "7 o'clock"},
        "shift.begin",
        "must be a time of day such as 7:00",
    ),
    ({"shift.begin": "25:00"}, "shift.begin", "tick “no days”"),
    ({"shift.end": ""}, "shift.end", "Work ends: must be a time of day such as 16:30"),
    (
        {"shift.end": "6:00"},
        "shift.begin",
        "Work ends = 06:00: must end after it begins",
    ),
    ({"shift.breaks": "at noon"}, "shift.breaks", "Breaks: must be begin and end of each break"),
    ({"shift.breaks": "10:00-25:00"}, "shift.breaks", "such as 10:00-10:15, 12:00-12:45"),
    (
        {"shift.breaks": "10:00-9:00"},
        "shift.breaks",
        "to 09:00 must end after it begins",
    ),
]


@pytest.mark.parametrize(("typed", "field", "words"), WRONG)
def test_a_wrong_day_is_told_at_its_field(day, typed, field, words):
    day.enter(typed)
    assert day.scenario is None
    assert field in day.problems, "the field where it can be mended"
    assert words in day.problems[field]


def test_a_price_of_a_day_asks_for_a_day(draft):
    draft.enter({"prices.carrier_per_day": "90"})
    assert draft.scenario is None
    assert set(draft.problems) & set(entries()), "a field that the page has"
    draft.enter(DAY)
    assert draft.problems == {}


# Deadlines: 7.5 hours of work, and the end of the second day.
HOURS = StudySettings(deadline="7,5")
DAYS = StudySettings(deadline="2", deadline_unit="d")


@pytest.mark.parametrize(
    ("settings", "option"),
    [(HOURS, ["--finish-within", "7.5h"]), (DAYS, ["--finish-by", "2d"])],
)
def test_a_deadline_opens_pickers_and_carriers(tmp_path, settings, option):
    command_line = study_command(Scenario(), settings, Files(tmp_path, "study"))
    # After the word `study` and the scenario's file.
    words = command_line[command_line.index("study") + 2 : command_line.index("--budget")]
    assert words == ["--vary", "carriers", "--vary", "pickers", *option]


# What is entered as the question of a study, and words of the message.
WRONG_DEADLINES = [
    ({"deadline": "soon"}, "Done within: must be a number from 0.1 to 10000 hours"),
    ({"deadline": "0"}, "Done within: must be a number"),
    ({"deadline": "1.5", "deadline_unit": "d"}, "Done within: must be a whole number of days"),
    ({"deadline": "0", "deadline_unit": "d"}, "Done within: must be a number from 1 to 1000 days"),
    ({"deadline": "8", "dispatch": ("nearest",)}, "leave these out"),
    ({"deadline": "8", "route": ("one-way",)}, "leave these out"),
    ({"budget": "0"}, "Time to take, s: must be a number from 1"),
]


@pytest.mark.parametrize(("entered", "words"), WRONG_DEADLINES)
def test_a_wrong_question_is_told_before_it_is_asked(entered, words):
    assert words in StudySettings(**entered).problem


def test_days_need_a_day(day):
    assert "enter when work begins and ends" in DAYS.problem_with(Scenario())
    assert DAYS.problem_with(day.scenario) == ""
    assert HOURS.problem_with(Scenario()) == ""


def test_the_fleet_and_its_time_are_shown_large():
    """The answer is split where its headline ends: at the first ", "."""
    answer = "7 pickers and 3 carriers finish in 7:41 ± 0:08 h, 19 of 20 harvests within 8 h. A: b."
    assert answer_in_two(answer, ", ") == (
        "7 pickers and 3 carriers finish in 7:41 ± 0:08 h",
        "19 of 20 harvests within 8 h. A: b.",
    )
