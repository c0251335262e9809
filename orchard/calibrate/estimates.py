"""An estimate with its interval, and the bootstrap by which intervals are computed.

The bootstrap draws RESAMPLES samples of the same size from the sample of a log, with replacement,
and computes the value of each: the resamples. The interval is that of most of these values.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any
from warnings import catch_warnings, simplefilter

import numpy as np
from scipy.stats import DegenerateDataWarning, bootstrap

# Resamples of an interval. 999 is usual: percentiles fall on single resamples.
RESAMPLES = 999
# Of the drawing of resamples: the same log has the same intervals each time.
SEED = 1
# Resamples that are in memory at once.
BATCH = 100

Statistic = Callable[..., np.ndarray]


@dataclass(frozen=True)
class FittedValue:
    """A value that was fitted, and the interval in which it lies.

    `draws`: (RESAMPLES,) the values of all resamples; NaN for a resample that has no value. If two
    values were fitted to the same sample, `draws[i]` of both are of the same resample.
    """

    value: float
    low: float
    high: float
    draws: np.ndarray

    @property
    def unknown(self) -> float:
        """The share of resamples that have no value, 0 to 1."""
        return float(np.isnan(self.draws).mean())

    def of(self, resample: int | None) -> float:
        """Return the value of a resample.

        That is the estimate itself for None, and for a resample that has no value.
        """
        if resample is None or not np.isfinite(self.draws[resample]):
            return self.value
        return float(self.draws[resample])

    def words(self, digits: int = 3) -> str:
        """Return the value and its interval in words: "1.52 (1.44 to 1.6)"."""
        low = f"{self.low:.{digits}g}"
        high = f"{self.high:.{digits}g}"
        return f"{self.value:.{digits}g} ({low} to {high})"


def estimate(
    value: float, samples: Sequence[np.ndarray], statistic: Statistic, confidence: float
) -> FittedValue:
    """Return an estimate with its percentile interval.

    `value`: of the samples themselves. `samples`: (n,) each; element i of all of them belongs
    together, and is resampled together. `statistic`: a function from resamples, (..., n) each, to
    their values, (...). scipy also gives it `axis`, which is always the last one here.
    `confidence`: of the interval, 0 to 1.
    """
    options: dict[str, Any] = {"method": "percentile", "vectorized": True, "axis": -1}
    with catch_warnings():
        # Resamples without a value are left out below.
        simplefilter("ignore", DegenerateDataWarning)
        result = bootstrap(
            samples,
            statistic,
            n_resamples=RESAMPLES,
            paired=len(samples) > 1,
            confidence_level=confidence,
            rng=np.random.default_rng(SEED),
            batch=BATCH,
            **options,
        )
    draws = result.bootstrap_distribution
    # Percent of the resamples on either side of the interval. Those without a value (NaN), such as
    # the slope of equal ways, do not count.
    tail = 50.0 * (1.0 - confidence)
    lowest, highest = np.nanpercentile(draws, [tail, 100.0 - tail])
    return FittedValue(value, min(value, float(lowest)), max(value, float(highest)), draws)
