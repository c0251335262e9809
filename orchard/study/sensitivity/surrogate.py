"""A quadratic fit to the results at some points, and the share of the variance that each value has.

A harvest takes long, and Sobol's effects need thousands of them. So a polynomial of the second
degree is fitted to the harvests at some points, and the effects are those of the polynomial. They
are computed from samples of it.

The variance of a run has three parts. The two runs of a point differ only in their seeds: the
variance between them is the luck of the seed. What the fit says of a point varies with the values:
that is their part. The means of the points differ from the fit by more than the seeds explain: that
is what the fit does not tell.

Names here: a place is a value as its position in its range, -1 to 1. A term is a product of places;
a slope is its factor in the polynomial. n points, f values (factors), t terms.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy import special

from orchard.study.result import Interval
from orchard.study.sensitivity.factors import Factor

if TYPE_CHECKING:
    from scipy.stats.qmc import QMCEngine

Array = npt.NDArray[np.float64]

# Samples of the polynomial, a power of two as Sobol's points need it, and resamples of the
# bootstrap.
SAMPLES = 1024
RESAMPLES = 400
# A fit needs so many points for each of its terms, at least.
POINTS_A_TERM = 1.5
# A square or a product stays in the fit if its slope is so many times as large as its error.
TELLS = 2.0
# The luck of the seed needs at least two runs that differ only in their seeds. The formulas below
# hold for two.
RUNS_OF_A_POINT = 2
# Limit of the weight of a point's result in its own fit. With 1, the fit would go through the point
# whatever its result is, and a division by 1 - weight would fail.
MOST_WEIGHT = 0.99
# Confidence of the F test that the fit misses more than luck. It is high, because results are not
# quite normal.
LACK_OF_FIT = 0.999
# As a share of the square of the mean: a smaller variance is rounding.
NOTHING = 1e-12
# The three streams of random numbers: they are part of the seed.
DESIGN, SAMPLE, RESAMPLE = range(3)


def points_for(factors: int) -> int:
    """Return how many points a fit of so many values needs: a power of two, at least 32."""
    whole = len(_terms_of(factors, 2))
    points = 32
    # Twice as many as `shares_of` needs for a fit of degree 2.
    while points < 2 * POINTS_A_TERM * whole:
        points *= 2
    return points


def design(factors: int, points: int, seed: int) -> Array:
    """Return quasi-random points of the unit cube, (points, factors), the same for each seed."""
    sampler = _sobol(factors, np.random.default_rng([seed, DESIGN]))
    return np.asarray(sampler.random(points), dtype=np.float64)


def _sobol(values: int, random: np.random.Generator) -> "QMCEngine":
    """Return a source of quasi-random points of so many values, each from 0 to 1."""
    # It takes a second to load, and most studies do not need it.
    from scipy.stats import qmc

    return qmc.Sobol(values, scramble=True, rng=random)


@dataclass(frozen=True, kw_only=True)
class Shares:
    """The parts of the variance of a run, as shares of all of it, 0 to 1.

    What the fit does not tell may come from any value. So the interval of each value reaches up by
    that. `first_order` and `total` have a share for each value: see `Effect` in
    `orchard.study.sensitivity.result`.
    """

    first_order: list[Interval]
    total: list[Interval]
    luck: Interval
    #: What the fit does not tell. If only one value is moved it is 0, because it belongs to that
    #: one.
    unfitted: Interval
    #: How well the fit predicts points that it has not seen, R2, 0 to 1.
    fit: float
    #: The mean result at the low and at the high end of each value, (f, 2).
    ends: Array


class _Terms:
    """The terms of a fit: for each the numbers of the values whose places are multiplied.

    () is the constant, (2, 2) the square of value 2, (0, 2) a product.
    """

    def __init__(self, terms: Sequence[tuple[int, ...]]) -> None:
        self.terms = list(terms)

    def columns(self, places: Array) -> Array:
        """Return the terms at some places, (n, t). `places`: -1 to 1, (n, f)."""
        columns = np.ones((len(places), len(self.terms)))
        for number, term in enumerate(self.terms):
            for factor in term:
                columns[:, number] *= places[:, factor]
        return columns


def _terms_of(factors: int, degree: int) -> list[tuple[int, ...]]:
    """Return the terms of a polynomial of degree 1, or of degree 2 with squares and products."""
    terms: list[tuple[int, ...]] = [()]
    terms += [(factor,) for factor in range(factors)]
    if degree == 2:
        terms += [(factor, factor) for factor in range(factors)]
        terms += list(combinations(range(factors), 2))
    return terms


def shares_of(
    factors: Sequence[Factor],
    points: Array,
    results: Sequence[Sequence[float]],
    confidence: float,
    seed: int,
) -> Shares | None:
    """Return the parts of the variance; None if there are too few points.

    `points`: in the unit cube, (n, f). `results`: for each point those of its runs.
    """
    # With few points a fit of degree 1 may still be possible.
    degree = 2
    while len(points) < POINTS_A_TERM * len(_terms_of(len(factors), degree)):
        degree -= 1
        if degree == 0:
            return None
    places = _places(factors, points)
    means = np.array([np.mean(of_point) for of_point in results])
    terms = _Terms(_terms_of(len(factors), degree))
    terms = _beyond_errors(terms, places, means)
    # Two samples of all values are drawn together: A and B of `_Fit`.
    sampler = _sobol(2 * len(factors), np.random.default_rng([seed, SAMPLE]))
    fit = _Fit(factors, terms, places, sampler)
    random = np.random.default_rng([seed, RESAMPLE])
    return _with_intervals(fit, means, _luck(results), confidence, random)


def _places(factors: Sequence[Factor], points: Array) -> Array:
    """Return where the values of points lie in their ranges, -1 to 1, (n, f).

    A share of the unit cube is not simply scaled: values are rounded, and some are whole numbers.
    """
    places = np.empty_like(points)
    for number, factor in enumerate(factors):
        for row, share in enumerate(points[:, number]):
            places[row, number] = factor.place(factor.value(float(share)))
    return places


def _luck(results: Sequence[Sequence[float]]) -> Array:
    """Return the variance of the runs of each point, (n,). They differ only in their seeds.

    A point with one run has no chance in it, so its variance is 0.
    """
    variances = []
    for of_point in results:
        if len(of_point) > 1:
            variances.append(float(np.var(of_point, ddof=1)))
        else:
            variances.append(0.0)
    return np.array(variances)


def _beyond_errors(terms: _Terms, places: Array, means: Array) -> _Terms:
    """Return the terms without the squares and products whose slopes are hardly larger than their
    errors.

    Such a term would fit the luck of the seed, which would then count as an effect.
    """
    columns = terms.columns(places)
    inverse = np.linalg.pinv(columns)
    slopes = inverse @ means
    left = means - columns @ slopes
    freedom = max(1, len(means) - len(terms.terms))
    # Standard errors of the slopes, by ordinary least squares.
    errors = np.sqrt(np.sum(left**2) / freedom * np.sum(inverse**2, axis=1))
    kept = []
    for term, slope, error in zip(terms.terms, slopes, errors, strict=True):
        if len(term) < 2 or abs(slope) > TELLS * error:
            kept.append(term)
    return _Terms(kept)


@dataclass(frozen=True, kw_only=True)
class _Parts:
    """The parts of the variance, as shares of all of it; `first_order` and `total` are (f,)."""

    first_order: Array
    total: Array
    luck: float
    unfitted: float
    #: As in `Shares`.
    fit: float
    #: The share of the fit's variance that is more than the errors of its slopes, 0 to 1.
    certain: float


class _Fit:
    """A fit by least squares, and samples of its polynomial, from which all effects follow.

    All results are linear or quadratic in the slopes, and the slopes are linear in the means of the
    points. So the matrices are computed once, and the bootstrap only changes the means, (n,).
    """

    def __init__(
        self, factors: Sequence[Factor], terms: _Terms, places: Array, sampler: "QMCEngine"
    ) -> None:
        self.factors = factors
        self.terms = terms
        self.columns = terms.columns(places)
        self.inverse = np.linalg.pinv(self.columns)
        # The weight of each point's result in the fit at this point (its leverage), (n,).
        self.weights = np.clip(np.sum(self.columns * self.inverse.T, axis=1), 0.0, MOST_WEIGHT)
        self._sample(sampler)

    def _sample(self, sampler: "QMCEngine") -> None:
        """Compute the matrices of the variances from samples of the polynomial.

        There are two samples, A and B, and for each value a third one: A with this value of B.
        """
        count = len(self.factors)
        drawn = np.asarray(sampler.random(SAMPLES), dtype=np.float64)
        places_a = _places(self.factors, drawn[:, :count])
        places_b = _places(self.factors, drawn[:, count:])
        columns_a = _centred(self.terms.columns(places_a))
        columns_b = _centred(self.terms.columns(places_b))
        # A variance is a quadratic form of the slopes, with a matrix (t, t). First the variance by
        # all values, then those of each value.
        self.of_all = columns_a.T @ columns_a / SAMPLES
        first_orders = []
        totals = []
        ends = []
        for number in range(count):
            of_value = places_a.copy()
            of_value[:, number] = places_b[:, number]
            moved = _centred(self.terms.columns(of_value)) - columns_a
            # The estimators of Saltelli (2010) and of Jansen (1999).
            first_orders.append(columns_b.T @ moved / SAMPLES)
            totals.append(moved.T @ moved / (2 * SAMPLES))
            for end in (-1.0, 1.0):
                of_value[:, number] = end
                ends.append(self.terms.columns(of_value).mean(axis=0))
        self.of_first_orders = np.array(first_orders)
        self.of_totals = np.array(totals)
        self.columns_of_ends = np.array(ends).reshape(count, 2, -1)

    def fitted(self, means: Array) -> Array:
        """Return the values of the fit at the points, (n,)."""
        return self.columns @ (self.inverse @ means)

    def misses(self, means: Array) -> Array:
        """Return for each point by how much a fit to all other points misses it, (n,)."""
        return np.asarray((means - self.fitted(means)) / (1.0 - self.weights))

    def ends(self, means: Array) -> Array:
        """Return the mean result at the ends of each value, (f, 2)."""
        return np.asarray(self.columns_of_ends @ (self.inverse @ means))

    def _variances(self, forms: Array, means: Array, noise: float) -> Array:
        """Return variances, one for each matrix of `forms`, without what errors of the slopes add.

        `noise`: the variance of a point's mean about the fit, from which these errors come.
        """
        slopes = self.inverse @ means
        # The covariances of the slopes, (t, t).
        errors = noise * self.inverse @ self.inverse.T
        with_errors = np.einsum("...ij,i,j->...", forms, slopes, slopes)
        added = np.einsum("...ij,ij->...", forms, errors)
        return np.asarray(np.maximum(0.0, with_errors - added))

    def _luck_and_rest(self, means: Array, luck: Array) -> tuple[float, float]:
        """Return the variance of a run by its seed, and the variance that the fit does not tell.

        An F test asks whether the means of points are further from the fit than their seeds
        explain. If not, the fit tells everything, and the distances also count for the luck of the
        seed.
        """
        count = len(means)
        # The variance of a run by its seed: from pairs of runs, and from distances to the fit.
        within = float(np.mean(luck))
        freedom = max(1, count - len(self.terms.terms))
        left = means - self.fitted(means)
        # The mean of two runs has half of the variance of a run.
        between = RUNS_OF_A_POINT * float(np.sum(left**2)) / freedom
        if between < within * float(special.fdtri(freedom, count, LACK_OF_FIT)):
            pooled = (freedom * between + count * within) / (freedom + count)
            return pooled, 0.0
        missed = float(np.mean(self.misses(means) ** 2)) - within / RUNS_OF_A_POINT
        return within, max(0.0, missed)

    def parts(self, means: Array, luck: Array) -> _Parts:
        """Return the parts of the variance. `luck`: as `_luck` returns it, (n,)."""
        of_seeds, missed = self._luck_and_rest(means, luck)
        noise = of_seeds / RUNS_OF_A_POINT + missed
        # The variance by all values as the fit has it, and without the errors of its slopes.
        of_fit = float(self._variances(self.of_all, means, 0.0))
        of_values = float(self._variances(self.of_all, means, noise))
        if max(of_fit, missed) <= NOTHING * float(np.mean(means)) ** 2:
            # No value has an effect.
            of_values = 0.0
            missed = 0.0
        everything = max(of_values + of_seeds + missed, np.finfo(float).tiny)
        # No value has a larger part than all together. By chance an estimator may say so.
        first_order = np.minimum(of_values, self._variances(self.of_first_orders, means, noise))
        total = np.minimum(of_values, self._variances(self.of_totals, means, noise))
        unfitted = missed
        if len(self.factors) == 1:
            # What the fit does not tell can come from no other value.
            first_order = np.array([of_values + missed])
            total = first_order
            unfitted = 0.0
        without_luck = max(of_values + missed, np.finfo(float).tiny)
        return _Parts(
            first_order=first_order / everything,
            total=total / everything,
            luck=of_seeds / everything,
            unfitted=unfitted / everything,
            fit=1.0 - missed / without_luck,
            certain=of_values / max(of_fit, np.finfo(float).tiny),
        )


def _centred(columns: Array) -> Array:
    """Return columns less their means."""
    return np.asarray(columns - columns.mean(axis=0))


def _with_intervals(
    fit: _Fit, means: Array, luck: Array, confidence: float, random: np.random.Generator
) -> Shares:
    """Return the shares, with intervals by a bootstrap of the residuals.

    A resample has for each point the value of the fit and the residual of another point. The
    residuals bring new errors into the slopes. So the fit is first made flatter, by the part of its
    variance that comes from such errors.
    """
    parts = fit.parts(means, luck)
    fitted = fit.fitted(means)
    middle = float(np.mean(fitted))
    flat = middle + (fitted - middle) * float(np.sqrt(parts.certain))
    # Residuals at points with a large weight are too small, so they are widened.
    left = (means - fitted) / np.sqrt(1.0 - fit.weights)
    # Percent of the resamples on each side of the interval.
    tail = 50.0 * (1.0 - confidence)
    drawn = []
    for _ in range(RESAMPLES):
        others = random.integers(len(left), size=len(left))
        seeds = random.integers(len(left), size=len(left))
        drawn.append(fit.parts(flat + left[others], luck[seeds]))
    rest = [each.unfitted for each in drawn]
    return Shares(
        first_order=_intervals(parts.first_order, [each.first_order for each in drawn], rest, tail),
        total=_intervals(parts.total, [each.total for each in drawn], rest, tail),
        luck=_interval(parts.luck, [each.luck for each in drawn], tail),
        unfitted=_interval(parts.unfitted, rest, tail),
        fit=parts.fit,
        ends=fit.ends(means),
    )


def _intervals(
    values: Array, drawn: Sequence[Array], rest: Sequence[float], tail: float
) -> list[Interval]:
    """Return each share with its interval.

    `drawn`: the shares of each resample. `rest`: by how much these may be larger, because the fit
    does not tell all.
    """
    intervals = []
    for number, value in enumerate(values):
        lows = [float(each[number]) for each in drawn]
        highs = [low + more for low, more in zip(lows, rest, strict=True)]
        low = _interval(float(value), lows, tail).low
        high = _interval(float(value), highs, tail).high
        intervals.append(Interval(mean=float(value), low=low, high=min(1.0, high)))
    return intervals


def _interval(value: float, drawn: Sequence[float], tail: float) -> Interval:
    """Return a value with an interval: on each side of it are `tail` % of the drawn values."""
    low, high = np.percentile(drawn, [tail, 100.0 - tail])
    return Interval(mean=value, low=min(value, float(low)), high=max(value, float(high)))
