"""The numbers of carriers that a study tries if it is told none: first those about the bound's, then more until the answer lies inside."""

from bisect import bisect_left
from collections.abc import Mapping, Sequence
from math import ceil
from types import MappingProxyType
from typing import Any

from orchard.field.layout import lay_out
from orchard.field.problems import ScenarioError
from orchard.field.queue import MOST_CARRIERS
from orchard.field.scenario import Scenario, with_changes
from orchard.report.bounds import Bounds
from orchard.study.settings import CARRIERS

ALL_IT_TAKES: Mapping[str, Sequence[Any]] = MappingProxyType({CARRIERS: ()})  # what varies if a study is told nothing
FEWER, MORE = 0.5, 1.5  # times the number in question, between which numbers are tried
STEPS = 4  # in which they come up to that number; those next to the answer follow


def most_carriers(scenario: Scenario) -> int:
    """Return for how many carriers the orchard has room."""
    return bisect_left(range(1, MOST_CARRIERS + 1), True, key=lambda number: not _has_room(scenario, number))


def _has_room(scenario: Scenario, carriers: int) -> bool:
    try:
        with_changes(scenario, carriers=carriers)
    except ScenarioError:
        return False
    return True


def is_open(varied: Mapping[str, Sequence[Any]]) -> bool:
    """Whether a study chooses the numbers of carriers itself."""
    return CARRIERS in varied and not varied[CARRIERS]


def numbered(scenario: Scenario, varied: Mapping[str, Sequence[Any]]) -> dict[str, list[Any]]:
    """Return what varies, with the numbers of carriers with which an open study begins."""
    return {key: list(values) or (first_numbers(scenario) if key == CARRIERS else []) for key, values in varied.items()}


def first_numbers(scenario: Scenario) -> list[int]:
    """Return the numbers to begin with: about that which keeps pickers and unloading busy if there is no traffic."""
    most = most_carriers(scenario)
    try:
        terms = Bounds(lay_out(with_changes(scenario, carriers=1))).terms
    except ScenarioError:  # of an own class, which is reported elsewhere
        return [scenario.carrier_count]
    busy = min(most, ceil(min(terms["pickers"], terms["unloading"]) / terms["carriers"]))
    step = max(1, busy // STEPS)
    return list(range(max(1, int(FEWER * busy)), min(most, ceil(MORE * busy) + step) + 1, step))


def more_numbers(tried: Sequence[int], answer: int, most: int) -> list[int]:
    """Return the numbers to try as well, so that the answer has its neighbours, and is no end of what was tried.

    Each halves the gap below the answer; the one above follows when there is no gap."""
    below = max((number for number in tried if number < answer), default=0)
    next_one = answer + 1 if answer - below == 1 else (below + answer) // 2
    wanted = {next_one, *range(max(tried), ceil(MORE * answer) + 1, max(1, answer // STEPS))}
    return sorted(number for number in wanted - set(tried) if 1 <= number <= most)
