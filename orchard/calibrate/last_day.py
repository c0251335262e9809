"""Tests a fit on a day that it did not see: the bins an hour of the log beside those of the model.

Each run of the model has the pickers and the carriers of that day, and another seed. Its values are
those of one resample of the fit, so that the runs differ as much as the fit is unsure. A picker
that is known from the days before has its fitted rate, and that of another one is drawn.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import date
from statistics import fmean, variance
from typing import Any

import numpy as np
from scipy.stats import t as students_t

from orchard.calibrate.bins import LoggedBin, LoggedBins, Silence
from orchard.calibrate.estimates import RESAMPLES, SEED
from orchard.calibrate.fit import Fit, driving_values
from orchard.calibrate.model_bins import first_model_bins
from orchard.calibrate.spreads import ALIKE, drawn_spreads
from orchard.calibrate.structure import FEWEST_PICKERS
from orchard.field.kinds import name_of
from orchard.field.scenario import Scenario, with_changes

# Runs of the model.
RUNS = 20
# A day is a test if it has at least so many bins for each picker.
LEAST_BINS = 2
# Limits of the rate of a picker, as a share of the usual rate.
SLOWEST = 0.2
QUICKEST = 5.0


@dataclass(frozen=True)
class LastDay:
    """A day of the log beside what the fit predicts for it."""

    day: date
    bins: int
    pickers: int
    carriers: int
    #: bins/h of the log.
    logged: float
    #: bins/h of the model, mean of the runs.
    predicted: float
    #: bins/h; the interval from `low` to `high` should contain `logged`.
    low: float
    high: float

    @property
    def is_as_predicted(self) -> bool:
        """Whether the day lies in the interval."""
        return self.low <= self.logged <= self.high


def split_last_day(logged: LoggedBins) -> tuple[LoggedBins, list[LoggedBin]]:
    """Return the log without its last day, and the bins of that day; [] if there is one day."""
    last = max(of_log.day for of_log in logged.bins)
    before = [of_log for of_log in logged.bins if of_log.day < last]
    if not before:
        return logged, []
    of_day = [of_log for of_log in logged.bins if of_log.day == last]
    return LoggedBins(before, logged.silences, logged.gaps), of_day


def rate_of(bins: Sequence[LoggedBin], silences: Sequence[Silence] = ()) -> float:
    """Return the bins an hour of a day, from its first full bin to its last one.

    `logged_seconds` of these bins must be more than 0.
    """
    return 3600.0 * (len(bins) - 1) / logged_seconds(bins, silences)


def logged_seconds(bins: Sequence[LoggedBin], silences: Sequence[Silence] = ()) -> float:
    """Return the time from the first full bin of a day to its last one, without silences, s."""
    times = [of_log.full for of_log in bins]
    begin = min(times)
    end = max(times)
    silent = 0.0
    for silence in silences:
        if silence.day == bins[0].day:
            silent += max(0.0, min(end, silence.end) - max(begin, silence.begin))
    return end - begin - silent


def why_untested(of_day: Sequence[LoggedBin], silences: Sequence[Silence], usual: int) -> str:
    """Return why a day is no test of a fit; "" if it is one.

    `usual`: how many pickers there are if the log names none.
    """
    if not of_day:
        return "the log has one day, so nothing is left to test the fit on; a second day would do"
    pickers = len(_pickers_of(of_day)) or usual
    if pickers < FEWEST_PICKERS:
        return (
            f"the last day has one picker, and a harvest of the model {FEWEST_PICKERS} at least:"
            " no test"
        )
    if len(of_day) < LEAST_BINS * pickers or logged_seconds(of_day, silences) <= 0.0:
        return "the last day has too few bins to test the fit on"
    return ""


def _pickers_of(of_day: Sequence[LoggedBin]) -> list[str]:
    """Return the names of a day's pickers in order."""
    return sorted({of_log.picker for of_log in of_day if of_log.picker})


def check_on_day(
    fitted: Fit,
    of_day: Sequence[LoggedBin],
    silences: Sequence[Silence],
    confidence: float,
    tell: Callable[[int], None],
) -> LastDay:
    """Return how well a fit predicts a day. `why_untested` of it must be "".

    `tell`: gets the number of the runs that are done. Raises ScenarioError, Jam.
    """
    names = _pickers_of(of_day)
    carriers = len({of_log.carrier for of_log in of_day if of_log.carrier})
    pickers = len(names) or fitted.scenario.pickers
    scenario = with_changes(
        fitted.scenario,
        **{
            "pickers": pickers,
            "carriers": carriers or fitted.scenario.carrier_count,
            "picking.spread_of_pickers": ALIKE,
        },
    )
    rates = []
    for run in range(RUNS):
        drawn = _drawn(fitted, scenario, names, run)
        rates.append(rate_of(first_model_bins(drawn, len(of_day))))
        tell(run + 1)
    # Half of the interval, in standard deviations.
    deviations = float(students_t.ppf(0.5 + confidence / 2.0, RUNS - 1))
    predicted = fmean(rates)
    # The variance of one day about the mean of RUNS runs, which is not exact either.
    of_runs = variance(rates) * (1.0 + 1.0 / RUNS)
    half = deviations * math.sqrt(of_runs)
    return LastDay(
        day=of_day[0].day,
        bins=len(of_day),
        pickers=pickers,
        carriers=scenario.carrier_count,
        logged=rate_of(of_day, silences),
        predicted=predicted,
        low=max(0.0, predicted - half),
        high=predicted + half,
    )


def _drawn(fitted: Fit, scenario: Scenario, names: Sequence[str], run: int) -> Scenario:
    """Return the scenario of a run, with the values of a random resample of the fit.

    `names`: of the day's pickers. `run`: the number of the run, from 0.
    """
    picking = fitted.picking
    random = np.random.default_rng((SEED, run))
    resample = int(random.integers(RESAMPLES))
    rate = picking.rate.of(resample)
    changes: dict[str, Any] = {"seed": run + 1, "picking_rate": rate}
    changes |= drawn_spreads(scenario, picking, resample, rate)
    if fitted.driving is not None:
        changes |= driving_values(fitted.driving, resample)
    spread = 0.0
    if picking.between_pickers is not None:
        spread = picking.between_pickers.value
    # Picking times are lognormal with this coefficient of variation and the usual time as their
    # mean. sigma is the standard deviation of their logarithm. A rate is the inverse of a time, so
    # sigma**2 / 2 is added to its logarithm where a time of that mean has it subtracted.
    sigma = math.sqrt(math.log(1.0 + spread * spread))
    rates = {}
    for number in range(scenario.pickers):
        # Drawn for each picker, also if its rate is known: so the draws of others stay the same.
        share = math.exp(sigma * random.standard_normal() + sigma * sigma / 2.0)
        if number < len(names) and names[number] in picking.rates:
            share = picking.rates[names[number]] / picking.rate.value
        rates[name_of("picker", number + 1)] = float(np.clip(share, SLOWEST, QUICKEST))
    return with_changes(scenario, **changes, picker_rates=rates)
