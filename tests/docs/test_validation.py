"""Published figures beside ours: docs/validation.md."""

from dataclasses import replace

import pytest

from docs.published import FIGURES, SOURCES
from docs.validation import agrees, document

SHARE = next(figure for figure in FIGURES if figure.is_share)
RATE = next(figure for figure in FIGURES if not figure.is_share)


@pytest.mark.parametrize(
    ("low", "high", "here", "expected"),
    [
        (20.0, 30.0, 15.5, True),
        (20.0, 30.0, 14.5, False),
        (20.0, 30.0, 25.0, True),
        (20.0, 30.0, 35.5, False),
    ],
)
def test_a_share_agrees_within_5_points(low, high, here, expected):
    """A share agrees inside the published range, and up to 5 points beyond its nearer end."""
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
    """Another figure agrees up to 10 % beyond the nearer end of the published range."""
    assert agrees(here, replace(RATE, low=low, high=high)) is expected


def test_each_figure_has_a_source_and_a_reason():
    assert [figure.quantity for figure in FIGURES if not figure.why] == []
    assert {figure.source for figure in FIGURES} == set(SOURCES)


def test_a_fitted_figure_does_not_count():
    """The page counts each line of its table but those with a fitted value."""
    text = document()
    lines = [line for line in text.splitlines() if line.startswith("| ") and " | |" not in line]
    fitted = [line for line in lines if "fitted, does not count" in line]
    figures = lines[1:]  # without the heading
    agreeing = [line for line in figures if "| agrees" in line]
    # The boxes of the forklift, and ten reactive robots, of which one run gives two figures.
    assert len(fitted) == 3
    assert f"**{len(agreeing)} of {len(figures) - len(fitted)} agree.**" in text
