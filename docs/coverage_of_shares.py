"""How often the intervals of a sensitivity hold the true shares, in samples with known ones.

A sensitivity says which share of the variance of a result comes from each value that it moves, and
which from the luck of the seed. Here results are made up, so that these shares are known.

`python -m docs.coverage_of_shares` prints what docs/study.md says of them, in half a minute.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from orchard.study.result import Interval
from orchard.study.sensitivity.factors import Factor
from orchard.study.sensitivity.surrogate import RUNS_OF_A_POINT, Shares, design, shares_of

SAMPLES = 60  # of each case
POINTS = 32  # of a sample
CONFIDENCE = 0.95
FACTORS = [Factor(key=key, low=-1.0, high=1.0) for key in ("a", "b", "c")]
STEP_AT = 0.3
# An interval of no width holds a share that is as large but for its last bits.
ROUNDING = 1e-9


@dataclass(frozen=True)
class Case:
    """A result of three values a, b and c from -1 to 1, and what is true of it."""

    name: str
    result: Callable[[float, float, float], float]
    #: The standard deviation of the luck, and its share of all variance.
    deviation: float
    luck: float
    #: The share of each value, of all variance.
    totals: Sequence[float]


def _of_luck(variance: float, share: float) -> float:
    """Return the standard deviation of a luck that is this share of all, beside this variance."""
    return float(np.sqrt(variance * share / (1.0 - share)))


# A value drawn evenly from -1 to 1 has the variance 1/3. So a + b / 2 has 1/3 + 1/12 = 5/12, of
# which a has 4/5; a + b + a * b has 1/3 + 1/3 + 1/9 = 7/9, of which a has 4/7, its part of the
# product included; and a step that is 1 with the chance 0.35 has 0.65 * 0.35. The rest is luck.
CASES = [
    Case("luck alone", lambda a, b, c: 0.0, 1.0, 1.0, (0.0, 0.0, 0.0)),
    Case("a sum", lambda a, b, c: a + 0.5 * b, _of_luck(5 / 12, 0.23), 0.23, (0.616, 0.154, 0.0)),
    Case(
        "a product", lambda a, b, c: a + b + a * b, _of_luck(7 / 9, 0.23), 0.23, (0.44, 0.44, 0.0)
    ),
    Case(
        "a step",
        lambda a, b, c: float(a > STEP_AT),
        _of_luck(0.65 * 0.35, 0.02),
        0.02,
        (0.98, 0.0, 0.0),
    ),
]


def _sample(case: Case, seed: int) -> Shares:
    """Return what one sample tells."""
    points = design(len(FACTORS), POINTS, seed)
    random = np.random.default_rng([seed, 99])
    results = []
    for a, b, c in 2.0 * points - 1.0:
        luck = case.deviation * random.standard_normal(RUNS_OF_A_POINT)
        results.append(list(100.0 + case.result(a, b, c) + luck))
    shares = shares_of(FACTORS, points, results, CONFIDENCE, seed)
    assert shares is not None
    return shares


def _holds(interval: Interval, true: float) -> bool:
    return interval.low - ROUNDING <= true <= interval.high + ROUNDING


def main() -> None:
    """Print how often each interval held the true share."""
    for case in CASES:
        luck = 0
        totals = np.zeros(len(FACTORS))
        for seed in range(SAMPLES):
            shares = _sample(case, seed)
            luck += _holds(shares.luck, case.luck)
            for number, true in enumerate(case.totals):
                totals[number] += _holds(shares.total[number], true)
        of_values = ", ".join(f"{share:.0%}" for share in totals / SAMPLES)
        print(f"{case.name}: luck {luck / SAMPLES:.0%}, values {of_values}")


if __name__ == "__main__":
    main()
