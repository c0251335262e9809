"""Compares settings by their replications on common seeds: how far is the best mean ahead of each,
and is that more than `within`, the difference below which settings count as equally good?

The lead over a setting is the difference of the two means, as a share of the setting's own mean. A
setting is *equal* if the whole interval of the lead is below `within`, *worse* if the whole
interval is above it, and *unknown* otherwise, because there are too few runs.

The lead is the ratio of two means, less 1, and each of the two has luck in it. So an interval
follows from the residuals: on each seed the value of the best mean's setting, less the ratio times
the other value. Their mean is 0.

The intervals are Student's, wider where the residuals are skewed: then few runs may miss what is
rare, and Student's interval ends too early on the side of the long tail. N. J. Johnson says by how
much (Modified t Tests and Confidence Intervals for Asymmetrical Populations, Journal of the
American Statistical Association 73, 1978, pages 536 to 544). Here both ends move outward by that.
The interval of a setting's own figure is of the same kind (`interval`).

A study looks at the intervals up to len(LOOKS) times. The best mean is that of the same runs, so
the interval of each pair of settings may be one that counts. By Bonferroni's rule each look and
each pair gets a part of 1 - confidence. So all intervals hold together, at whichever look a study
ends. `examples/interval_coverage.py` measures how often they do.

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

# Replications of each setting, after which a study asks whether it can answer. After five of them
# an interval of skewed values would miss the truth up to 18 times as often as it may.
LOOKS = (10, 20, 40, 80)
# A share. Residuals that differ by less have no spread: that is rounding.
ROUNDING = 1e-12


@dataclass(frozen=True)
class SampleSpread:
    """How values spread around their mean.

    Those of a lead are its residuals, as a share of the setting's own mean.
    """

    deviation: float
    skewness: float

    @classmethod
    def of(cls, residuals: np.ndarray) -> "SampleSpread":
        """Return the spread of values less their mean, (seeds,). They are not all alike."""
        # As a share of the largest one, so that no power is too small for a float.
        shares = residuals / np.max(np.abs(residuals))
        root_of_mean_square = math.sqrt(float(np.mean(shares**2)))
        skewness = float(np.mean(shares**3)) / root_of_mean_square**3
        return cls(deviation=float(np.std(residuals, ddof=1)), skewness=skewness)

    def half(self, count: int, error: float) -> float:
        """Return half the width of the interval of the mean after `count` replications.

        `error`: the chance that the interval does not contain the true mean.
        """
        quantile = _quantile(count, error)
        # Johnson's correction of Student's statistic, solved for the end on the long tail's side.
        further = abs(self.skewness) * (1.0 + 2.0 * quantile**2) / (6.0 * math.sqrt(count))
        return (quantile + further) * self.deviation / math.sqrt(count)

    def half_of_student(self, count: int, error: float) -> float:
        """Return half the width of Student's interval after `count` replications."""
        return _quantile(count, error) * self.deviation / math.sqrt(count)


def _quantile(count: int, error: float) -> float:
    """Return how many standard errors a t interval of `count` values reaches to each side."""
    return float(special.stdtrit(count - 1, 1.0 - error / 2.0))


def interval(values: Sequence[float], confidence: float) -> Interval:
    """Return the mean with its interval. With one value, or equal ones, it has no width."""
    count = len(values)
    mean = float(np.mean(values))
    if count < 2 or np.ptp(values) == 0.0:
        return Interval(mean=mean, low=mean, high=mean)
    half = SampleSpread.of(np.subtract(values, mean)).half(count, 1.0 - confidence)
    return Interval(mean=mean, low=mean - half, high=mean + half)


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
    #: Setting -> the lead with its interval; None: too few runs for an interval. One that chance
    #: could change, but that was the same on so many seeds that it counts, has no width.
    leads: Mapping[int, Interval | None]
    #: Setting -> how its lead spreads. Leads without a width are not here.
    spreads: Mapping[int, SampleSpread]
    #: The setting with the best mean.
    top: int
    #: Settings that cannot be the best: even their limit is behind the best mean by `within`.
    limited: Collection[int] = ()
    #: Settings of which the lead was the same on all seeds by luck: its interval is unknown.
    agreeing: Collection[int] = ()

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

    def interval_shown(self, i: int) -> Interval | None:
        """Return the lead over a setting with its interval; None if the runs do not tell one.

        What chance could change has no interval as long as all seeds agree: they may miss what is
        rare, such as a failure.
        """
        if i in self.agreeing:
            return None
        return self.leads[i]

    @property
    def undecided(self) -> list[int]:
        """The settings that more runs may show to be the answer, the likeliest first."""
        undecided = []
        for i, lead in self.leads.items():
            is_open = lead is None or self._is_open(i, lead)
            if is_open and self.standing(i) == "unknown":
                undecided.append(i)
        return sorted(undecided, key=lambda i: self.ahead[i])

    @property
    def on_the_edge(self) -> list[int]:
        """The settings that may be the answer, too, but are so near to the edge of what counts that
        more runs are not worth it.
        """
        undecided = self.undecided
        near = []
        for i in self.leads:
            is_decided = i == self.best or i in undecided or self.standing(i) != "unknown"
            if not is_decided and self.robots[i] <= self.robots[self.best]:
                near.append(i)
        return near

    def _is_open(self, i: int, lead: Interval) -> bool:
        """Whether a setting may still be the answer, and more runs would tell.

        With more robots than the answer it must be better than the best mean by `within`.
        """
        may_be_best = self.robots[i] <= self.robots[self.best] or lead.low <= -self.within
        return may_be_best and not self._decides(i, self.count)

    def replications_needed(self) -> int | None:
        """Return after how many replications (a value of LOOKS) all will be decided, if the spread
        of the runs stays as it is. None: even the last look is too early.
        """
        undecided = self.undecided
        for look in LOOKS:
            if look > self.count and all(self._decides(i, look) for i in undecided):
                return look
        return None

    def _decides(self, i: int, look: int) -> bool:
        """Whether `look` replications tell on which side of `within` the lead over a setting is.

        They also decide if they know it to half of `within`, in an interval that need hold only by
        itself.
        """
        spread = self.spreads.get(i)
        if spread is None:
            # Nothing is known of it, so the next look is worth trying; or all of it is known.
            return True
        is_on_one_side = spread.half(look, self.error) < abs(self.ahead[i] - self.within)
        half_alone = spread.half_of_student(look, 1.0 - self.confidence)
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
    pairs: int | None = None,
) -> Comparison:
    """Compare settings by their values on the same seeds.

    `samples`: setting -> its value with each seed, as many for each setting. `robots`: as of a
    Comparison. `is_max`: whether larger values are better. `without_chance`: settings with which
    all seeds give the same value. `limits`: setting -> the best mean that it can have, if known.
    `pairs`: how many pairs of settings all comparisons of a study have together, of which the
    intervals must all hold; None: this is the only comparison.

    Leads that are the same on all seeds have no spread, and so no t interval. Then they count by
    the sign test: the chance of n equal signs, 2 / 2**n, must be small enough.
    """
    # So that larger is better.
    sign = -1.0
    if is_max:
        sign = 1.0
    top = max(samples, key=lambda i: sign * float(np.mean(samples[i])))
    # By Bonferroni's rule, for each look and each pair.
    error = (1.0 - confidence) / len(LOOKS) / max(1, pairs or math.comb(len(samples), 2))
    leads: dict[int, Interval | None] = {}
    ahead: dict[int, float] = {}
    spreads: dict[int, SampleSpread] = {}
    agreeing = []
    for i, values in samples.items():
        lead, residuals = _lead(samples[top], values)
        lead *= sign
        ahead[i] = lead
        leads[i] = Interval(mean=lead, low=lead, high=lead)
        if i == top or {i, top} <= set(without_chance):
            continue
        if np.ptp(residuals) > ROUNDING:
            spreads[i] = SampleSpread.of(residuals)
            half = spreads[i].half(len(values), error)
            leads[i] = Interval(mean=lead, low=lead - half, high=lead + half)
        elif 2.0 ** (1 - len(values)) <= error:
            agreeing.append(i)
        else:
            leads[i] = None
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
        spreads=spreads,
        top=top,
        limited=limited,
        agreeing=agreeing,
    )


def _lead(best: Sequence[float], values: Sequence[float]) -> tuple[float, np.ndarray]:
    """Return by how much the mean of `best` exceeds that of the values of a setting on the same
    seeds, and the residuals on each seed, (seeds,); both as a share of the setting's own mean.
    """
    mean = float(np.mean(values))
    best_mean = float(np.mean(best))
    if mean == 0.0:
        # Where all prices are 0 the mean cost is 0.
        return best_mean, np.subtract(best, values)
    ratio = best_mean / mean
    return (best_mean - mean) / abs(mean), np.subtract(best, np.multiply(ratio, values)) / abs(mean)
