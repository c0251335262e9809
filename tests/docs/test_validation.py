"""Published figures beside ours: docs/validation.md, which docs/validation.py writes.

A figure is a share, %, or a rate. It has a published range, `low` to `high`, and agrees if ours is
near enough to it.
"""

import json
import re
from collections import Counter
from dataclasses import replace

import pytest

from docs.published import ENOUGH, FIGURES, SOURCES, gain_of_a_third
from docs.validation import MEASURED, agrees, document

SHARE = next(figure for figure in FIGURES if figure.is_share)
RATE = next(figure for figure in FIGURES if not figure.is_share)
FIGURE = {figure.quantity: figure for figure in FIGURES}


@pytest.mark.parametrize(
    # The published range, our figure, and whether it agrees.
    ("low", "high", "here", "expected"),
    [
        (20.0, 30.0, 15.5, True),
        (20.0, 30.0, 14.5, False),
        (20.0, 30.0, 25.0, True),
        (20.0, 30.0, 35.5, False),
    ],
)
def test_a_share_agrees_within_5_points(low, high, here, expected):
    """A share may be inside the published range, or up to 5 points beyond its nearer end."""
    assert agrees(here, replace(SHARE, low=low, high=high)) is expected


@pytest.mark.parametrize(
    ("low", "high", "here", "expected"),
    [
        (10.0, 15.0, 9.1, True),
        (10.0, 15.0, 8.9, False),
        (10.0, 15.0, 16.4, True),
        (10.0, 15.0, 16.6, False),
        (4.0, 4.0, 5.0, False),
    ],
)
def test_a_rate_agrees_within_a_tenth(low, high, here, expected):
    """Any other figure may be up to 10 % beyond the nearer end of the published range."""
    assert agrees(here, replace(RATE, low=low, high=high)) is expected


def test_each_figure_has_a_source_and_a_reason():
    assert [figure.quantity for figure in FIGURES if not figure.why] == []
    assert {figure.source for figure in FIGURES} == set(SOURCES)


def test_what_could_hardly_fail_does_not_count():
    """The page counts no line of its table that is fitted, could hardly fail, or is advice."""
    text = document()
    lines = [line for line in text.splitlines() if line.startswith("| ") and " | |" not in line]
    # Without the heading.
    figures = lines[1:]
    agreeing = [line for line in figures if "| agrees" in line]
    marked = Counter(re.findall(r"\| ([^|]*), does not count: ", text))
    # Fitted are the boxes of the forklift, and ten reactive robots, of which one run gives two
    # figures.
    assert marked == {"fitted": 3, "could hardly fail": 3, "advice": 1}
    counted = len(figures) - marked.total()
    assert f"**{len(agreeing)} of {counted} agree.**" in text
    assert f"{marked.total()} others stand in the table with a mark" in text


def test_bins_stand_beside_a_count_of_tractors():
    """A count of tractors says little.

    So the page has the bins that they bring, and the bins that people could pick.
    """
    rates = {}
    # Trailers an hour that so many tractors bring: the third one brings little.
    for carriers, trailers in ((1, 5.0), (2, 8.0), (3, 9.0), (4, 9.1)):
        rates[f"gangs 2013, {carriers}"] = trailers
    tractors = FIGURE["tractors for 40 people"]
    assert tractors.answer(rates) == 5.0
    # Nine trailers of three bins an hour. 0.6 trailers of each of 40 people would be 72 bins.
    assert "3 drive, and bring 27 of the 72 bins an hour" in tractors.explained(rates)


def test_a_third_tractor_brings_little():
    """The page says so: hardly another number of tractors could come out."""
    gain = gain_of_a_third(json.loads(MEASURED.read_text())["harvests"])
    assert gain < 100.0 * ENOUGH
    assert f"{gain:.1f} % more here" in " ".join(document().split())


def test_forklifts_and_trailers_have_one_published_range():
    """The source has one range for both, so the page writes it into both lines."""
    ranges = set()
    for quantity in ("t/h, forklift, 4 boxes", "t/h, trailer, 12 boxes"):
        ranges.add((FIGURE[quantity].low, FIGURE[quantity].high))
    assert ranges == {(5.13, 5.56)}
