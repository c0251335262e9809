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

import numpy as np
from scipy import special  # not stats, which takes a second to load

from orchard.study.result import Interval, Standing

# Replications of each setting, after which a study asks whether it can answer.
LOOKS = (5, 10, 20, 40, 80)


def interval(values: Sequence[float], confidence: float) -> Interval:
    """Return the mean with its t interval.

    Of one value, or if all are the same, low and high are the mean.
    """
    count, mean = len(values), float(np.mean(values))
    if count < 2 or np.ptp(values) == 0.0:
        return Interval(mean=mean, low=mean, high=mean)
    half = _half(float(np.std(values, ddof=1)), count, 1.0 - confidence)
    return Interval(mean=mean, low=mean - half, high=mean + half)


def _half(deviation: float, count: int, error: float) -> float:
    """Half the width of a t interval."""
    return float(special.stdtrit(count - 1, 1.0 - error / 2.0)) * deviation / math.sqrt(count)


@dataclass(frozen=True)
class Comparison:
    """Settings beside the one with the best mean, all on the same seeds."""

    count: int  # of replications of each setting
    within: float  # a lead below this share is worth nothing
    confidence: float
    error: float  # the chance that one of the intervals does not hold the truth, of each
    robots: Mapping[int, int]  # of each setting: as few as possible
    ahead: Mapping[int, float]  # the lead of the best mean, as a share of the setting's own mean
    leads: Mapping[int, Interval | None]  # with its interval; None: the runs do not tell
    top: int  # the setting with the best mean
    #: Those with a limit that is behind the best mean by what is worth it.
    limited: Collection[int] = ()

    @property
    def best(self) -> int:
        """The answer: of those that are as good as the best mean, one with the fewest robots."""
        return min(
            (i for i, lead in self.ahead.items() if lead < self.within and i not in self.limited),
            key=lambda i: (self.robots[i], self.ahead[i]),
        )

    @property
    def runner_up(self) -> list[int]:
        """The setting that is next to the answer, if there is one."""
        return sorted(
            self.ahead.keys() - {self.best},
            key=lambda i: (abs(self.ahead[i] - self.ahead[self.best]), i),
        )[:1]

    def standing(self, i: int) -> Standing:
        # Of the best mean itself nothing is certain while one run is all that there is.
        lead = self.leads[self.best if i == self.top else i]
        if i in self.limited:
            return "worse"
        if lead is None:
            return "unknown"
        if i == self.top:
            return "equal"
        if -self.within < lead.low and lead.high < self.within:
            return "equal"
        return "worse" if lead.low >= self.within else "unknown"

    @property
    def undecided(self) -> list[int]:
        """The settings that more runs may show to be the answer, the likeliest first."""
        unknown = [
            i
            for i, lead in self.leads.items()
            if self.standing(i) == "unknown" and (lead is None or self._is_open(i, lead))
        ]
        return sorted(unknown, key=lambda i: self.ahead[i])

    def _is_open(self, i: int, lead: Interval) -> bool:
        may_be_best = self.robots[i] <= self.robots[self.best] or lead.low <= -self.within
        return may_be_best and not self._decides(lead, self.count)

    def replications_needed(self) -> int | None:
        """Return the look at which what is undecided will be decided, if the runs so far tell;
        None: later than the last one.
        """
        looks = [look for look in LOOKS if look > self.count]
        return next(
            (
                look
                for look in looks
                if all(self._decides(self.leads[i], look) for i in self.undecided)
            ),
            None,
        )

    def _decides(self, lead: Interval | None, look: int) -> bool:
        """Whether so many replications tell a lead from what is worth it, or each alone knows it to
        half of that.
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
        differences = (
            sign * np.subtract(samples[top], values) / (abs(float(np.mean(values))) or 1.0)
        )  # 0: costs, without prices
        is_sure = i == top or {i, top} <= set(without_chance) or 2.0 ** (1 - len(values)) <= error
        ahead[i] = float(np.mean(differences))
        leads[i] = (
            interval(differences.tolist(), 1.0 - error)
            if is_sure or np.ptp(differences) > 0.0
            else None
        )
    best_mean = float(np.mean(samples[top]))
    limited = [
        i
        for i, limit in (limits or {}).items()
        if i != top and sign * (best_mean - limit) >= within * abs(limit)
    ]
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
