"""The order in which the settings of a study run: the ends of each range first, then the middles.

A study that ends early then knows something of the whole range, and not all of one end.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any


def is_number(value: object) -> bool:
    """Whether a value of a setting is a number; True and False are none."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def spread(varied: Mapping[str, Sequence[Any]], settings: Sequence[Mapping[str, Any]]) -> list[int]:
    """Return the numbers of the settings in the order in which they run.

    Settings of which all values are ends of their ranges come first. Each further round halves the
    gaps of the rounds before. `varied`: key -> all its values. `settings`: each one's values by
    key.
    """
    # Key -> the round of each of its values.
    rounds_of_keys = {key: _rounds(values) for key, values in varied.items()}

    def place(number: int) -> tuple[int, int, int]:
        rounds = []
        for key, values in varied.items():
            value_number = list(values).index(settings[number][key])
            rounds.append(rounds_of_keys[key][value_number])
        # A setting runs in the latest round of its values, and there with the earliest others
        # first.
        return max(rounds, default=0), sum(rounds), number

    return sorted(range(len(settings)), key=place)


def _rounds(values: Sequence[Any]) -> list[int]:
    """Return for each value the first round in which it is tried: 0 for both ends of the range, and
    for a value that is no number.
    """
    rounds = [0] * len(values)
    # The places of the numbers among the values, from the least to the greatest number.
    in_order = [place for place, value in enumerate(values) if is_number(value)]
    in_order.sort(key=lambda place: values[place])
    # Pairs of places in `in_order`, between which no number has a round yet.
    gaps = [(0, len(in_order) - 1)]
    next_round = 1
    while gaps:
        smaller: list[tuple[int, int]] = []
        for first, last in gaps:
            if last - first > 1:
                middle = (first + last) // 2
                rounds[in_order[middle]] = next_round
                smaller += [(first, middle), (middle, last)]
        gaps = smaller
        next_round += 1
    return rounds


def number_beyond(values: Sequence[Any], value: Any) -> Any:
    """Return the number that would follow if a range went on beyond `value`, which is one of its
    ends.

    The step is the smallest one in the range. None: `value` lies inside the range, or the values
    are not at least two numbers.
    """
    if len(values) < 2 or not all(map(is_number, values)):
        return None
    numbers = sorted(values)
    step = min(after - before for before, after in pairwise(numbers))
    if value == numbers[-1]:
        return value + step
    if value == numbers[0]:
        return value - step
    return None
