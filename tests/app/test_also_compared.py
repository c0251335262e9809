"""One more setting that a study of the page compares, and who is away while it is asked."""

import pytest

from orchard.app.also_compared import MOST_VALUES, comparable, values_of
from orchard.app.command import Files
from orchard.app.study_run import StudySettings, study_command
from orchard.field.scenario import Scenario

HAUL = Scenario(rows=12, load_out=dict(metres=500.0, speed=3.0, trailers=dict(count=2, bins=3)))
PEOPLE = StudySettings(compared="pickers", compared_values="4-6, 8")
TRAILERS = StudySettings(compared="load_out.trailers.count", compared_values="1 and 2")
SPACING = StudySettings(compared="row_width", compared_values="4,5; 5")


def options(settings, folder, scenario=HAUL):
    """Return what is compared in the command, after the scenario's file."""
    words = study_command(scenario, settings, Files(folder, "study"))
    return words[words.index("study") + 2 : words.index("--budget")]


@pytest.mark.parametrize(
    ("settings", "values"),
    [
        (PEOPLE, "pickers=4,5,6,8"),
        (TRAILERS, "load_out.trailers.count=1,2"),
        (SPACING, "row_width=4,4.5"),
        (StudySettings(compared="bay", compared_values="0, 12,5"), "bay=0,12.5"),
        (
            StudySettings(compared="rows_to_pickers", compared_values="balanced, balanced-times"),
            "rows_to_pickers=balanced,balanced-times",
        ),
    ],
)
def test_values_are_compared_as_a_user_would_type_it(tmp_path, settings, values):
    """Spacing is measured from tree to tree on the page, and between the trees in a scenario."""
    assert settings.problem_with(HAUL) == ""
    line = options(settings, tmp_path)
    assert line == ["--vary", "carriers", "--vary", values, "--horizon", "long"]


def test_people_of_a_range_may_have_a_deadline(tmp_path):
    settings = StudySettings(compared="pickers", compared_values="4-6", deadline="8")
    assert settings.problem_with(HAUL) == ""
    assert options(settings, tmp_path)[2:] == [
        "--vary",
        "pickers=4,5,6",
        "--finish-within",
        "8h",
    ]


# What is asked, and words of the message.
WRONG = [
    (dict(compared="pickers"), "Compare, too: enter the values to compare"),
    (dict(compared_values="4-8"), "Compare, too: choose which setting has these values"),
    (dict(compared="rows", compared_values="3-60"), "must be at most 40 values"),
    (
        dict(compared="pickers", compared_values="few"),
        "Compare, too: Pickers: must be a whole number from 2 to 60",
    ),
    (dict(compared="pickers", compared_values="8-4"), "Pickers: must be a whole number"),
    (dict(compared="pickers", compared_values="13"), "Pickers = 13, Rows = 12: "),
    (
        dict(compared="load_out.truck.bins", compared_values="12"),
        "Time between trucks = no truck, Bins on the truck = 12: must be set together",
    ),
    (
        dict(compared="load_out.trailers.count", compared_values="1-3", deadline="8"),
        "Done within: it compares people and carriers, and nothing else",
    ),
]


@pytest.mark.parametrize(("asked", "words"), WRONG)
def test_a_wrong_comparison_is_told_before_it_is_asked(asked, words):
    assert words in StudySettings(**asked).problem_with(HAUL)


def test_only_what_a_study_can_vary_is_offered():
    offered = comparable()
    assert offered["load_out.trailers.count"] == "Trailers at the bay"
    assert not offered.keys() & {"carriers", "seed", "shift.begin", "picker_absences", "tractor"}
    assert len(set(offered.values())) == len(offered), "no two settings have one label"
    assert len(values_of("rows", f"1-{MOST_VALUES}")) == MOST_VALUES


def test_nobody_is_away_in_the_long_run():
    away = Scenario(rows=12, picker_absences={"picker_01": [[0, 4]]})
    assert "Horizon: nobody is away in the long run" in StudySettings().problem_with(away)
    assert StudySettings(horizon="harvest").problem_with(away) == ""
    assert StudySettings(deadline="8").problem_with(away) == ""


@pytest.mark.parametrize(
    ("prices", "varied"),
    [
        ({}, ["carriers", "pickers"]),
        (dict(carrier_per_hour=14.0, picker_per_hour=28.0), ["carriers", "pickers"]),
        (dict(carrier_per_hour=14.0), ["carriers"]),
    ],
)
def test_people_without_a_price_keep_their_number(tmp_path, prices, varied):
    """By a deadline, the most people would be the cheapest if only carriers had a price."""
    grower = Scenario(rows=12, pickers=6, prices=prices)
    asked = StudySettings(deadline="18")
    assert asked.problem_with(grower) == ""
    words = options(asked, tmp_path, grower)
    assert [words[at + 1] for at, word in enumerate(words) if word == "--vary"] == varied


def test_a_price_that_is_missing_is_told_by_its_label():
    """Otherwise the command would refuse, in words of the command line."""
    wage_alone = Scenario(rows=12, prices=dict(picker_per_hour=28.0))
    assert StudySettings().problem_with(wage_alone).startswith("Price of a carrier: is compared")
    carriers_alone = Scenario(rows=12, prices=dict(carrier_per_hour=14.0))
    assert StudySettings().problem_with(carriers_alone) == ""
    assert PEOPLE.problem_with(carriers_alone).startswith("Price of a picker: is compared")
