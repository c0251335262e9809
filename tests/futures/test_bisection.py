"""The search for the moment of a decision, with futures that are made by hand.

A future is a run that goes on from a moment; from each moment several go on, with different draws.
The search halves the time between the last moment from which some future ends well, and the first
one from which none does. Moments are ticks.
"""

import pytest

from orchard.futures.bisection import NEAR, Bisection, badly, decision_words
from orchard.futures.comparison import difference_words

FIGURES = {"collisions": 0, "bins_per_hour": 30.0}


def future(ended="harvested", **figures):
    """Return the summary of a future that ended so."""
    return {**FIGURES, "sim_seconds": 600.0, **figures, "ended": ended}


def searched(decided, first, count=2):
    """Search where all futures from a tick after `decided` on jam.

    `first`: the moments whose futures are lived before the search. Return the search, and the
    moments whose futures were lived, in their order.
    """
    asked = []

    def live_at(tick):
        asked.append(tick)
        return [future("harvested" if tick <= decided else "jammed")] * count

    bisection = Bisection(live_at, badly("jam", FIGURES))
    bisection.lived = {tick: list(live_at(tick)) for tick in first}
    bisection.search()
    return bisection, asked


@pytest.mark.parametrize("decided", [0, 1, 599, 600, 601, 1194, 1199])
def test_the_last_good_moment_is_found_to_a_second(decided):
    """A second is NEAR, ten ticks."""
    bisection, asked = searched(decided, [0, 600, 1200])
    assert bisection.last_good <= decided < bisection.first_bad
    assert bisection.first_bad - bisection.last_good <= NEAR
    # The first three; and six halvings of 600 ticks leave less than NEAR. One more is allowed.
    assert len(asked) <= 3 + 7


def test_without_a_good_or_a_bad_moment_nothing_is_searched():
    for decided in (-1, 9999):
        bisection, asked = searched(decided, [0, 600])
        assert asked == [0, 600]
    assert bisection.first_bad is None


def test_the_answer_says_between_which_moments_it_is_decided():
    """600 ticks are 1:00 min. The last good moment is at 600, the first bad one at 605."""
    words = decision_words("jam", searched(600, [0, 600, 605])[0])
    assert words == (
        "jam: decided after 1:00: some of 2 futures end well from there, and none from 1:00.5."
    )
    words = decision_words("jam", searched(-1, [600])[0])
    assert words == "jam: decided before 1:00: none of 2 futures ends well."
    words = decision_words("jam", searched(600, [600], count=1)[0])
    assert words == "jam: not decided: the future ends well from 1:00, the last moment."


@pytest.mark.parametrize(
    ("condition", "figures", "is_bad"),
    [
        ("jam", {"ended": "jammed"}, True),
        ("jam", {"ended": "duration"}, False),
        ("collision", {"collisions": 1}, True),
        ("collision", {"ended": "jammed"}, False),
        ("bins_per_hour<20", {"bins_per_hour": 19.9}, True),
        ("bins_per_hour<20", {"bins_per_hour": 20.0}, False),
        ("bins_per_hour>20", {"bins_per_hour": 20.1}, True),
        ("bins_per_hour>40", {"ended": "jammed"}, True),
    ],
)
def test_a_future_ends_badly_by_its_condition(condition, figures, is_bad):
    assert badly(condition, FIGURES)(future(**figures)) is is_bad


def test_futures_are_compared_in_pairs_that_are_both_harvested():
    """Two pairs end 10 s earlier with the change. The third one does not count: a future jams."""
    before = [future(sim_seconds=600.0), future(sim_seconds=700.0), future("jammed")]
    changed = [future(sim_seconds=590.0), future(sim_seconds=690.0), future(sim_seconds=1.0)]
    assert difference_words("carriers=2", before, changed) == (
        "With carriers=2 the harvest ends 0:10 ± 0:00 min earlier "
        "(2 pairs of futures, 95 % confidence; 1 more are not harvested to their end)."
    )
    words = difference_words("carriers=2", changed[:1], before[:1])
    assert words.endswith("ends 0:10 ± 0:00 min later (one pair of futures).")
    assert "no pair" in difference_words("x", before[2:], changed[2:])
