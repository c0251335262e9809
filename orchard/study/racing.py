"""A race: replications for all settings, fewer and fewer of which are left, until the best is certain.

After 5, 10, 20, 40 and 80 replications, each with the same seeds for all settings, the race looks at all settings that are left. It
compares each with the one that has the best mean, by Student's paired t test. Those that are worse for certain leave the race.

The chance that the setting that is truly best leaves is at most 1 - confidence. It is spent in two steps. Each of the looks gets an
equal part of it, which is Bonferroni's rule: simple, and valid whatever the looks have in common. At each look Holm's rule corrects
for the number of comparisons. Five looks cost little: the t quantile of the last one, of 79 degrees of freedom, is 2.6 instead of 2.0.

If many settings are alike, the one with the best mean had luck. So its interval must be wider than that of a setting that was chosen
before: the intervals of all settings that are left hold together, by Bonferroni's rule.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from orchard.study.result import Verdict
from orchard.study.statistics import holm, interval, paired_p_value

LOOKS = (5, 10, 20, 40, 80)  # replications of each setting that is left
StoppedBy = Literal["certain", "within", "budget", "seeds", "stopped"]


@dataclass
class Race:
    """A race of settings, which are numbers from 0. Feed it with `look`, and ask what is `left`, and `why` it ended."""

    count: int
    is_max: bool  # whether more is better
    confidence: float
    within: float  # half the width of an interval, as a share of its mean, at which it is narrow enough
    without_chance: frozenset[int] = frozenset()  # settings of which all seeds give the same: a difference between two of them is certain
    left: list[int] = field(default_factory=list)
    out: dict[int, float] = field(default_factory=dict)  # setting that was told apart -> its corrected p-value at that look
    beaten_by: dict[int, int] = field(default_factory=dict)  # setting that was told apart -> the best one at that look
    jammed: list[int] = field(default_factory=list)
    best: int | None = None
    why: StoppedBy | None = None  # why the race is over; None: it goes on

    def __post_init__(self) -> None:
        self.left = list(range(self.count))

    @property
    def each(self) -> float:
        """The confidence of each setting's own interval, so that those of all that are left hold together with the race's confidence."""
        return 1.0 - (1.0 - self.confidence) / max(1, len(self.left))

    def jam(self, settings: Sequence[int]) -> None:
        """Take out settings in which a harvest has jammed: no figure would make up for it. What lost only to them is back in the race."""
        self.jammed += [i for i in settings if i in self.left]
        back = [i for i, best in self.beaten_by.items() if best in self.jammed and i in self.out]
        for i in back:
            del self.out[i]
        self.left = sorted([*(i for i in self.left if i not in self.jammed), *back])
        if not self.left:
            self.best, self.why = None, "certain"

    def look(self, samples: Mapping[int, Sequence[float]], is_last: bool = False) -> None:
        """Look at the goal's values of all settings that are left: by seed, the same seeds for all. `is_last`: no more can be had."""
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
        """The p-value, not corrected, that two settings are alike, on the seeds that both have."""
        if {one, other} <= self.without_chance:
            return 1.0 if samples[one][0] == samples[other][0] else 0.0
        common = min(len(samples[one]), len(samples[other]))
        return paired_p_value(samples[one][:common], samples[other][:common])

    def verdict(self, setting: int, samples: Mapping[int, Sequence[float]]) -> Verdict:
        """Compare a setting with the best one, on the seeds that both have. Of a race that goes on, it is what is known so far."""
        assert self.best is not None
        own, best = samples[setting], samples[self.best]
        common = min(len(own), len(best))
        differences = [a - b for a, b in zip(own[:common], best[:common], strict=True)]
        together = 1.0 - (1.0 - self.confidence) / len(LOOKS) / max(1, self.count - 1)
        p_value = self.out.get(setting, min(1.0, len(LOOKS) * (self.count - 1) * self._p_value(setting, self.best, samples)))
        return Verdict(difference=interval(differences, together), p_value=p_value, is_told_apart=setting in self.out)
