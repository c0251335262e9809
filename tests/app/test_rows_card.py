"""The card for someone who has rows: spacing, yield and bins, and what they come to."""

import pytest

from orchard.app.conversion import conversion_words
from orchard.app.draft import Draft, title_of
from orchard.app.entries import entries, words_of
from orchard.app.link import draft_of, query_of
from orchard.field.scenario import Scenario, other_ways
from orchard.field.survey import row_width_of, spacing_of

# What a grower types in the card: 20 rows of 90 m, 4.5 m apart; 40 t of fruit a hectare, 350 kg in
# a bin; 6 people who fill 1.5 bins an hour each.
GROWER = {
    "rows": "20",
    "row_length": "90",
    "row_width": row_width_of(4.5),
    "crop.tonnes_per_hectare": "40",
    "crop.kilograms_per_bin": "350",
    "pickers": "6",
    "picking_rate": "1,5",
}


@pytest.fixture
def grower():
    """Return the draft into which the grower has typed."""
    draft = Draft(Scenario())
    draft.enter(GROWER)
    return draft


@pytest.mark.parametrize("spacing", [3.65, 3.66, 4.5, 4.57, 5.5, 12.5])
def test_a_spacing_is_a_width_and_the_trees(spacing):
    """Spacing is measured from trunk to trunk, the width of a scenario between the trees."""
    assert spacing_of(row_width_of(spacing)) == pytest.approx(spacing, abs=1e-9)
    assert Scenario(row_width=row_width_of(spacing)).row_pitch == pytest.approx(spacing)


def test_the_page_has_spacing_where_the_scenario_has_a_width():
    """The spacing is the width of a row and 0.5 m, the thickness of the trees."""
    entry = entries()["row_width"]
    assert entry.label == "Spacing of rows"
    assert entry.limits == "3.65 to 12.5 m, from tree to tree"
    assert entry.from_page(4.5) == 4.0
    assert entry.to_page(4.0) == 4.5
    assert entry.from_page("wide") == "wide", "a text stays as it was typed"
    assert words_of("row_width", 4.0) == "4.5"
    assert "spacing of rows 4.5" in title_of(Scenario(row_width=4.0))


def test_a_wrong_spacing_is_told_as_growers_measure_it():
    draft = Draft(Scenario())
    draft.enter({"row_width": entries()["row_width"].from_page(3.0)})
    wanted = "must be a number from 3.65 to 12.5 m, from tree to tree"
    assert draft.problems == {"row_width": f"Spacing of rows: {wanted}"}


def test_a_link_keeps_the_width_of_the_scenario():
    assert query_of(Scenario(row_width=4.0)) == "row_width=4"
    assert draft_of([("row_width", "4")])[0].scenario == Scenario(row_width=4.0)


def test_the_rows_of_a_grower_come_to_bins(grower):
    """90 m x 4.5 m x 4 kg a square metre are 1620 kg, which fill 4.63 bins of 350 kg.

    A bin is 90 m / 4.63 = 19.4 m of row, and 1.5 of them an hour are 29.2 m in 3,600 s.
    """
    assert grower.problems == {}
    assert conversion_words(grower.scenario) == (
        "4.63 bins a row, 92.6 in all: a bin fills in 19.4 m of row."
        " 6 pickers fill 9 bins an hour while they pick, and go 0.0081 m/s."
    )


def test_what_is_not_entered_is_said():
    words = conversion_words(Scenario())
    assert "Each row fills one bin, until you enter the yield" in words
    assert "the speed of a fast robot: people fill 1 to 2 bins an hour each" in words


def test_half_of_a_crop_asks_for_the_other_half():
    draft = Draft(Scenario())
    draft.enter({"crop.tonnes_per_hectare": "40"})
    message = "Yield = 40, Fruit in a bin = unknown: must be set together"
    assert draft.problems == dict.fromkeys(
        ("crop.tonnes_per_hectare", "crop.kilograms_per_bin"), message
    )


def test_the_last_of_several_ways_to_say_it_counts(grower):
    """Bins a row replace the crop, and a speed the rate: each says what the other is."""
    grower.enter({"bins_per_row": "3"})
    assert grower.scenario.crop.tonnes_per_hectare is None
    assert grower.scenario.chosen["bins_per_row"] == 3.0
    grower.enter({"picking_speed": "0,01"})
    assert grower.scenario.picking_rate is None
    assert other_ways("rows") == []


def test_two_ways_in_one_link_stay_a_problem():
    draft, _ = draft_of([("bins_per_row", "3"), ("metres_per_bin", "20")])
    assert draft.problems.keys() == {"bins_per_row", "metres_per_bin"}
