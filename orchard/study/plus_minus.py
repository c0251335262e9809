"""What the ± of a figure means, in words: how often the interval of a mean holds the truth.

Where robots fail often, all of a few harvests may be without a long repair, and then nothing in
their figures tells of one. How often the interval held there was measured by
`examples/interval_coverage.py`, in an orchard in which a robot works for six harvests until it
fails, and then stands for about as long as one takes.
"""

from collections.abc import Mapping, Sequence
from typing import Any

# Harvests of a setting -> how often an interval of 95 % held then, %. After more harvests than
# these it holds as often as it says.
HELD: Mapping[int, int] = {5: 81, 10: 86, 20: 94}


def plus_minus_words(confidence: float, harvests: int, do_robots_fail: bool) -> str:
    """Return what ± means, as a part of a sentence.

    `confidence`: 0 to 1. `harvests`: of each setting, at most; 0 for long runs, in which what is
    rare happens often enough. `do_robots_fail`: whether they may in any of these settings.
    """
    words = f"± interval of {100.0 * confidence:g} % confidence"
    if not do_robots_fail or not 0 < harvests < 2 * max(HELD):
        return words
    known = max([count for count in HELD if count <= harvests], default=min(HELD))
    return (
        f"{words}, but where robots fail often one of 95 % held in {HELD[known]} % after"
        f" {known} runs"
    )


def do_robots_fail(scenario: Mapping[str, Any], varied: Mapping[str, Sequence[Any]]) -> bool:
    """Whether robots may fail in a scenario, or in any of the settings that vary its values.

    `scenario`: its sections and values by their names.
    """
    for robots in ("picking", "carrying"):
        mean = scenario.get(robots, {}).get("failure", {}).get("mean_between")
        means = [mean, *varied.get(f"{robots}.failure.mean_between", [])]
        if means.count(None) < len(means):
            return True
    return False
