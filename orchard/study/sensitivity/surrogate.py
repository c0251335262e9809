"""A quadratic fit to results at some points, and what its values share of the variance.

A harvest is dear, and Sobol's effects need thousands of them. So harvests at some points are fitted
with a polynomial of the second degree, and the effects are those of the fit. Each point has two
runs with seeds of their own: how unlike these are is the luck of the seed, and what is left between
the fit and the means of the points is what the fit does not tell.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import numpy.typing as npt
from scipy import special
from scipy.stats import qmc

from orchard.study.result import Interval
from orchard.study.sensitivity.factors import Factor

Array = npt.NDArray[np.float64]

# Points of the fit's own samples, a power of two, and fits of the bootstrap.
SAMPLES = 1024
RESAMPLES = 400
# Points for each term of a fit, at least.
POINTS_A_TERM = 1.5
# A square or a product stays in the fit if it is so many times as large as its error.
TELLS = 2.0
# They differ only in their seeds: to know that luck two are needed at least.
RUNS_OF_A_POINT = 2
# A point that alone decides a term is missed by no fit.
MOST_WEIGHT = 0.99
# How sure it must be that a fit misses more than luck. Results are not quite normal.
LACK_OF_FIT = 0.999
# Of the square of the mean: a variance below it is rounding.
NOTHING = 1e-12
# Names of the streams of random numbers.
DESIGN, SAMPLE, RESAMPLE = range(3)


def points_for(factors: int) -> int:
    """Return how many points a fit of so many values needs: a power of two."""
    whole = len(_terms_of(factors, 2))
    points = 32
    while points < 2 * POINTS_A_TERM * whole:
        points *= 2
    return points


def design(factors: int, points: int, seed: int) -> Array:
    """Return quasi-random points of the unit cube, (points, factors), the same for each seed."""
    sampler = qmc.Sobol(factors, scramble=True, rng=np.random.default_rng([seed, DESIGN]))
    return np.asarray(sampler.random(points), dtype=np.float64)


@dataclass(frozen=True, kw_only=True)
class Shares:
    """What is known of the variance of a run. Shares are of all of it, 0 to 1.

    What the fit does not tell may come from any value, so the interval of each reaches up by it.
    """

    first_order: list[Interval]
    total: list[Interval]
    luck: Interval
    #: 0 of one value alone: what its fit does not tell comes from it all the same.
    unfitted: Interval
    fit: float
    #: The mean result at the low and at the high end of each value, (factors, 2).
    ends: Array


class _Terms:
    """The terms of a fit: which values are multiplied in each of them."""

    def __init__(self, terms: Sequence[tuple[int, ...]]) -> None:
        self.terms = list(terms)

    def columns(self, places: Array) -> Array:
        """Return the terms at some places, (n, terms). `places`: -1 to 1, (n, factors)."""
        columns = np.ones((len(places), len(self.terms)))
        for number, term in enumerate(self.terms):
            for factor in term:
                columns[:, number] *= places[:, factor]
        return columns


def _terms_of(factors: int, degree: int) -> list[tuple[int, ...]]:
    """Return the terms of a polynomial. Of degree 2 are squares and products, of 1 neither."""
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
    """Return what the values share of the variance; None if there are too few points.

    `points`: in the unit cube, (n, factors). `results`: of the runs of each point.
    """
    degree = 2
    while len(points) < POINTS_A_TERM * len(_terms_of(len(factors), degree)):
        degree -= 1
        if not degree:
            return None
    places = _places(factors, points)
    means = np.array([np.mean(of_point) for of_point in results])
    terms = _Terms(_terms_of(len(factors), degree))
    terms = _beyond_errors(terms, places, means)
    sampler = qmc.Sobol(2 * len(factors), scramble=True, rng=np.random.default_rng([seed, SAMPLE]))
    fit = _Fit(factors, terms, places, sampler)
    random = np.random.default_rng([seed, RESAMPLE])
    return _with_intervals(fit, means, _luck(results), confidence, random)


def _places(factors: Sequence[Factor], points: Array) -> Array:
    """Return where the values of points lie in their ranges, -1 to 1, (n, factors)."""
    places = np.empty_like(points)
    for number, factor in enumerate(factors):
        for row, share in enumerate(points[:, number]):
            places[row, number] = factor.place(factor.value(float(share)))
    return places


def _luck(results: Sequence[Sequence[float]]) -> Array:
    """Return the variance of the runs of each point, which differ only in their seeds."""
    variances = []
    for of_point in results:
        if len(of_point) > 1:
            variances.append(float(np.var(of_point, ddof=1)))
        else:
            variances.append(0.0)
    return np.array(variances)


def _beyond_errors(terms: _Terms, places: Array, means: Array) -> _Terms:
    """Return the terms without the squares and products that are no larger than their errors.

    What they would fit is luck, and would count as an effect.
    """
    columns = terms.columns(places)
    inverse = np.linalg.pinv(columns)
    slopes = inverse @ means
    left = means - columns @ slopes
    freedom = max(1, len(means) - len(terms.terms))
    errors = np.sqrt(np.sum(left**2) / freedom * np.sum(inverse**2, axis=1))
    kept = []
    for term, slope, error in zip(terms.terms, slopes, errors, strict=True):
        if len(term) < 2 or abs(slope) > TELLS * error:
            kept.append(term)
    return _Terms(kept)


@dataclass(frozen=True, kw_only=True)
class _Parts:
    """The parts of the variance, as shares of all of it. Effects have one for each value."""

    first_order: Array
    total: Array
    luck: float
    unfitted: float
    #: How much of what the values move the fit tells, 0 to 1.
    fit: float
    #: Of what the fit tells: how much is more than the errors of its slopes, 0 to 1.
    certain: float


class _Fit:
    """A fit, and its own samples, from which all effects follow."""

    def __init__(
        self, factors: Sequence[Factor], terms: _Terms, places: Array, sampler: qmc.QMCEngine
    ) -> None:
        self.factors = factors
        self.terms = terms
        self.columns = terms.columns(places)
        self.inverse = np.linalg.pinv(self.columns)
        # How much of its own result each point has in the fit.
        self.weights = np.clip(np.sum(self.columns * self.inverse.T, axis=1), 0.0, MOST_WEIGHT)
        self._sample(sampler)

    def _sample(self, sampler: qmc.QMCEngine) -> None:
        """Draw the places at which the fit is asked: A, B, and A with each value of B."""
        count = len(self.factors)
        drawn = np.asarray(sampler.random(SAMPLES), dtype=np.float64)
        places_a = _places(self.factors, drawn[:, :count])
        places_b = _places(self.factors, drawn[:, count:])
        columns_a = _centred(self.terms.columns(places_a))
        columns_b = _centred(self.terms.columns(places_b))
        # A variance is a quadratic form of the slopes: first that of all values, then the parts.
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
        """Return what a fit to the means of the points tells there."""
        return self.columns @ (self.inverse @ means)

    def left(self, means: Array) -> Array:
        """Return by how much each point is missed by a fit to the others."""
        return np.asarray((means - self.fitted(means)) / (1.0 - self.weights))

    def ends(self, means: Array) -> Array:
        """Return the mean result at the ends of each value, (factors, 2)."""
        return np.asarray(self.columns_of_ends @ (self.inverse @ means))

    def _variances(self, forms: Array, means: Array, noise: float) -> Array:
        """Return the variances that quadratic forms of the slopes tell, without that which the
        errors of the slopes add. `noise`: the variance of a point's mean about the fit.
        """
        slopes = self.inverse @ means
        errors = noise * self.inverse @ self.inverse.T
        of_slopes = np.einsum("...ij,i,j->...", forms, slopes, slopes)
        added = np.einsum("...ij,ij->...", forms, errors)
        return np.asarray(np.maximum(0.0, of_slopes - added))

    def _luck_and_rest(self, means: Array, luck: Array) -> tuple[float, float]:
        """Return the variance of a run by its seed, and that which the fit does not tell.

        If the means of points are no further from the fit than seeds take them, by an F test, that
        tells of the luck too, and the fit tells all.
        """
        count = len(means)
        within = float(np.mean(luck))
        freedom = max(1, count - len(self.terms.terms))
        left = means - self.fitted(means)
        # The mean of a point has half of the luck of a run.
        between = RUNS_OF_A_POINT * float(np.sum(left**2)) / freedom
        if between < within * float(special.fdtri(freedom, count, LACK_OF_FIT)):
            pooled = (freedom * between + count * within) / (freedom + count)
            return pooled, 0.0
        missed = float(np.mean(self.left(means) ** 2)) - within / RUNS_OF_A_POINT
        return within, max(0.0, missed)

    def parts(self, means: Array, luck: Array) -> _Parts:
        """Return the parts of the variance. `luck`: the variance of the runs of each point."""
        of_seeds, missed = self._luck_and_rest(means, luck)
        noise = of_seeds / RUNS_OF_A_POINT + missed
        of_slopes = float(self._variances(self.of_all, means, 0.0))
        of_values = float(self._variances(self.of_all, means, noise))
        if max(of_slopes, missed) <= NOTHING * float(np.mean(means)) ** 2:
            of_values = missed = 0.0
        everything = max(of_values + of_seeds + missed, np.finfo(float).tiny)
        # Together the values have no more than all of them.
        first_order = np.minimum(of_values, self._variances(self.of_first_orders, means, noise))
        total = np.minimum(of_values, self._variances(self.of_totals, means, noise))
        unfitted = missed
        if len(self.factors) == 1:
            first_order = total = np.array([of_values + missed])
            unfitted = 0.0
        moved = max(of_values + missed, np.finfo(float).tiny)
        return _Parts(
            first_order=first_order / everything,
            total=total / everything,
            luck=of_seeds / everything,
            unfitted=unfitted / everything,
            fit=1.0 - missed / moved,
            certain=of_values / max(of_slopes, np.finfo(float).tiny),
        )


def _centred(columns: Array) -> Array:
    return np.asarray(columns - columns.mean(axis=0))


def _with_intervals(
    fit: _Fit, means: Array, luck: Array, confidence: float, random: np.random.Generator
) -> Shares:
    """Return the shares, with intervals of fits to results that are drawn anew.

    What a fit leaves at one point is added to what it tells at another one. Before that, the fit is
    made as flat as it is without the errors of its slopes, which the drawn results have anew.
    """
    parts = fit.parts(means, luck)
    fitted = fit.fitted(means)
    middle = float(np.mean(fitted))
    flat = middle + (fitted - middle) * float(np.sqrt(parts.certain))
    left = (means - fitted) / np.sqrt(1.0 - fit.weights)
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
    """Return each value with its interval. `rest`: by how much each drawn one may be larger."""
    intervals = []
    for number, value in enumerate(values):
        lows = [float(each[number]) for each in drawn]
        highs = [low + more for low, more in zip(lows, rest, strict=True)]
        low = _interval(float(value), lows, tail).low
        high = _interval(float(value), highs, tail).high
        intervals.append(Interval(mean=float(value), low=low, high=min(1.0, high)))
    return intervals


def _interval(value: float, drawn: Sequence[float], tail: float) -> Interval:
    """Return a value with the interval outside which `tail` % of the drawn ones lie on a side."""
    low, high = np.percentile(drawn, [tail, 100.0 - tail])
    return Interval(mean=value, low=min(value, float(low)), high=max(value, float(high)))
