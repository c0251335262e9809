"""The days of a harvest: which day and hour its time is, with breaks; and shifts that cannot be."""

import pytest

from orchard.field.problems import ScenarioError
from orchard.field.scenario import Scenario, WorkShift, parse, to_yaml
from orchard.local import Local
from orchard.report.days import WorkDays, work_days
from orchard.report.limits import limit_of_question
from orchard.report.metrics import HarvestFigures, harvest_figures

# From 07:00 to 16:30 are 9.5 h, of which 1 h are breaks.
SHIFT = WorkShift(begin="07:00", end="16:30", breaks=[["10:00", "10:15"], ["12:00", "12:45"]])
HOUR = 3600.0
# A time of work, s, and the day and hour at which it is reached.
TIMES = [
    (0.0, "day 1 at 07:00"),
    (2.0 * HOUR, "day 1 at 09:00"),
    # A break begins after 3 h, and another after 1:45 h more.
    (3.0 * HOUR, "day 1 at 10:00"),
    (3.5 * HOUR, "day 1 at 10:45"),
    (4.75 * HOUR, "day 1 at 12:00"),
    (5.0 * HOUR, "day 1 at 13:00"),
    (8.5 * HOUR, "day 1 at 16:30"),
    (9.5 * HOUR, "day 2 at 08:00"),
    (17.0 * HOUR, "day 2 at 16:30"),
]


@pytest.mark.parametrize(("seconds", "words"), TIMES)
def test_a_time_of_work_is_a_day_and_an_hour(seconds: float, words: str) -> None:
    assert WorkDays(SHIFT, 0.0).words(seconds) == words


def test_the_work_of_a_day_ends_before_carriers_must_be_home() -> None:
    """Only jobs that have begun are finished in the time of the longest job before the end."""
    scenario = Scenario(shift=SHIFT)
    bounds = limit_of_question(scenario)
    days = work_days(scenario, bounds)
    assert days is not None
    # The longest round of a carrier, s.
    longest = max(times.cycle for times in bounds.of_pickers.values())
    assert 10.0 < longest < HOUR
    assert days.day_seconds == 8.5 * HOUR - longest
    assert days.words(8.5 * HOUR - longest + 60.0) == "day 2 at 07:01"
    assert work_days(Scenario(), bounds) is None


def test_a_shift_is_written_and_read() -> None:
    scenario = Scenario(shift=SHIFT)
    assert parse(to_yaml(scenario)) == scenario


def test_a_run_tells_the_day_and_is_the_same_with_a_shift() -> None:
    """650 ticks are 65 s, one minute after the shift begins."""
    runs = [Local(Scenario(rows=3, shift=shift)) for shift in (SHIFT, WorkShift())]
    days = []
    for run in runs:
        figures = HarvestFigures()
        for _ in range(650):
            run.tick()
        days.append(harvest_figures(run.engine.world, figures)["working_day"])
    assert days == ["day 1 at 07:01", ""]
    assert runs[0].engine.hash == runs[1].engine.hash


# A scenario with a shift that cannot be, and what is said of it.
MISTAKES = [
    (
        'shift: {begin: "16:30", end: "07:00"}',
        "shift.begin = 16:30, shift.end = 07:00: must end after it begins, on the same day",
    ),
    ('shift: {begin: "07:00"}', "shift.end = None: must be set together"),
    (
        'shift: {begin: 7, end: "16:30"}',
        'shift.begin = 7: must be null or a time of day as "HH:MM"',
    ),
    ('shift: {begin: "7:00", end: "16:30"}', 'null or a time of day as "HH:MM"'),
    ('shift: {breaks: [["10:00", "10:15"]]}', "breaks need a day: set begin and end too"),
    (
        'shift: {begin: "07:00", end: "16:30", breaks: [["06:00", "06:15"]]}',
        "the break from 06:00 to 06:15 must lie inside the day, from 07:00 to 16:30",
    ),
    (
        'shift: {begin: "07:00", end: "16:30", breaks: [["10:15", "10:00"]]}',
        "the break from 10:15 to 10:00 must end after it begins",
    ),
    (
        'shift: {begin: "07:00", end: "16:30", breaks: [["10:00", "11:00"], ["10:30", "12:00"]]}',
        "the break from 10:30 must begin after the one before it has ended, at 11:00",
    ),
    (
        'shift: {begin: "07:00", end: "16:30", breaks: [["10:00"]]}',
        "a list of at most 10 pairs of times",
    ),
    ('shift: {begin: "07:00", end: "16:30", breaks: ["10:00"]}', "a list of at most 10 pairs"),
    ('shift: {begin: "07:00", end: "16:30", breaks: [[1, "10:15"]]}', "a list of at most 10 pairs"),
    (
        'shift: {begin: "07:00", end: "16:30", breaks: [["07:01", "16:29"]]}',
        "must leave at least 1 h of work beside the breaks",
    ),
]


@pytest.mark.parametrize(("text", "words"), MISTAKES)
def test_a_shift_that_cannot_be_is_told(text: str, words: str) -> None:
    with pytest.raises(ScenarioError) as error:
        parse(text, "my.yaml")
    (line,) = str(error.value).splitlines()
    assert line.startswith("my.yaml:1: shift")
    assert words in line
