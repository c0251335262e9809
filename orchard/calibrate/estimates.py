"""An estimate with its interval, and the resampling by which intervals are fitted."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any
from warnings import catch_warnings, simplefilter

import numpy as np
from scipy.stats import DegenerateDataWarning, bootstrap

# Resamples of an interval.
RESAMPLES = 999
# The seed by which they are drawn.
SEED = 1
# Resamples that are in memory at once.
BATCH = 100

Statistic = Callable[..., np.ndarray]


@dataclass(frozen=True)
class FittedValue:
    """A value that was fitted, and the interval in which it lies.

    `draws`: (RESAMPLES,) the values of all resamples. Those of estimates of one sample belong
    together.
    """

    value: float
    low: float
    high: float
    draws: np.ndarray

    @property
    def unknown(self) -> float:
        """The share of resamples that tell nothing."""
        return float(np.isnan(self.draws).mean())

    def of(self, resample: int | None) -> float:
        """Return the value of a resample; the estimate itself for None, and for one without any."""
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

    `samples`: (n,) each, resampled together. `statistic`: of resamples, (..., n) each. scipy gives
    it their `axis` too, which is always the last one.
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
    # A resample may tell nothing, such as the slope of equal ways.
    # Percent on either side of the interval.
    tail = 50.0 * (1.0 - confidence)
    lowest, highest = np.nanpercentile(draws, [tail, 100.0 - tail])
    return FittedValue(value, min(value, float(lowest)), max(value, float(highest)), draws)
