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
from scipy.stats import qmc, sobol_indices

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
    """What is known of the variance of a run. Shares are of all of it, 0 to 1."""

    first_order: list[Interval]
    total: list[Interval]
    luck: Interval
    unfitted: float
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
    terms = _telling(terms, places, means)
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
        variances.append(np.var(of_point, ddof=1) if len(of_point) > 1 else 0.0)
    return np.array(variances)


def _telling(terms: _Terms, places: Array, means: Array) -> _Terms:
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

    @property
    def fit(self) -> float:
        """How much of what the values move the fit tells, 0 to 1."""
        moved = 1.0 - self.luck - self.unfitted
        return moved / (moved + self.unfitted) if moved > 0.0 else 0.0


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
        self.columns_a = self.terms.columns(places_a)
        self.columns_b = self.terms.columns(places_b)
        mixed = []
        ends = []
        for number in range(count):
            of_value = places_a.copy()
            of_value[:, number] = places_b[:, number]
            mixed.append(self.terms.columns(of_value))
            for end in (-1.0, 1.0):
                of_value[:, number] = end
                ends.append(self.terms.columns(of_value).mean(axis=0))
        self.columns_ab = np.array(mixed)
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
        count = len(self.factors)
        slopes = self.inverse @ means
        results_a = self.columns_a @ slopes
        of_values = float(np.var(results_a))
        of_seeds, missed = self._luck_and_rest(means, luck)
        everything = of_values + of_seeds + missed
        if of_values <= NOTHING * float(np.mean(means)) ** 2:
            everything = max(everything, np.finfo(float).tiny)
            nothing = np.zeros(count)
            return _Parts(
                first_order=nothing, total=nothing, luck=of_seeds / everything, unfitted=0.0
            )
        results_ab = self.columns_ab @ slopes
        # scipy 1.17 fails with one value alone. Beside it stands one without any effect.
        results_ab = np.vstack([results_ab, results_a])
        # Of a small effect the estimate may be a little below 0.
        effects = sobol_indices(
            func={
                "f_A": results_a.reshape(1, -1),
                "f_B": (self.columns_b @ slopes).reshape(1, -1),
                "f_AB": results_ab.reshape(count + 1, 1, -1),
            },
            n=SAMPLES,
        )
        of_all = of_values / everything
        return _Parts(
            first_order=np.clip(np.ravel(effects.first_order)[:count], 0.0, 1.0) * of_all,
            total=np.clip(np.ravel(effects.total_order)[:count], 0.0, 1.0) * of_all,
            luck=of_seeds / everything,
            unfitted=missed / everything,
        )


def _with_intervals(
    fit: _Fit, means: Array, luck: Array, confidence: float, random: np.random.Generator
) -> Shares:
    """Return the shares, with intervals of fits to results that are drawn anew.

    What a fit leaves at one point is added to what it tells at another one.
    """
    parts = fit.parts(means, luck)
    fitted = fit.fitted(means)
    left = (means - fitted) / np.sqrt(1.0 - fit.weights)
    drawn = []
    for _ in range(RESAMPLES):
        others = random.integers(len(left), size=len(left))
        seeds = random.integers(len(left), size=len(left))
        drawn.append(fit.parts(fitted + left[others], luck[seeds]))
    lucks = [np.array([each.luck]) for each in drawn]
    return Shares(
        first_order=_intervals(parts.first_order, [each.first_order for each in drawn], confidence),
        total=_intervals(parts.total, [each.total for each in drawn], confidence),
        luck=_intervals(np.array([parts.luck]), lucks, confidence)[0],
        unfitted=parts.unfitted,
        fit=parts.fit,
        ends=fit.ends(means),
    )


def _intervals(values: Array, drawn: Sequence[Array], confidence: float) -> list[Interval]:
    """Return each value with the interval in which that share of the drawn ones lies."""
    tail = 50.0 * (1.0 - confidence)
    lows, highs = np.percentile(drawn, [tail, 100.0 - tail], axis=0)
    intervals = []
    for value, low, high in zip(values, lows, highs, strict=True):
        mean = float(value)
        intervals.append(
            Interval(mean=mean, low=min(mean, float(low)), high=max(mean, float(high)))
        )
    return intervals
