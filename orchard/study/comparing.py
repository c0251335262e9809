"""Compares settings by their replications on common seeds: how far is the best mean ahead of each,
and is that more than `within`, the difference below which settings count as equally good?

The lead over a setting is the mean of the differences on the same seeds, as a share of the
setting's own mean. A setting is *equal* if the whole interval of the lead is below `within`,
*worse* if the whole interval is above it, and *unknown* otherwise, because there are too few runs.

The intervals are Student's. A study looks at them up to len(LOOKS) times, for several settings. By
Bonferroni's rule each look and each setting gets a part of 1 - confidence. So all intervals hold
together, at whichever look a study ends.

A setting is *undecided* if it is unknown and more runs may show that it is the answer. It is no
longer undecided when its lead is known to half of `within`: a lead very near to `within` would take
runs for ever, and it does not matter then which setting is the answer.

A setting is also *worse* if its limit without traffic is behind the best mean by `within`. No run
exceeds the limit, so more runs could not change that.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

# Not `scipy.stats`, which takes a second to load.
from scipy import special

from orchard.study.result import Interval, Standing

# Replications of each setting, after which a study asks whether it can answer.
LOOKS = (5, 10, 20, 40, 80)


def interval(values: Sequence[float], confidence: float) -> Interval:
    """Return the mean with its t interval. With one value, or equal ones, it has no width."""
    count = len(values)
    mean = float(np.mean(values))
    if count < 2 or np.ptp(values) == 0.0:
        return Interval(mean=mean, low=mean, high=mean)
    half = _half(float(np.std(values, ddof=1)), count, 1.0 - confidence)
    return Interval(mean=mean, low=mean - half, high=mean + half)


def _half(deviation: float, count: int, error: float) -> float:
    """Return half the width of a t interval.

    `deviation`: standard deviation of the `count` values. `error`: the chance that the interval
    does not contain the true mean.
    """
    return float(special.stdtrit(count - 1, 1.0 - error / 2.0)) * deviation / math.sqrt(count)


@dataclass(frozen=True)
class Comparison:
    """Settings beside the one with the best mean, all on the same seeds."""

    #: How many replications each setting has.
    count: int
    #: A share: with a smaller lead settings count as equally good.
    within: float
    confidence: float
    #: The chance of each interval not to contain the true lead.
    error: float
    #: Setting -> how many robots it has; of settings that are equally good the fewest are wanted.
    robots: Mapping[int, int]
    #: Setting -> the lead of the best mean over it, as a share of the setting's own mean.
    ahead: Mapping[int, float]
    #: Setting -> the lead with its interval; None: too few runs for an interval.
    leads: Mapping[int, Interval | None]
    #: The setting with the best mean.
    top: int
    #: Settings that cannot be the best: even their limit is behind the best mean by `within`.
    limited: Collection[int] = ()

    @cached_property
    def best(self) -> int:
        """The answer: of the settings that are as good as the best mean, the one with the fewest
        robots, and of several of these the one with the best mean.
        """
        near = []
        for i, lead in self.ahead.items():
            if lead < self.within and i not in self.limited:
                near.append(i)
        return min(near, key=self._robots_and_lead)

    def _robots_and_lead(self, i: int) -> tuple[int, float]:
        """Return how many robots a setting has, and how far it is behind the best mean."""
        return self.robots[i], self.ahead[i]

    @property
    def runner_up(self) -> list[int]:
        """The setting whose mean is nearest to that of the answer, as a list; [] without one."""
        others = sorted(self.ahead.keys() - {self.best})
        others.sort(key=self._distance)
        return others[:1]

    def _distance(self, i: int) -> float:
        """Return how far the mean of a setting is from that of the answer, as a share."""
        return abs(self.ahead[i] - self.ahead[self.best])

    def standing(self, i: int) -> Standing:
        """Return how a setting stands beside the best mean."""
        if i in self.limited:
            return "worse"
        if i == self.top:
            # With one run of each, another setting may be the best as well.
            if self.leads[self.best] is None:
                return "unknown"
            return "equal"
        lead = self.leads[i]
        if lead is None:
            return "unknown"
        if -self.within < lead.low and lead.high < self.within:
            return "equal"
        if lead.low >= self.within:
            return "worse"
        return "unknown"

    @property
    def undecided(self) -> list[int]:
        """The settings that more runs may show to be the answer, the likeliest first."""
        undecided = []
        for i, lead in self.leads.items():
            is_open = lead is None or self._is_open(i, lead)
            if is_open and self.standing(i) == "unknown":
                undecided.append(i)
        return sorted(undecided, key=lambda i: self.ahead[i])

    def _is_open(self, i: int, lead: Interval) -> bool:
        """Whether a setting may still be the answer, and more runs would tell.

        With more robots than the answer it must be better than the best mean by `within`.
        """
        may_be_best = self.robots[i] <= self.robots[self.best] or lead.low <= -self.within
        return may_be_best and not self._decides(lead, self.count)

    def replications_needed(self) -> int | None:
        """Return after how many replications (a value of LOOKS) all will be decided, if the spread
        of the runs stays as it is. None: even the last look is too early.
        """
        leads = [self.leads[i] for i in self.undecided]
        for look in LOOKS:
            if look > self.count and all(self._decides(lead, look) for lead in leads):
                return look
        return None

    def _decides(self, lead: Interval | None, look: int) -> bool:
        """Whether `look` replications tell on which side of `within` a lead is.

        They also decide if they know it to half of `within`, in an interval that need hold only by
        itself.
        """
        if lead is None:
            # Nothing is known of its spread, so the next look is worth trying.
            return True
        # The standard deviation of the differences, from half of the interval.
        deviation = (lead.high - lead.mean) / _half(1.0, self.count, self.error)
        # Half of the interval after `look` replications: of one that holds with all others, and of
        # one that need hold only by itself.
        half_with_others = deviation * _half(1.0, look, self.error)
        half_alone = deviation * _half(1.0, look, 1.0 - self.confidence)
        is_on_one_side = half_with_others < abs(lead.mean - self.within)
        return is_on_one_side or half_alone <= self.within / 2.0


def compare(
    samples: Mapping[int, Sequence[float]],
    robots: Mapping[int, int],
    is_max: bool,
    confidence: float,
    within: float,
    *,
    without_chance: Collection[int] = (),
    limits: Mapping[int, float] | None = None,
    intervals: int | None = None,
) -> Comparison:
    """Compare settings by their values on the same seeds.

    `samples`: setting -> its value with each seed, as many for each setting. `robots`: as of a
    Comparison. `is_max`: whether larger values are better. `without_chance`: settings with which
    all seeds give the same value. `limits`: setting -> the best mean that it can have, if known.
    `intervals`: how many intervals all comparisons of a study have together, which must all hold;
    None: this is the only comparison.

    Differences that are the same on all seeds have no spread, and so no t interval. Then they count
    by the sign test: the chance of n equal signs, 2 / 2**n, must be small enough.
    """
    # So that larger is better.
    sign = -1.0
    if is_max:
        sign = 1.0
    top = max(samples, key=lambda i: sign * float(np.mean(samples[i])))
    # By Bonferroni's rule, for each look and each interval.
    error = (1.0 - confidence) / len(LOOKS) / max(1, intervals or len(samples) - 1)
    leads: dict[int, Interval | None] = {}
    ahead: dict[int, float] = {}
    for i, values in samples.items():
        # Where all prices are 0 the mean cost is 0.
        size = abs(float(np.mean(values))) or 1.0
        # How much better the best mean's setting was with each seed, (seeds,).
        differences = sign * np.subtract(samples[top], values) / size
        have_no_chance = {i, top} <= set(without_chance)
        are_enough = 2.0 ** (1 - len(values)) <= error
        is_sure = i == top or have_no_chance or are_enough
        ahead[i] = float(np.mean(differences))
        leads[i] = None
        if is_sure or np.ptp(differences) > 0.0:
            leads[i] = interval(differences.tolist(), 1.0 - error)
    best_mean = float(np.mean(samples[top]))
    limited = []
    for i, limit in (limits or {}).items():
        if i != top and sign * (best_mean - limit) >= within * abs(limit):
            limited.append(i)
    return Comparison(
        count=len(samples[top]),
        within=within,
        confidence=confidence,
        error=error,
        robots=robots,
        ahead=ahead,
        leads=leads,
        top=top,
        limited=limited,
    )
