"""The statistics of a study: t intervals of means and of paired differences, and Holm's correction for many comparisons."""

import math
from collections.abc import Sequence

import numpy as np
from scipy import special  # not stats, which takes a second to load, and a millisecond for each test

from orchard.study.result import Interval


def interval(values: Sequence[float], confidence: float) -> Interval:
    """Return the mean with its t interval. Of one value, or if all are the same, low and high are the mean."""
    count, mean = len(values), float(np.mean(values))
    if count < 2 or np.ptp(values) == 0.0:
        return Interval(mean=mean, low=mean, high=mean)
    half = float(special.stdtrit(count - 1, 0.5 + confidence / 2.0)) * float(np.std(values, ddof=1)) / math.sqrt(count)
    return Interval(mean=mean, low=mean - half, high=mean + half)


def paired_p_value(ones: Sequence[float], others: Sequence[float]) -> float:
    """Return the p-value, two-sided, of Student's paired t test that both have the same mean.

    Differences that are all the same have no spread to compare with. Then it is the sign test's: 1 if they are zero, else 2 / 2**n.
    """
    differences = np.subtract(ones, others)
    if np.ptp(differences) == 0.0:
        return 1.0 if differences[0] == 0.0 else float(2.0 ** (1 - len(differences)))
    t = np.mean(differences) / np.std(differences, ddof=1) * math.sqrt(len(differences))
    return float(2.0 * special.stdtr(len(differences) - 1, -abs(t)))


def holm(p_values: Sequence[float]) -> list[float]:
    """Return the p-values, corrected for their number by Holm's step-down rule (Holm, Scand. J. Statist. 6, 1979, 65-70)."""
    adjusted, before = [0.0] * len(p_values), 0.0
    for rank, i in enumerate(sorted(range(len(p_values)), key=lambda i: p_values[i])):
        before = adjusted[i] = max(before, min(1.0, (len(p_values) - rank) * p_values[i]))
    return adjusted
