"""The order in which the settings of a study run.

The ends of each range come first, then middles: so a study whose budget ends early has seen the
whole range. Next to it: which number lies beyond the end of a range.
"""

from itertools import product

import pytest

from orchard.study.spread import number_beyond, spread

# Values of a key as a user names them, and the order in which they run. Only numbers that rise have
# ends; None is a value of its own.
PLACES = [
    ([1], [1]),
    ([2, 3, 4, 5, 6, 8], [2, 8, 4, 3, 5, 6]),
    ([8, 2, 5], [8, 2, 5]),
    (["nearest", "rolling", "predictive"], ["nearest", "rolling", "predictive"]),
    ([1, 2, 3, None], [1, 3, None, 2]),
    ([False, True], [False, True]),
]


@pytest.mark.parametrize(("values", "order"), PLACES)
def test_the_ends_of_a_range_come_first(values: list, order: list) -> None:
    settings = [{"carriers": value} for value in values]
    assert [values[i] for i in spread({"carriers": values}, settings)] == order


def test_corners_of_two_ranges_come_first_then_middles() -> None:
    """After the corners come the middles of the edges and the middle of all."""
    varied = {"pickers": [2, 3, 4, 5, 6, 7, 8], "carriers": [1, 2, 3, 4, 5]}
    settings = [dict(zip(varied, pair, strict=True)) for pair in product(*varied.values())]
    order = [tuple(settings[i].values()) for i in spread(varied, settings)]
    assert order[:4] == [(2, 1), (2, 5), (8, 1), (8, 5)]
    assert set(order[4:9]) == {(2, 3), (5, 1), (5, 3), (5, 5), (8, 3)}
    assert sorted(order) == sorted(map(tuple, product(*varied.values())))


def test_each_value_that_is_no_number_has_its_own_corners() -> None:
    varied: dict[str, list] = {
        "dispatch": ["nearest", "rolling", "mine.Own"],
        "carriers": [1, 2, 3],
    }
    settings = [dict(zip(varied, pair, strict=True)) for pair in product(*varied.values())]
    first = [tuple(settings[i].values()) for i in spread(varied, settings)][:6]
    assert first == [(name, n) for name in varied["dispatch"] for n in (1, 3)]


# The values that were tried, the best of them, and the number beyond it; None: it is at no end of a
# range, or no number.
BEYOND = [
    ([1, 2], 2, 3),
    ([2, 3, 4, 5, 6, 8], 8, 9),
    ([2, 4], 2, 0),
    ([1, 2, 3], 2, None),
    ([1], 1, None),
    ([None, 2], 2, None),
    ([False, True], True, None),
    (["a", "b"], "b", None),
]


@pytest.mark.parametrize(("values", "value", "beyond"), BEYOND)
def test_only_an_end_of_a_range_has_a_number_beyond(
    values: list, value: object, beyond: object
) -> None:
    assert number_beyond(values, value) == beyond
