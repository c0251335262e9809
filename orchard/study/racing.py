"""A race: replications for all settings, fewer and fewer of which are left, until the best is certain.

At each of LOOKS, Student's paired t test compares each setting that is left with the best mean, on common seeds. What is worse for
certain leaves. The chance that the truly best leaves is at most 1 - confidence: Bonferroni's rule shares it among the looks, Holm's rule
corrects for the number of comparisons. The best mean of many had luck, so the intervals of all that are left hold together.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import special  # not stats, which takes a second to load, and a millisecond for each test

from orchard.study.result import Interval, StoppedBy, Verdict


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


LOOKS = (5, 10, 20, 40, 80)  # replications of each setting that is left


@dataclass
class Race:
    """A race of settings, which are numbers from 0. Feed it with `look`, and ask what is `left`, and `why` it ended."""

    count: int
    is_max: bool  # whether more is better
    confidence: float
    within: float  # half the width of an interval, as a share of its mean, at which it is narrow enough
    without_chance: frozenset[int] = frozenset()  # settings of which all seeds give the same
    left: list[int] = field(default_factory=list)
    out: dict[int, float] = field(default_factory=dict)  # setting told apart -> its corrected p-value then
    beaten_by: dict[int, int] = field(default_factory=dict)  # setting told apart -> the best one then
    jammed: list[int] = field(default_factory=list)
    best: int | None = None
    why: StoppedBy | None = None  # why the race is over; None: it goes on

    def __post_init__(self) -> None:
        self.left = list(range(self.count))

    @property
    def each(self) -> float:
        """The confidence of each setting's own interval, so that all that are left hold together."""
        return 1.0 - (1.0 - self.confidence) / max(1, len(self.left))

    def jam(self, settings: Sequence[int]) -> None:
        """Take out settings in which a harvest has jammed: nothing makes up for it. What lost only to them is back."""
        self.jammed += [i for i in settings if i in self.left]
        back = [i for i, best in self.beaten_by.items() if best in self.jammed and i in self.out]
        for i in back:
            del self.out[i]
        self.left = sorted([*(i for i in self.left if i not in self.jammed), *back])
        if not self.left:
            self.best, self.why = None, "certain"

    def look(self, samples: Mapping[int, Sequence[float]], is_last: bool = False) -> None:
        """Look at the goal's values of all settings that are left, on the same seeds. `is_last`: no more can be had."""
        if self.why is not None:
            return
        self.best = best = (max if self.is_max else min)(self.left, key=lambda i: sum(samples[i]) / len(samples[i]))
        others = [i for i in self.left if i != best]
        p_values = holm([self._p_value(i, best, samples) for i in others])
        for i, p_value in zip(others, p_values, strict=True):
            if p_value * len(LOOKS) <= 1.0 - self.confidence:
                self.out[i], self.beaten_by[i] = p_value * len(LOOKS), best
        self.left = [i for i in self.left if i not in self.out]
        self.why = self._why(samples, is_last)

    def _why(self, samples: Mapping[int, Sequence[float]], is_last: bool) -> StoppedBy | None:
        if len(self.left) == 1 < self.count:
            return "certain"
        if all(self._is_narrow(i, samples[i]) for i in self.left):
            return "within"
        return "seeds" if is_last else None

    def _is_narrow(self, setting: int, sample: Sequence[float]) -> bool:
        """Whether a setting's interval is narrow enough. Seeds that agree by chance tell nothing of its width."""
        one = interval(sample, self.each)
        return setting in self.without_chance or 0.0 < one.high - one.mean <= self.within * abs(one.mean)

    def _p_value(self, one: int, other: int, samples: Mapping[int, Sequence[float]]) -> float:
        if {one, other} <= self.without_chance:
            return 1.0 if samples[one][0] == samples[other][0] else 0.0
        common = min(len(samples[one]), len(samples[other]))
        return paired_p_value(samples[one][:common], samples[other][:common])

    def verdict(self, setting: int, samples: Mapping[int, Sequence[float]]) -> Verdict:
        """Compare a setting with the best one, on common seeds; while the race goes on, as far as is known."""
        assert self.best is not None
        own, best = samples[setting], samples[self.best]
        common = min(len(own), len(best))
        differences = [a - b for a, b in zip(own[:common], best[:common], strict=True)]
        together = 1.0 - (1.0 - self.confidence) / len(LOOKS) / max(1, self.count - 1)
        p_value = self.out.get(setting, min(1.0, len(LOOKS) * (self.count - 1) * self._p_value(setting, self.best, samples)))
        return Verdict(difference=interval(differences, together), p_value=p_value, is_told_apart=setting in self.out)
