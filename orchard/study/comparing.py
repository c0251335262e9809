"""What replications on common seeds tell of settings: by how much the best is ahead of each, and
whether that is worth anything.

A setting is *equal* to the best if the whole interval of its paired difference is smaller than what
is worth it, *worse* if the whole interval is larger, and *unknown* else: too few runs are no
equality. The intervals are Student's. Bonferroni's rule shares 1 - confidence among the settings
and the LOOKS, so all of them hold together, at whichever look a study ends. An unknown setting is
no longer undecided when its difference is known to half of what is worth it: one on the very edge
would take runs for ever, and either word is as good.

A setting is *worse* too if its limit without traffic is behind the best mean by what is worth it.
No run exceeds the limit, so more runs could tell nothing else.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

# `scipy.stats` takes a second to load.
from scipy import special

from orchard.study.result import Interval, Standing

# Replications of each setting, after which a study asks whether it can answer.
LOOKS = (5, 10, 20, 40, 80)


def interval(values: Sequence[float], confidence: float) -> Interval:
    """Return the mean with its t interval.

    Of one value, or if all are the same, low and high are the mean.
    """
    count = len(values)
    mean = float(np.mean(values))
    if count < 2 or np.ptp(values) == 0.0:
        return Interval(mean=mean, low=mean, high=mean)
    half = _half(float(np.std(values, ddof=1)), count, 1.0 - confidence)
    return Interval(mean=mean, low=mean - half, high=mean + half)


def _half(deviation: float, count: int, error: float) -> float:
    """Return half the width of a t interval."""
    return float(special.stdtrit(count - 1, 1.0 - error / 2.0)) * deviation / math.sqrt(count)


@dataclass(frozen=True)
class Comparison:
    """Settings beside the one with the best mean, all on the same seeds."""

    #: Of replications of each setting.
    count: int
    #: A lead below this share is worth nothing.
    within: float
    confidence: float
    #: The chance of each interval not to hold the truth.
    error: float
    #: Of each setting; as few as possible are wanted.
    robots: Mapping[int, int]
    #: By setting, the lead of the best mean, as a share of the setting's own mean.
    ahead: Mapping[int, float]
    #: The same with its interval; None: the runs do not tell.
    leads: Mapping[int, Interval | None]
    #: The setting with the best mean.
    top: int
    #: Settings that cannot be the best: even their limit is behind the best mean by `within`.
    limited: Collection[int] = ()

    @cached_property
    def best(self) -> int:
        """The answer: of those that are as good as the best mean, one with the fewest robots."""
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
        """The setting that is next to the answer, if there is one."""
        others = sorted(self.ahead.keys() - {self.best})
        others.sort(key=self._distance)
        return others[:1]

    def _distance(self, i: int) -> float:
        """Return by how much the lead over a setting differs from that over the answer."""
        return abs(self.ahead[i] - self.ahead[self.best])

    def standing(self, i: int) -> Standing:
        """Return how a setting stands beside the best mean."""
        if i in self.limited:
            return "worse"
        if i == self.top:
            # Of the best mean itself nothing is certain while one run is all that there is.
            has_lead = self.leads[self.best] is not None
            return "equal" if has_lead else "unknown"
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
        """Whether a setting may still be the answer, and more runs would tell."""
        may_be_best = self.robots[i] <= self.robots[self.best] or lead.low <= -self.within
        return may_be_best and not self._decides(lead, self.count)

    def replications_needed(self) -> int | None:
        """Return the look at which what is undecided will be decided, if the runs so far tell.

        None: it is later than the last one.
        """
        leads = [self.leads[i] for i in self.undecided]
        for look in LOOKS:
            if look > self.count and all(self._decides(lead, look) for lead in leads):
                return look
        return None

    def _decides(self, lead: Interval | None, look: int) -> bool:
        """Whether so many replications tell whether a lead is worth something.

        They do too if they know it to half of `within`, as one interval alone.
        """
        if lead is None:
            return True
        deviation = (lead.high - lead.mean) / _half(1.0, self.count, self.error)
        tells = deviation * _half(1.0, look, self.error) < abs(lead.mean - self.within)
        return tells or deviation * _half(1.0, look, 1.0 - self.confidence) <= self.within / 2.0


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
    """Compare settings by their values on the same seeds, as many of each.

    `without_chance`: those of which all seeds give the same. `limits`: the best mean that a setting
    can have, as far as that is known. `intervals`: of all comparisons of a study, which hold
    together; None: this is the only one.

    Leads that are the same on all seeds have no spread. They tell as much as signs do, by the sign
    test: 2 / 2**n must be small.
    """
    sign = 1.0 if is_max else -1.0
    top = max(samples, key=lambda i: sign * float(np.mean(samples[i])))
    error = (1.0 - confidence) / len(LOOKS) / max(1, intervals or len(samples) - 1)
    leads: dict[int, Interval | None] = {}
    ahead: dict[int, float] = {}
    for i, values in samples.items():
        # The mean is 0 of costs without prices.
        size = abs(float(np.mean(values))) or 1.0
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
